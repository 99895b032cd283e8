"""Effects: what makes a real rig differ from the nominal one, switched on one by one.

:mod:`~forcecal_ros.sim.library` lists them; here is what they do. :mod:`numbers` changes the
rig's numbers, :mod:`motion` the robot's motion, :mod:`signals` and :mod:`stamps` what the sensors
say and when; effects on the tool's slide are in :mod:`forcecal_ros.sim.tool`.
"""

from forcecal_ros.sim.chosen import chosen_effects, named_effects, Values
from forcecal_ros.sim.effects.apply import applicable, apply_signal_effects, with_effects
from forcecal_ros.sim.effects.motion import MotionEffects
from forcecal_ros.sim.effects.numbers import physical_rig
from forcecal_ros.sim.effects.signals import AccelerometerEffects, WrenchEffects
from forcecal_ros.sim.effects.stamps import StampEffects
from forcecal_ros.sim.library import Effect, EFFECTS, Quantity

__all__ = [
    'AccelerometerEffects', 'applicable', 'apply_signal_effects', 'chosen_effects', 'Effect',
    'EFFECTS', 'MotionEffects', 'named_effects', 'physical_rig', 'Quantity', 'StampEffects',
    'Values', 'with_effects', 'WrenchEffects',
]
