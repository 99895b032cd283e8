"""What stands in for the robot: simulators of what its sensors say."""
