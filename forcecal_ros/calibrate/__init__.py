"""From a recording to a calibration; :mod:`pipeline` has the order.

joint (tool, biases, delay) and accelerometer, from motion and rests alike; sag and ringing
(stiffness, damping) of a tool that is displaced; noise and observer gain at rest; then how far
the estimates can be trusted.
"""
