"""
A rig of a user's robot, from recordings of it.

grid (commands and poses on one grid) -> translation, rotation (how the robot follows), sensors
(rates and noise), tool -> fit (the rig, and what it leaves)
"""
