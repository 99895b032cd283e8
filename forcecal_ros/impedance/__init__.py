"""Impedance control with the contact-force observer, [Gamez2005] V and VI.

program (the reference) -> trial (the loop through the simulated rig, force by feedback) -> assess
(what the feedback was worth) -> experiment (all feedbacks, both accelerometers)
"""
