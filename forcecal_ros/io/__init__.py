"""Bags, CSV, URDF and calibration files: read and written here."""
