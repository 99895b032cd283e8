"""Nuisance parameters: what a rig within nominal tolerances may differ in from its file."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.effects.rig import Rig, scaled, shifted, Tool, with_entry
import numpy as np

LIMIT = 3.0
"""Prior standard deviations by which a nuisance may depart; an effect of its name lies beyond."""

NAMELESS = 4.0
"""
The same of one without such an effect, an inertia or a zero of the wrench: what lies beyond is no
tolerance of any rig. Of nine such numbers one does in 6 of 10,000 rigs, and beyond LIMIT in 24 of
1000.
"""

ROBOT = 'robot'
"""Key of how a robot follows otherwise than fitted: poles move motion in no straight line."""

LEAST = -0.95
"""Lowest relative departure of a number that cannot be negative."""


class Nuisance(NamedTuple):
    """
    One parameter, in units of its prior standard deviation.

    Attributes
    ----------
    key : str
        Of its prior standard deviation in the rig's ``spreads``.
    apply : callable
        (rig, physical value) -> rig; relative where its prior std is.
    acts_on : str
        ``wrench`` or ``volts``: known in closed form, channel ``axis``; ``rig``: simulated.
    least : float
        Lowest physical value.
    prior_std : float or None
        Its own, where the rig's ``spreads`` do not hold it.
    limit : float
        By how many prior standard deviations it may depart.
    """

    name: str
    key: str
    apply: Callable[[Rig, float], Rig]
    acts_on: str = 'rig'
    axis: int = 0
    least: float = -np.inf
    prior_std: float | None = None
    limit: float = LIMIT


OF_TOOL = (Nuisance('tool.mass', 'mass', scaled('tool', 'mass'), least=LEAST),
           *(Nuisance(f'tool.com.{axis}', 'com', shifted('tool', 'com', i))
             for i, axis in enumerate('xyz')))
"""Mass and centre of mass; an effect of the name ``tool_`` and the key is one of them."""


def _inertia(axis: int) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        return with_inertia(axis)(rig, x * rig.tool.inertia[axis][axis])
    return apply


def with_inertia(axis: int) -> Callable[[Rig, float], Rig]:
    """Add to the tool's inertia about one axis."""
    def apply(rig: Rig, x: float) -> Rig:
        matrix = np.array(rig.tool.inertia)
        matrix[axis, axis] += x
        tool: Tool = replace(rig.tool, inertia=rows_of(possible(matrix)))
        return replace(rig, tool=tool)
    return apply


def possible(inertia: Array) -> Array:
    """Return the nearest inertia that a body can have, shape (3, 3)."""
    values, vectors = np.linalg.eigh(0.5 * (inertia + inertia.T))
    least = 1e-9 * np.abs(values).max()  # rounding must not make it negative again
    if values[0] > least:
        return inertia
    return np.asarray((vectors * np.maximum(values, least)) @ vectors.T)


def rows_of(matrix: Array) -> Any:
    """Return a matrix as a section holds it."""
    return tuple(map(tuple, matrix.tolist()))


def _accelerometer(field: str, index: int, name: str) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        model = rig.accelerometer.model(name)
        old = getattr(model, field)
        new = old[index] * (1 + x) if field == 'gain' else old[index] + x
        changed: dict[str, Any] = {name: replace(model, **{field: with_entry(old, index, new)})}
        return replace(rig, accelerometer=replace(rig.accelerometer, **changed))
    return apply


def nuisances(rig: Rig, accelerometer: str, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
    """List the nuisances that the streams at hand can show."""
    found = _of_robot(rig)
    if 'wrench' in streams:
        found += [*OF_TOOL, *(Nuisance(f'tool.inertia.{a}', 'inertia', _inertia(i), least=LEAST,
                                       limit=NAMELESS) for i, a in enumerate('xyz'))]
    if rig.optidrive is not None:
        found += [Nuisance(f'optidrive.{n}', n, scaled('optidrive', n), least=LEAST)
                  for n in ('stiffness', 'damping')]
    found += [Nuisance('wall.position', 'wall_position', shifted('wall', 'position')),
              *(Nuisance(f'wall.{n}', f'wall_{n}', scaled('wall', n), least=LEAST)
                for n in ('stiffness', 'damping'))]
    return (*found, *of_sensors(accelerometer, streams))


def _of_robot(rig: Rig) -> list[Nuisance]:
    """List how else the robot may follow, where its model was fitted to recordings."""
    found = [Nuisance(f'robot.{name}.{i}', ROBOT, _followed_otherwise(name, i), prior_std=1.0)
             for name, axis in zip('xyz', rig.robot.axes) if axis is not None and axis.tolerance
             for i, row in enumerate(axis.tolerance) if any(row)]
    found += [Nuisance(f'robot.turn.{i}', ROBOT, _turned_otherwise(i), prior_std=1.0)
              for i, row in enumerate(rig.servo.orientation_tolerance or ()) if any(row)]
    return found


def _followed_otherwise(name: str, direction: int) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        axis = getattr(rig.robot, name)
        step = x * np.array(axis.tolerance[direction])
        feedback, feedforward = np.array(axis.feedback), np.array(axis.feedforward)
        while np.abs(np.roots([1.0, *-(feedback + step[:3])])).max(initial=0.0) >= 1.0:
            step = 0.5 * step  # as far as the robot stays stable
        changed = replace(axis, feedback=tuple((feedback + step[:3]).tolist()),
                          feedforward=tuple((feedforward + step[3:]).tolist()))
        return replace(rig, robot=replace(rig.robot, **{name: changed}))
    return apply


def _turned_otherwise(direction: int) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        servo = rig.servo
        assert servo.orientation_tolerance is not None
        w, damping, delay = x * np.array(servo.orientation_tolerance[direction])
        return replace(rig, servo=replace(
            servo, orientation_bandwidth=max(0.5 * servo.orientation_bandwidth,
                                             servo.orientation_bandwidth + w),
            orientation_damping=max(0.1, (servo.orientation_damping or 1.0) + damping),
            orientation_delay=max(0.0, (servo.orientation_delay or 0.0) + delay)))
    return apply


def of_sensors(accelerometer: str, streams: tuple[str, ...]) -> list[Nuisance]:
    """List what the sensors at hand may have of their own: offsets and gains."""
    found: list[Nuisance] = []
    if 'wrench' in streams:
        keys = ['force_bias'] * 3 + ['torque_bias'] * 3
        found += [Nuisance(f'wrench.bias.{i}', key, shifted('wrench_sensor', 'bias', i),
                           'wrench', i, limit=NAMELESS) for i, key in enumerate(keys)]
        found += [Nuisance(f'wrench.gain.{i}', 'wrench_gain', scaled('wrench_sensor', 'gain', i),
                           'wrench', i)
                  for i in range(6)]
    if 'accelerometer' in streams:
        found += [Nuisance(f'accelerometer.{field}.{i}', f'accelerometer_{field}',
                           _accelerometer(field, i, accelerometer), 'volts', i)
                  for field in ('gain', 'offset') for i in range(3)]
    return found


def prior_std(rig: Rig, of: tuple[Nuisance, ...]) -> tuple[float, ...]:
    """Return the prior standard deviation of each nuisance, in its physical unit."""
    return tuple(float(getattr(rig.spreads, n.key) if n.prior_std is None else n.prior_std)
                 for n in of)


def apply_all(rig: Rig, of: tuple[Nuisance, ...], values: Mapping[str, float]) -> Rig:
    """
    Change a rig by nuisances.

    Parameters
    ----------
    values : mapping
        Name to physical value, as the prior std: relative or absolute.
    """
    for nuisance in of:
        if values.get(nuisance.name):
            rig = nuisance.apply(rig, values[nuisance.name])
    return rig
