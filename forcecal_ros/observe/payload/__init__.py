"""Mass and centre of mass of what hangs on the sensor, estimated while the robot works."""
