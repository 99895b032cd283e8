"""Motion, sequences and contact control: what the robot is told, without knowing how."""
