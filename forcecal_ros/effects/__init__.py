"""Effects: what makes a real rig differ from the nominal one, switched on one by one.

:mod:`~forcecal_ros.effects.library` lists them; here is what they do. :mod:`numbers` changes the
rig's numbers, :mod:`signals` and :mod:`stamps` what the sensors say and when. What acts within the
robot's motion and the tool's slide stands beside those in :mod:`forcecal_ros.sim.rig`.
"""

from forcecal_ros.effects.apply import applicable, apply_signal_effects, with_effects
from forcecal_ros.effects.chosen import chosen_effects, named_effects, Values
from forcecal_ros.effects.library import Effect, EFFECTS, Quantity
from forcecal_ros.effects.numbers import physical_rig
from forcecal_ros.effects.signals import AccelerometerEffects, StampEffects, WrenchEffects

__all__ = [
    'AccelerometerEffects', 'applicable', 'apply_signal_effects', 'chosen_effects', 'Effect',
    'EFFECTS', 'named_effects', 'physical_rig', 'Quantity', 'StampEffects', 'Values',
    'with_effects', 'WrenchEffects',
]
