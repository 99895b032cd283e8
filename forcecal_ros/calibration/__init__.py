"""What an identification leaves: the calibration as data and as a file."""
