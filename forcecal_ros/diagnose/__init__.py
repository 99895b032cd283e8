"""Where simulation and recording differ, which effect causes it, how far the gap then shrinks.

recording -> :mod:`stamps`, :mod:`alignment` -> a :mod:`simulation`, by commands (:mod:`replay`)
or along the measured motion (:mod:`measured_motion`) -> :mod:`residual` (block means of 16
channels) -> :mod:`discrepancy`, :mod:`evidence` and :mod:`selection` -> :mod:`remainder`,
:mod:`where`, :mod:`gap` -> :mod:`verdict`; :mod:`pipeline` puts these together.
"""
