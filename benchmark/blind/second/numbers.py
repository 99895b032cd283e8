"""What the library would call the numbers that an effect has changed."""

from blind.rig import Rig
from blind.robot import Array
import numpy as np
from scipy.spatial.transform import Rotation

FORCES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')


def each(names: tuple[str, ...] | str, values: Array) -> dict[str, float]:
    """Return the numbers that are not zero, by their names."""
    return {name: float(value) for name, value in zip(names, values) if value}


def changed_numbers(name: str, size: float, before: Rig, after: Rig) -> dict[str, float]:
    """Return the numbers of an effect where both forms have the same ones, else nothing."""
    tool, was = after.tool, before.tool
    if name.endswith('_delay'):
        return {'delay': size}
    if name in ('tool_mass', 'tool_stiffness', 'tool_damping'):
        field = name.removeprefix('tool_')
        return {'change': getattr(tool, field) / getattr(was, field) - 1}
    if name in ('contact_stiffness', 'contact_damping'):
        field = name.removeprefix('contact_')
        return {'change': getattr(after.wall, field) / getattr(before.wall, field) - 1}
    if name == 'wall_position':
        return {'shift': after.wall.place - before.wall.place}
    if name == 'tool_com':
        return each('xyz', tool.com - was.com)
    if name == 'base_tilt':
        # gravity turned one way is a base turned the other way
        return each('xy', _turn(tool.gravity, was.gravity)[:2])
    if name == 'wrench_gain':
        return each(FORCES, after.sensors.gain / before.sensors.gain - 1)
    if name == 'accel_gain':
        return each('xyz', after.sensors.accel_gain / before.sensors.accel_gain - 1)
    if name == 'accel_bias':
        return each('xyz', after.sensors.accel_offset - before.sensors.accel_offset)
    return {}


def _turn(one: Array, other: Array) -> Array:
    """Return the rotation vector from one direction to another."""
    axis = np.cross(one, other)
    size = np.linalg.norm(axis)
    if not size:
        return np.zeros(3)
    angle = np.arctan2(size, one @ other)
    return np.asarray(Rotation.from_rotvec(axis / size * angle).as_rotvec())
