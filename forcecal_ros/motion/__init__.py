"""Motion of the robot: plans, profiles, limits, sequences and their monitor, without ROS."""
