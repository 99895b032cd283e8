"""From a recording to a calibration: one function an equation, :mod:`pipeline` puts them together.

poses -> means -> tool (mass, centre of mass, biases, sag) -> ringing (stiffness, damping)
-> accelerometer (offset, map, delay) -> inertia -> covariance -> gain
"""
