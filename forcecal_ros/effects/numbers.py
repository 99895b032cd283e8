"""Effects that change a number of the rig: mass, stiffness, position of the wall."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.effects.chosen import named_effects
from forcecal_ros.effects.rig import Optidrive, Rig, Tool, Wall
import numpy as np

Named = Mapping[str, float]


def _tool_mass(rig: Rig, v: Named) -> Rig:
    tool: Tool = replace(rig.tool, mass=rig.tool.mass * (1.0 + v['change']))
    return replace(rig, tool=tool)


def _tool_com(rig: Rig, v: Named) -> Rig:
    x, y, z = rig.tool.com
    return replace(rig, tool=replace(rig.tool, com=(x + v['x'], y + v['y'], z + v['z'])))


def _optidrive(name: str) -> Callable[[Rig, Named], Rig]:
    def change(rig: Rig, v: Named) -> Rig:
        if rig.optidrive is None:
            return rig
        optidrive: Optidrive = replace(
            rig.optidrive, **{name: getattr(rig.optidrive, name) * (1.0 + v['change'])})
        return replace(rig, optidrive=optidrive)
    return change


def _wall(name: str) -> Callable[[Rig, Named], Rig]:
    def change(rig: Rig, v: Named) -> Rig:
        wall: Wall = replace(rig.wall, **{name: getattr(rig.wall, name) * (1.0 + v['change'])})
        return replace(rig, wall=wall)
    return change


def _wall_position(rig: Rig, v: Named) -> Rig:
    return replace(rig, wall=replace(rig.wall, position=rig.wall.position + v['shift']))


def _base_tilt(rig: Rig, v: Named) -> Rig:
    """Gravity in a base that is tilted by a rotation vector about its X and Y."""
    R_level_base = rotation_from_vector(np.array([v['x'], v['y'], 0.0]))
    x, y, z = R_level_base.T @ rig.gravity
    return replace(rig, gravity=(x, y, z))


NUMBERS: Mapping[str, Callable[[Rig, Named], Rig]] = {
    'tool_mass': _tool_mass, 'tool_com': _tool_com,
    'tool_stiffness': _optidrive('stiffness'), 'tool_damping': _optidrive('damping'),
    'contact_stiffness': _wall('stiffness'), 'contact_damping': _wall('damping'),
    'wall_position': _wall_position, 'base_tilt': _base_tilt,
}
"""Name of the effect -> the rig with its numbers."""


def physical_rig(rig: Rig) -> Rig:
    """
    Apply the effects that change numbers of the rig.

    Returns
    -------
    Rig
        Without these effects, with the others.
    """
    others = tuple(one for one in rig.effects if one[0] not in NUMBERS)
    for name, values in named_effects(rig.effects).items():
        if name in NUMBERS:
            rig = NUMBERS[name](rig, values)
    return rig if others == rig.effects else replace(rig, effects=others)
