"""Where simulation and recording differ, which effect causes it, how far the gap then shrinks.

recording -> :mod:`stamps`, :mod:`alignment` -> :mod:`replay` -> :mod:`residual` (block means
of 16 channels) -> :mod:`noise` -> :mod:`evidence` and :mod:`selection` -> :mod:`remainder`,
:mod:`where`, :mod:`gap` -> :mod:`verdict`; :mod:`pipeline` puts these together.
"""
