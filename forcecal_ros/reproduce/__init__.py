"""The experiments and the error analysis of the papers, run on the simulated rig.

[Gamez2005] V and VI: rehearsal (a calibration) -> closed_loop (the law against the rig, with one
force of ``feedback``) -> assess (the figures of a run) -> experiment (every force, both
accelerometers), shown by ``forcecal impedance``. Nothing that runs on a robot imports this room.
"""
