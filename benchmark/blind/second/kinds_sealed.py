"""The sealed half of the kinds of discrepancies, and other forms of library effects."""

import math
from typing import Any

from blind.effect import direction, Effect, sensing
from blind.rig import Rig
from blind.robot import Array
from blind.second.law import (
    Added,
    added,
    between,
    in_wrench,
    Kind,
    Law,
    Moved,
    Random,
    shaken,
    swung,
    tilted,
    unit,
    WRENCH_SCALE,
)
from numba import njit
import numpy as np


def _gyro(rng: Random) -> Law:
    """Carry a rotor that speeds up: its gyroscopic moment, and that of its acceleration."""
    spin, time = unit(rng), between(rng, 2.0, 20.0)

    def law(m: Moved) -> Added:
        speed = 1 - 0.6 * np.exp(-m.t / time)
        return added(m, torque=np.cross(m.omega, spin) * speed[:, None])

    return law


def _tip_power(rng: Random) -> Law:
    """Press with a round tip: the contact by a power of itself."""
    power = rng.uniform(1.2, 2.0)

    def law(m: Moved) -> Added:
        size = np.linalg.norm(m.contact, axis=1, keepdims=True) / 50.0
        force = m.contact * (size**(power - 1) - 0.7)
        return added(m, force, np.cross([0.2, 0.0, 0.1], force))

    return law


def _pendulum(rng: Random) -> Law:
    """Hang something below: two coupled directions of different frequency."""
    hz, damping = between(rng, 0.7, 5.0), between(rng, 0.02, 0.15)
    ratio, first, place = rng.uniform(1.1, 1.6), unit(rng), rng.uniform(-0.1, 0.1, 3)
    second = np.cross(first, unit(rng))

    def law(m: Moved) -> Added:
        force = sum(np.outer(m.force @ way - swung(m.force @ way, m.dt, f, damping), way)
                    for way, f in ((first, hz), (second, ratio * hz)))
        return added(m, force, np.cross(place, force))

    return law


def _air_drag(rng: Random) -> Law:
    """Drag a plate: by the square of the speed across it, in S."""
    plate, place = unit(rng), rng.uniform(-0.25, 0.25, 3)

    def law(m: Moved) -> Added:
        speed = (m.in_sensor(m.velocity) + np.cross(m.omega, place)) @ plate
        force = np.outer(-speed * np.abs(speed), plate)
        return added(m, force, np.cross(place, force))

    return law


@njit(cache=True)
def _relays(x, low, high):  # type: ignore[no-untyped-def]
    """Sum relays that switch up beyond ``high`` and down below ``low``."""
    state, out = np.where(x[0] > high, 1.0, -1.0), np.empty(len(x))
    for n in range(len(x)):
        for k in range(len(low)):
            if x[n] > high[k]:
                state[k] = 1.0
            elif x[n] < low[k]:
                state[k] = -1.0
        out[n] = state.sum()
    return out


def _seat_slip(rng: Random) -> Law:
    """Slip in the seat from one place to another under load and back under less: relays."""
    axis, out = int(rng.integers(3)), unit(rng, 6) * WRENCH_SCALE
    middle, half = rng.uniform(-0.4, 0.4, 6), rng.uniform(0.05, 0.3, 6)

    def law(m: Moved) -> Added:
        slip = _relays(m.wrench[:, axis] / m.load, middle - half, middle + half)
        return in_wrench(m, np.outer(slip, out))

    return law


def _mid_stop(rng: Random) -> Law:
    """Let a loose part tip over beyond an angle, and rest in between on either stop."""
    way, width, angles = unit(rng), between(rng, 0.02, 0.2), rng.uniform(-0.5, 0.5, 2)

    def law(m: Moved) -> Added:
        side = np.tanh(((m.up @ way)[:, None] - angles) / width).sum(axis=1)
        return added(m, torque=np.cross(way, -m.force) * side[:, None])

    return law


def _root_drift(rng: Random) -> Law:
    """Drift by the root of the time, with a slow swell on it."""
    out, swell, hz = unit(rng, 6) * WRENCH_SCALE, rng.uniform(0.0, 0.3), rng.uniform(0.05, 0.2)
    return lambda m: in_wrench(m, np.outer(
        np.sqrt(m.t) + swell * np.sin(2 * np.pi * hz * m.t), out))


def _accel_square(rng: Random) -> Law:
    """Bend the accelerometer: the square of what each axis feels."""
    gain, offset = unit(rng), rng.uniform(-0.5, 0.5)
    return lambda m: added(m, accel=gain * (m.force / 9.81 + offset)**2)


def _gain_warmup(rng: Random) -> Law:
    """Warm up in two stages: gains that change as the sensor does."""
    gain, times, share = unit(rng, 6), (between(rng, 1.0, 4.0), between(rng, 6.0, 40.0)), 0.4

    def law(m: Moved) -> Added:
        rise = share * np.exp(-m.t / times[0]) + (1 - share) * np.exp(-m.t / times[1])
        return in_wrench(m, (1 - rise)[:, None] * gain * m.wrench)

    return law


def _cubic_gain(rng: Random) -> Law:
    """Bend the wrench's characteristic by its third and fifth powers."""
    third, fifth = unit(rng, 6) * WRENCH_SCALE, 0.5 * unit(rng, 6) * WRENCH_SCALE

    def law(m: Moved) -> Added:
        x = m.wrench / (m.load * np.repeat([1.0, 0.2], 3))
        return in_wrench(m, third * x**3 + fifth * x**5)

    return law


def _accel_product(rng: Random) -> Law:
    """Let the product of two axes of the accelerometer move all."""
    mix = rng.standard_normal((3, 3))
    return lambda m: added(m, accel=np.roll(m.force, 1, axis=1) * m.force / 96.2 @ mix)


def _relay_steps(rng: Random) -> Law:
    """Be switched nearby: jumps that die away, at instants of their own in each recording."""
    seed, count, time = int(rng.integers(2**32)), int(rng.integers(3, 7)), between(rng, 0.3, 4.0)
    out = np.stack([unit(rng, 6) * WRENCH_SCALE for _ in range(count)])

    def law(m: Moved) -> Added:
        at = np.random.default_rng([seed, m.index]).uniform(0.05, 0.95, count) * m.t[-1]
        since = m.t[:, None] - at
        return in_wrench(m, np.where(since > 0, np.exp(-np.maximum(since, 0.0) / time), 0.0) @ out)

    return law


def _flange_warp(rng: Random) -> Law:
    """Warp the flange: products of two forces in the torques, by the third's sign a little."""
    mix, skew = rng.standard_normal((3, 3)), rng.uniform(-0.5, 0.5, 3)

    def law(m: Moved) -> Added:
        x = m.wrench[:, :3] / m.load
        return added(m, torque=x * np.roll(x, 1, axis=1) * (1 + skew * np.tanh(5 * x)) @ mix)

    return law


def _speed_tilt(rng: Random) -> Law:
    """Bend the wrist by its speed and acceleration of turning: joints that are not stiff."""
    of_speed, of_acceleration = rng.standard_normal((3, 3)), 0.05 * rng.standard_normal((3, 3))
    return lambda m: tilted(m, m.omega @ of_speed + m.alpha @ of_acceleration)


def _sensor_offset(rng: Random) -> Law:
    """Mount the sensor elsewhere than where the pose is measured."""
    lever = unit(rng)

    def law(m: Moved) -> Added:
        felt = np.cross(m.alpha, lever) + np.cross(m.omega, np.cross(m.omega, lever))
        moved = (m.R - m.R[0]) @ lever
        return shaken(m, felt)._replace(position=-moved)

    return law


_PLACE, _CONTACT, _ACCEL = (frozenset({one}) for one in ('position', 'contact', 'accel'))

KINDS: dict[str, Kind] = {
    'gyro': Kind(_gyro), 'tip_power': Kind(_tip_power, ('contact_stiffness',), _CONTACT),
    'pendulum': Kind(_pendulum), 'air_drag': Kind(_air_drag, (), _PLACE),
    'seat_slip': Kind(_seat_slip, ('wrench_hysteresis',)), 'mid_stop': Kind(_mid_stop),
    'root_drift': Kind(_root_drift, ('wrench_bias_drift',)),
    'accel_square': Kind(_accel_square, ('accel_gain', 'accel_bias'), _ACCEL),
    'gain_warmup': Kind(_gain_warmup, ('wrench_gain',)),
    'cubic_gain': Kind(_cubic_gain, ('wrench_gain',)),
    'accel_product': Kind(_accel_product, (), _ACCEL),
    'relay_steps': Kind(_relay_steps, ('wrench_bias_step', 'wrench_bias_drift')),
    'flange_warp': Kind(_flange_warp), 'speed_tilt': Kind(_speed_tilt),
    'sensor_offset': Kind(_sensor_offset)}
"""By name."""


# other forms of library effects

@njit(cache=True)
def _slips(x, widths, weights):  # type: ignore[no-untyped-def]
    """Sum elements that stick until they are drawn by their width (Prandtl and Ishlinskii)."""
    z, out = np.zeros((len(widths), x.shape[1])), np.zeros_like(x)
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            for k in range(len(widths)):
                new = z[k, j] + x[n, j] - x[n - 1, j]
                z[k, j] = min(max(new, -widths[k]), widths[k])
                out[n, j] += weights[k] * z[k, j] / widths[k]
    return out


def _hysteresis(rig: Rig, size: float, rng: Random) -> Rig:
    """Add a loop of four elements; ``size`` is its half height on the forces."""
    scale = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    widths, weights = np.exp(rng.uniform(np.log(3.0), np.log(40.0), 4)), rng.uniform(0.3, 1.0, 4)
    weights = weights / weights.sum()

    def stage(truth: Any, u: Array, _: Random) -> Array:
        return np.asarray(u + size * scale * _slips(u / scale, widths, weights))

    return sensing(rig, wrench=stage)


def _friction(rig: Rig, size: float, rng: Random) -> Rig:
    """Stick more than it slides: LuGre's bristle with Stribeck's curve."""
    return rig._replace(tool=rig.tool._replace(
        friction=size, presliding=between(rng, 5e-5, 2e-4), stribeck=rng.uniform(0.2, 0.8),
        stribeck_speed=between(rng, 0.002, 0.02)))


def _drift(rig: Rig, size: float, rng: Random) -> Rig:
    """Drift by a power of the time, turning to another direction on its way."""
    first, second = (np.concatenate([direction(rng), 0.05 * direction(rng)]) for _ in range(2))
    power, turn = rng.uniform(0.6, 1.6), rng.uniform(0.0, 0.5)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        x = truth.t / truth.t[-1]
        return u + size * (np.outer(x**power, first)
                           + turn * np.outer(np.sin(math.pi * x / 2)**4, second))

    return sensing(rig, wrench=stage)


FORMS: dict[str, Effect] = {one.name: one for one in (
    Effect('wrench_hysteresis', 'wrench_sensor', 0.02, 4.0, 'N', _hysteresis),
    Effect('tool_friction', 'tool', 0.05, 12.0, 'N', _friction),
    Effect('wrench_bias_drift', 'wrench_sensor', 0.02, 10.0, 'N', _drift))}
"""By name."""
