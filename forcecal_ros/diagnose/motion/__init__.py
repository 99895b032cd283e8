"""Diagnosis of recordings without commands: the wrench follows from the measured motion.

The chain is cut behind the robot: orientation and accelerometer (or position) as measured say how
the tool moves, and a calibration says what the wrench sensor should read then. Its effects bear
the library's names; two are its own. ``wrench_bias``: the sensor's zero has moved since the
calibration; ``inertial_force``: the tool's acceleration shows, which gravity alone leaves out.
"""
