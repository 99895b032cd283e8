"""Effects: what makes a real rig differ from the nominal one, switched on one by one.

:mod:`~forcecal_ros.effects.library` lists them. :mod:`~forcecal_ros.effects.rig` changes the
rig's numbers, :mod:`~forcecal_ros.effects.signals` the sampled signals and their stamps. What acts
within the motion of robot and tool is integrated in :mod:`forcecal_ros.sim.rig`.
"""

from forcecal_ros.effects.library import (
    chosen_effects,
    Effect,
    EFFECTS,
    named_effects,
    Quantity,
    Values,
)
from forcecal_ros.effects.rig import applicable, physical_rig, with_effects
from forcecal_ros.effects.signals import AccelerometerEffects, StampEffects, WrenchEffects

__all__ = [
    'AccelerometerEffects', 'applicable', 'chosen_effects', 'Effect',
    'EFFECTS', 'named_effects', 'physical_rig', 'Quantity', 'StampEffects', 'Values',
    'with_effects', 'WrenchEffects',
]
