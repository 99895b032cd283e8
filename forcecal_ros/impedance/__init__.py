"""Impedance control with the observed contact force, [Gamez2005] V.

plant (robot and slide, identified by plant_fit) -> design (law and margins) -> law (one step) ->
session (one contact task within its bounds)
"""
