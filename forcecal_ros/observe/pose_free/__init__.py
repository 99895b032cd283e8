"""The chain without a pose: accelerometer and gyro tell where down is."""
