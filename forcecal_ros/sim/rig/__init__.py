"""The rig in numbers: robot, tool, environment and sensors, offline and live from the same code.

commands -> :mod:`robot` -> motion of S -> :mod:`tool` -> slide and contact -> :mod:`sensors`
-> what the sensors say; :mod:`simulator` puts these together.
"""
