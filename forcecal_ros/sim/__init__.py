"""
What stands in for the robot: simulators of what its sensors say.

:mod:`rig` is the rig of the papers, live, offline and replayed; :mod:`measured_motion` carries a
rigid tool along a recorded motion, :mod:`rerun` runs a third-party simulator (:mod:`third_party`,
:mod:`mujoco`) again and again. For a diagnosis each is a :class:`signals.Simulation`.
"""
