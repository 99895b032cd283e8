"""The fourth sealed half of the kinds of discrepancies, and other forms of library effects."""

from collections.abc import Mapping
import math
from typing import Any

from blind.dynamics import _balance, _on, REST
from blind.effect import direction, Effect, sensing
from blind.effects_sensing import second_order
from blind.rig import follow, Rig
from blind.robot import Array, Motion, STEP
from blind.second.law import (
    Added,
    added,
    between,
    in_wrench,
    Kind,
    lagged,
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
from scipy.signal import iirpeak, lfilter

# mechanics


def _catenary(rng: Random) -> Law:
    """Hang a slack cable from a post: its weight, and a tension that grows as the sag is drawn."""
    aside, up = unit(rng) * [1.0, 1.0, 0.0], rng.uniform(0.0, 0.8)
    off = rng.uniform(0.5, 1.5) * aside / np.linalg.norm(aside) + [0.0, 0.0, up]
    length, place = np.linalg.norm(off) + rng.uniform(0.2, 0.6), rng.uniform(-0.1, 0.1, 3)

    def law(m: Moved) -> Added:
        line = m.position[0] + off - m.position - m.R @ place
        chord = np.clip(np.linalg.norm(line, axis=1), 0.05, 0.99 * length)
        sag = np.sqrt(3 * chord * (length - chord) / 8)
        force = line * (chord / (8 * sag))[:, None] - [0.0, 0.0, length / 2]
        force = m.in_sensor(force)
        return added(m, force, np.cross(place, force))

    return law


def _hose_pressure(rng: Random) -> Law:
    """Carry a hose that a valve puts under pressure: it pushes, and straightens its bend."""
    seed, on, off = int(rng.integers(2**32)), between(rng, 0.5, 3.0), between(rng, 0.5, 4.0)
    way, place, time = unit(rng), rng.uniform(-0.15, 0.15, 3), between(rng, 0.02, 0.4)
    stiff, bend = rng.uniform(0.05, 0.5, 3), rng.uniform(-0.5, 0.5, 3)

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        ends = np.cumsum(own.exponential(np.tile([off, on], 200)))
        open_ = (np.searchsorted(ends, m.t) % 2).astype(float)
        pressure = lagged(open_, m.dt, time)[:, None]
        force = pressure * way
        return added(m, force, np.cross(place, force) - pressure * stiff * (m.turned - bend))

    return law


@njit(cache=True)
def _rolled(push, half, rolls, sticks, bounce, dt):  # type: ignore[no-untyped-def]
    """Return place and acceleration of what rolls between two stops."""
    out, change = np.empty(len(push)), np.zeros(len(push))
    x, v = math.copysign(half, push[0]), 0.0
    for n in range(len(push)):
        before, a = v, rolls * push[n]
        if v == 0.0 and abs(a) < sticks:
            a = 0.0
        v += dt * (a - (math.copysign(sticks, v) if v != 0.0 else 0.0))
        if before * v < 0.0 and abs(a) < sticks:
            v = 0.0
        x += dt * v
        if abs(x) > half:
            x, v = math.copysign(half, x), -bounce * v
            if abs(v) < 0.01:
                v = 0.0
        out[n], change[n] = x, (v - before) / dt
    return out, change


def _rolling_ball(rng: Random) -> Law:
    """Roll a ball in a tube: it takes its time, knocks on either end and lies there."""
    way, place, half = unit(rng), rng.uniform(-0.1, 0.1, 3), between(rng, 0.01, 0.08)
    rolls, sticks, bounce = 5 / 7, between(rng, 0.05, 0.6), rng.uniform(0.0, 0.4)
    soft = between(rng, 0.004, 0.02)

    def law(m: Moved) -> Added:
        at, change = _rolled(-m.force @ way, half, rolls, sticks, bounce, m.dt)
        force = np.outer(-lagged(change, m.dt, soft), way)
        moment = np.cross(np.outer(at, way), -m.force)
        return added(m, force, np.cross(place, force) + moment)

    return law


@njit(cache=True)
def _crept(pull, threshold, rate):  # type: ignore[no-untyped-def]
    """Return how far it has crept, within -1 and 1, by what pulls beyond a threshold."""
    out, x = np.empty(len(pull)), 0.0
    for n in range(len(pull)):
        beyond = max(abs(pull[n]) - threshold, 0.0)
        x = min(max(x + rate * math.copysign(beyond, pull[n]), -1.0), 1.0)
        out[n] = x
    return out


def _creeping_grip(rng: Random) -> Law:
    """Hold a part that creeps in the jaws as long as it is pulled hard enough."""
    way, threshold = unit(rng), rng.uniform(0.5, 6.0)
    time = between(rng, 1.0, 12.0)

    def law(m: Moved) -> Added:
        at = _crept(-m.force @ way, threshold, m.dt / (4.0 * time))
        return added(m, torque=np.cross(np.outer(at, way), -m.force))

    return law


def _torsion_mode(rng: Random) -> Law:
    """Carry a wheel on a shaft that twists: its inertia follows the turning as a mode."""
    axis, hz, damping = unit(rng), between(rng, 1.5, 18.0), between(rng, 0.01, 0.12)

    def law(m: Moved) -> Added:
        turning = lagged(m.alpha @ axis, m.dt, 0.003)
        return added(m, torque=np.outer(turning - swung(turning, m.dt, hz, damping), axis))

    return law


def _air_jet(rng: Random) -> Law:
    """Pass through a jet of air that stands in the cell: Gaussian across it."""
    way, width = unit(rng), between(rng, 0.03, 0.15)
    off, place = rng.uniform(-0.15, 0.15, 3), rng.uniform(-0.15, 0.15, 3)

    def law(m: Moved) -> Added:
        line = m.position + m.R @ place - m.position[0] - m.R[0] @ place - off
        across = line - np.outer(line @ way, way)
        size = np.exp(-0.5 * np.sum(across**2, axis=1) / width**2)
        force = m.in_sensor(np.outer(size, way))
        return added(m, force, np.cross(place, force))

    return law


def _reversal_ring(rng: Random) -> Law:
    """Knock in a gear as it turns back: a mode that every change of sign excites."""
    axis, slow = unit(rng), between(rng, 0.02, 0.2)
    hz, damping = between(rng, 6.0, 45.0), between(rng, 0.02, 0.2)
    way, place = unit(rng), rng.uniform(-0.2, 0.2, 3)

    def law(m: Moved) -> Added:
        side = np.tanh(m.omega @ axis / slow)
        force = np.outer(swung(side, m.dt, hz, damping) - side, way)
        return added(m, force, np.cross(place, force))

    return law


def _counterweight(rng: Random) -> Law:
    """Hang on a counterweight over a pulley: its weight, and the inertia of both."""
    off, place = rng.uniform([-0.8, -0.8, 0.5], [0.8, 0.8, 1.5]), rng.uniform(-0.1, 0.1, 3)
    inertia, time = rng.uniform(1.0, 3.0), between(rng, 0.003, 0.03)

    def law(m: Moved) -> Added:
        line = m.position[0] + off - m.position - m.R @ place
        far = np.linalg.norm(line, axis=1)
        raised = np.gradient(np.gradient(lagged(far, m.dt, time), m.dt), m.dt)
        force = m.in_sensor(line * ((9.81 + inertia * raised) / far)[:, None])
        return added(m, force, np.cross(place, force))

    return law


def _recut(rng: Random) -> Law:
    """Cut into what was cut a turn before: contact less what it was then."""
    late, time = between(rng, 0.02, 0.2), between(rng, 0.002, 0.02)

    def law(m: Moved) -> Added:
        before = np.stack([np.interp(m.t - late, m.t, one) for one in m.contact.T], axis=1)
        touching = np.linalg.norm(m.contact, axis=1, keepdims=True)
        force = -lagged(m.contact - before, m.dt, time) * touching / (touching + 2.0)
        return added(m, force, np.cross([0.2, 0.0, 0.1], force))

    return law


def _set_screen(rng: Random) -> Law:
    """Dent the screen for good: contact lacks by a power of the hardest push so far."""
    power, time = rng.uniform(0.4, 1.6), between(rng, 0.02, 0.3)

    def law(m: Moved) -> Added:
        size = np.linalg.norm(m.contact, axis=1)
        dent = np.maximum.accumulate(lagged(size, m.dt, time) / 50.0)**power
        force = -m.contact * (dent / (size + 2.0))[:, None]
        return added(m, force, np.cross([0.2, 0.0, 0.1], force))

    return law


# electronics


def _idle_tone(rng: Random) -> Law:
    """Convert with a tone whose frequency is by what is converted, other phases each time."""
    out = np.zeros(6)
    out[rng.permutation(6)[:int(rng.integers(1, 4))]] = 1.0
    hz, more = between(rng, 3.0, 25.0), rng.choice([-1.0, 1.0]) * between(rng, 5.0, 40.0)
    phase = rng.uniform(0, 2 * math.pi, (2, 6))

    def law(m: Moved) -> Added:
        x = m.wrench / (m.load * np.repeat([1.0, 0.2], 3))
        turns = np.cumsum((hz + more * x) * m.dt, axis=0)
        return in_wrench(m, out * WRENCH_SCALE * np.sin(2 * math.pi * turns + phase[m.index]))

    return law


@njit(cache=True)
def _held(x, least):  # type: ignore[no-untyped-def]
    """Hold each column until it is off by so much."""
    out = x.copy()
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            if abs(x[n, j] - out[n - 1, j]) < least[j]:
                out[n, j] = out[n - 1, j]
    return out


def _send_on_change(rng: Random) -> Law:
    """Send a value only when it has changed enough, and repeat the last one until then."""
    least = between(rng, 0.01, 0.08) * np.repeat([1.0, 0.2], 3) * rng.uniform(0.5, 1.5, 6)
    kept = (rng.permutation(6) < rng.integers(2, 7)).astype(float)

    def law(m: Moved) -> Added:
        return in_wrench(m, kept * (_held(m.wrench, least * m.load) - m.wrench))

    return law


@njit(cache=True)
def _switched(x, low, high):  # type: ignore[no-untyped-def]
    """Switch each column on beyond ``high`` and off below ``low``."""
    out = np.zeros_like(x)
    for n in range(len(x)):
        for j in range(x.shape[1]):
            last = out[n - 1, j] if n else 0.0
            out[n, j] = 1.0 if x[n, j] > high else 0.0 if x[n, j] < low else last
    return out


def _range_switch(rng: Random) -> Law:
    """Change an amplifier's range by the load: another gain and zero beyond a level."""
    gain, zero = rng.standard_normal(3), rng.normal(0.0, 0.3, 3)
    high = rng.uniform(0.1, 0.6)
    low = rng.uniform(0.5, 0.9) * high

    def law(m: Moved) -> Added:
        x = m.wrench[:, :3] / m.load
        state = lagged(_switched(np.abs(x), low, high), m.dt, 0.003)
        return added(m, state * (gain * x + zero))

    return law


@njit(cache=True)
def _zeroed(x, quiet, share):  # type: ignore[no-untyped-def]
    """Follow each column while it is quiet."""
    out = x.copy()
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            out[n, j] = out[n - 1, j] + share * quiet[n] * (x[n, j] - out[n - 1, j])
    return out


def _auto_zero(rng: Random) -> Law:
    """Take the load for a zero that drifts while nothing moves: it goes away at rest."""
    time, still = between(rng, 0.5, 8.0), between(rng, 0.004, 0.04)
    gain = rng.uniform(0.3, 1.0, 6)

    def law(m: Moved) -> Added:
        change = np.linalg.norm(m.wrench - lagged(m.wrench, m.dt, 0.1), axis=1)
        quiet = 1 / (1 + (change / (still * m.load))**4)
        zero = _zeroed(m.wrench, quiet, -math.expm1(-m.dt / time))
        return in_wrench(m, -gain * (zero - zero[0]))

    return law


def _reference_walk(rng: Random) -> Law:
    """Convert by a reference that walks about: one gain of all channels, other each time."""
    seed, time = int(rng.integers(2**32)), between(rng, 0.3, 8.0)
    fast, gain = between(rng, 0.02, 0.2), rng.uniform(0.7, 1.3, 6)

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        grid = np.arange(0.0, m.t[-1] + 0.02, 0.01)
        steps = own.standard_normal(len(grid))
        walk = np.interp(m.t, grid, lfilter([1.0], [1.0, -math.exp(-0.01 / time)], steps))
        return in_wrench(m, gain * lagged(walk, m.dt, fast)[:, None] * m.wrench)

    return law


def _firmware_notch(rng: Random) -> Law:
    """Filter a band out in the firmware, as against a vibration that is not there."""
    hz, quality = between(rng, 2.0, 25.0), between(rng, 0.7, 5.0)
    share = rng.uniform(0.6, 1.0, 6)

    def law(m: Moved) -> Added:
        b, a = iirpeak(hz, quality, fs=1 / m.dt)
        return in_wrench(m, -share * lfilter(b, a, m.wrench - m.wrench[0], axis=0))

    return law


def _bus_beat(rng: Random) -> Law:
    """Poll a sensor by another clock: each value as old as the beat of both makes it."""
    late, hz = between(rng, 1e-3, 8e-3), between(rng, 0.2, 6.0)
    phase = rng.uniform(0, 1, 2)

    def law(m: Moved) -> Added:
        then = m.t - late * ((hz * m.t + phase[m.index]) % 1.0)
        old = np.stack([np.interp(then, m.t, one) for one in m.wrench.T], axis=1)
        return in_wrench(m, old - m.wrench)

    return law


def _tribo_charge(rng: Random) -> Law:
    """Charge the accelerometer's cable as it is twisted: a charge that leaks away."""
    axis, out, time = unit(rng), unit(rng), between(rng, 0.3, 4.0)
    rub = rng.uniform(0.0, 0.5)

    def law(m: Moved) -> Added:
        rate = m.omega @ axis
        course = lfilter([m.dt], [1.0, -math.exp(-m.dt / time)], rate + rub * np.abs(rate))
        return added(m, accel=np.outer(course, out))

    return law


def _accel_skewed(rng: Random) -> Law:
    """Convert one axis of the accelerometer after the other."""
    late = between(rng, 5e-4, 6e-3) * rng.permutation(3)

    def law(m: Moved) -> Added:
        then = np.stack([np.interp(m.t - one, m.t, f) for one, f in zip(late, m.force.T)], axis=1)
        return added(m, accel=then - m.force)

    return law


def _zero_shift(rng: Random) -> Law:
    """Shift the accelerometer's zero by each jolt, and let it come back over seconds."""
    threshold, time = rng.uniform(0.2, 2.0), between(rng, 0.8, 10.0)
    out = rng.standard_normal(3)

    def law(m: Moved) -> Added:
        jolt = np.linalg.norm(m.force - lagged(m.force, m.dt, 0.2), axis=1)
        beyond = np.maximum(jolt - threshold, 0.0)
        course = lfilter([m.dt], [1.0, -math.exp(-m.dt / time)], beyond)
        return added(m, accel=np.outer(course, out))

    return law


# mounting


def _rubber_pad(rng: Random) -> Law:
    """Put a rubber pad between sensor and tool: it leans by its moment, in two stages."""
    soft, share = rng.standard_normal((3, 3)), rng.uniform(0.2, 0.8)
    slow, fast = between(rng, 0.5, 6.0), between(rng, 0.01, 0.1)

    def law(m: Moved) -> Added:
        moment = m.wrench[:, 3:] - m.wrench[0, 3:]
        late = share * lagged(moment, m.dt, slow) + (1 - share) * lagged(moment, m.dt, fast)
        return tilted(m, late @ soft)

    return law


def _leaning_column(rng: Random) -> Law:
    """Stand on a column that is warmed on one side now and then, and leans away from it."""
    seed, time = int(rng.integers(2**32)), between(rng, 0.8, 6.0)
    warm, cool, way = between(rng, 1.5, 6.0), between(rng, 1.5, 6.0), unit(rng)

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        ends = np.cumsum(own.exponential(np.tile([cool, warm], 100)))
        sun = (np.searchsorted(ends, m.t) % 2).astype(float)
        heat = lagged(lagged(sun, m.dt, time), m.dt, 0.3 * time)
        return tilted(m, m.in_sensor(np.outer(heat, way * [1.0, 1.0, 0.0])))

    return law


def _cover_touch(rng: Random) -> Law:
    """Touch the cover beyond a deflection: it takes a share of what exceeds that."""
    way, limit = unit(rng, 6), rng.uniform(-0.3, 0.1)
    width, lever = between(rng, 0.01, 0.1), np.repeat([1.0, 0.2], 3)

    def law(m: Moved) -> Added:
        x = (m.wrench / (m.load * lever)) @ way
        beyond = width * np.logaddexp(0.0, (x - limit) / width)
        return in_wrench(m, -np.outer(beyond, way * lever))

    return law


def _passing_truck(rng: Random) -> Law:
    """Have trucks pass: the floor sinks to one side, to the other, and trembles meanwhile."""
    seed, many = int(rng.integers(2**32)), int(rng.integers(2, 5))
    lean, way = unit(rng) * [1.0, 1.0, 0.0], unit(rng)
    hz, tremble = between(rng, 4.0, 20.0), between(rng, 0.1, 3.0)

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        tilt, shake = np.zeros((len(m.t), 3)), np.zeros((len(m.t), 3))
        for _ in range(many):
            x = (m.t - own.uniform(0.1, 0.9) * m.t[-1]) / own.uniform(0.3, 1.2)
            passing = np.exp(-0.5 * x**2)
            tilt += np.outer(x * passing, lean)
            line = np.sin(2 * math.pi * hz * own.uniform(0.9, 1.1) * m.t)
            shake += tremble * np.outer(passing * line, way)
        return tilted(m, m.in_sensor(tilt)).plus(shaken(m, m.in_sensor(shake)))

    return law


def _neighbour_arm(rng: Random) -> Law:
    """Share a pedestal with another arm: its moves to and fro, in a rhythm of their own."""
    cycle, share, phase = between(rng, 1.5, 6.0), rng.uniform(0.15, 0.45), rng.uniform(0, 1, 2)
    hz, damping, lean = between(rng, 2.0, 12.0), between(rng, 0.02, 0.2), unit(rng)

    def law(m: Moved) -> Added:
        x = (m.t / cycle + phase[m.index]) % 1.0
        away, back = x / share, (x - 0.5) / share
        push = np.where((away > 0) & (away < 1), np.sin(2 * math.pi * away), 0.0)
        push -= np.where((back > 0) & (back < 1), np.sin(2 * math.pi * back), 0.0)
        tilt = np.outer(swung(push, m.dt, hz, damping), lean * [1.0, 1.0, 0.2])
        return tilted(m, m.in_sensor(tilt))

    return law


def _camera_lens(rng: Random) -> Law:
    """Measure positions by a camera whose lens distorts, radially and as it is off its centre."""
    view, centre, off = unit(rng), rng.uniform(-0.2, 0.2, 3), rng.uniform(-0.1, 0.1, 3)
    across = np.eye(3) - np.outer(view, view)

    def law(m: Moved) -> Added:
        r = (m.position - m.position[0] - centre) @ across
        square = np.sum(r**2, axis=1, keepdims=True)
        error = square * (r + off @ across) + 2 * r * (r @ off)[:, None]
        return added(m, position=error - error[0])

    return law


_PLACE, _CONTACT, _ACCEL = (frozenset({one}) for one in ('position', 'contact', 'accel'))

KINDS: Mapping[str, Kind] = {
    'catenary': Kind(_catenary, ('cable_force',), _PLACE),
    'hose_pressure': Kind(_hose_pressure, ('wrench_bias_step',)),
    'rolling_ball': Kind(_rolling_ball), 'creeping_grip': Kind(_creeping_grip, ('tool_com',)),
    'torsion_mode': Kind(_torsion_mode), 'air_jet': Kind(_air_jet, (), _PLACE),
    'reversal_ring': Kind(_reversal_ring),
    'counterweight': Kind(_counterweight, ('cable_force', 'tool_mass'), _PLACE),
    'recut': Kind(_recut, ('contact_damping',), _CONTACT),
    'set_screen': Kind(_set_screen, ('contact_stiffness', 'wall_position'), _CONTACT),
    'idle_tone': Kind(_idle_tone, ('spindle_vibration',)),
    'send_on_change': Kind(_send_on_change, ('wrench_quantisation', 'wrench_hysteresis')),
    'range_switch': Kind(_range_switch, ('wrench_gain',)),
    'auto_zero': Kind(_auto_zero, ('wrench_gain', 'wrench_bias_drift')),
    'reference_walk': Kind(_reference_walk, ('wrench_gain',)),
    'firmware_notch': Kind(_firmware_notch, ('wrench_delay', 'wrench_lowpass')),
    'bus_beat': Kind(_bus_beat, ('wrench_delay', 'wrench_lowpass')),
    'tribo_charge': Kind(_tribo_charge, (), _ACCEL),
    'accel_skewed': Kind(_accel_skewed, ('accel_delay',), _ACCEL),
    'zero_shift': Kind(_zero_shift, ('accel_bias',), _ACCEL),
    'rubber_pad': Kind(_rubber_pad),
    'leaning_column': Kind(_leaning_column, ('base_tilt',)),
    'cover_touch': Kind(_cover_touch, ('wrench_gain', 'wrench_saturation')),
    'passing_truck': Kind(_passing_truck), 'neighbour_arm': Kind(_neighbour_arm),
    'camera_lens': Kind(_camera_lens, (), _PLACE)}
"""By name."""


# other forms of library effects

FORCES_AND_TORQUES = np.repeat([1.0, 0.05], 3)
"""In what proportion an effect of the sensor sits in forces and torques."""


@njit(cache=True)
def _plays(x, width):  # type: ignore[no-untyped-def]
    """Follow each column within a play of either side."""
    out = x.copy()
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            out[n, j] = min(max(out[n - 1, j], x[n, j] - width[j]), x[n, j] + width[j])
    return out


def _hysteresis(rig: Rig, size: float, rng: Random) -> Rig:
    """Add a loop that closes towards its ends; ``size`` is its half height in the middle."""
    widths = FORCES_AND_TORQUES * rng.uniform(4.0, 16.0)
    knee = FORCES_AND_TORQUES * between(rng, 40.0, 150.0)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        loop = np.tanh(u / knee) - np.tanh(_plays(u, widths) / knee)
        return np.asarray(u + size * FORCES_AND_TORQUES * loop * knee / widths)

    return sensing(rig, wrench=stage)


def _drift(rig: Rig, size: float, rng: Random) -> Rig:
    """Drift away and back as heat passes, each channel in its time, and evenly besides."""
    first, second = (FORCES_AND_TORQUES * np.concatenate([direction(rng), direction(rng)])
                     for _ in range(2))
    times, even = np.exp(rng.uniform(np.log(2.0), np.log(15.0), 6)), rng.uniform(0.0, 0.6)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        x = truth.t[:, None] / times
        return np.asarray(u + size * (first * x * np.exp(1 - x)
                                      + even * np.outer(truth.t / truth.t[-1], second)))

    return sensing(rig, wrench=stage)


def _lowpass(rig: Rig, size: float, rng: Random) -> Rig:
    """Filter by Butterworth's fourth order; ``size`` is its delay at low frequency."""
    dampings = math.sin(math.pi / 8), math.cos(math.pi / 8)
    w = 2 * sum(dampings) / size
    return sensing(rig, wrench=lambda truth, u, _: second_order(
        second_order(u, w, dampings[0]), w, dampings[1]))


def _crosstalk(rig: Rig, size: float, rng: Random) -> Rig:
    """Let every channel leak into all others; ``size``: how much of each does so in all."""
    leak = rng.standard_normal((6, 6))
    np.fill_diagonal(leak, 0.0)
    leak *= size / np.linalg.norm(leak, axis=0)
    # torques reach forces by a longer lever than the other way, so that neither is all there is
    matrix = leak * np.outer(FORCES_AND_TORQUES, np.repeat([1.0, 5.0], 3))
    matrix[3:, 3:] = leak[3:, 3:]
    return sensing(rig, wrench=lambda truth, u, _: u + u @ matrix.T)


@njit(cache=True)
def _inside(dy, y, tool, own):  # type: ignore[no-untyped-def]
    """Return dy/dt with what acts in the guide: three bristles, and a spring that levels off."""
    friction, pinch, power, stiff, level = own[:5]
    s, v = y[0], dy[0]
    one, two, three = y[2] / own[5], y[3] / own[6], y[4] / own[7]
    total = own[8] * one + own[9] * two + own[10] * three
    force = friction * (1.0 + pinch * (s / 0.01) ** 2) * total
    force += stiff * s**3 / (1.0 + (s / level) ** 2)
    if friction > 0.0:
        one = v - abs(v) * math.copysign(abs(one) ** power, one)
        two = v - abs(v) * math.copysign(abs(two) ** power, two)
        three = v - abs(v) * math.copysign(abs(three) ** power, three)
    else:
        one = two = three = 0.0
    return (dy[0], dy[1] - force / tool.mass, one, two, three, dy[5], dy[6], dy[7])


@njit(cache=True)
def _slope(t, y, i, motion, tool, wall, own):  # type: ignore[no-untyped-def]
    """Return dy/dt, and the screen's force in S."""
    x, v, a, R, omega, alpha = motion
    got = _balance(t, y, x[i], v[i], a[i], R[i], omega[i], alpha[i], tool, wall)
    return _inside(got[0], y, tool, own), got[1]


@njit(cache=True)
def _guided(motion, tool, wall, own, rest_steps):  # type: ignore[no-untyped-def]
    """Return slide, its speed and acceleration, and the screen's force in S."""
    count, h = (len(motion[0]) - 1) // 2, 2.0 * STEP
    out, y = np.empty((count, 6)), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for n in range(-rest_steps, count):
        t, i, on = n * h, max(2 * n, 0), 1 if n >= 0 else 0
        k1, contact = _slope(t, y, i, motion, tool, wall, own)
        if n >= 0:
            out[n, 0], out[n, 1], out[n, 2] = y[0], y[1], k1[1]
            out[n, 3], out[n, 4], out[n, 5] = contact
        half = t + 0.5 * h
        k2, _ = _slope(half, _on(y, 0.5 * h, k1), i + on, motion, tool, wall, own)
        k3, _ = _slope(half, _on(y, 0.5 * h, k2), i + on, motion, tool, wall, own)
        k4, _ = _slope(t + h, _on(y, h, k3), i + 2 * on, motion, tool, wall, own)
        y = _on(_on(_on(_on(y, h / 6.0, k1), h / 3.0, k2), h / 3.0, k3), h / 6.0, k4)
    return out


def _felt(rig: Rig, m: Motion, ran: Array) -> tuple[Array, Array, Array]:
    """Return wrench, specific force and slide, but for what no slide changes."""
    tool, along = rig.tool, np.array([1.0, 0.0, 0.0])
    shift, rate, thrust = (np.outer(ran[:, k], along) for k in range(3))

    def at(place: Array) -> Array:
        r = place + shift
        return np.asarray(np.cross(m.alpha, r) + np.cross(m.omega, np.cross(m.omega, r))
                          + 2 * np.cross(m.omega, rate) + thrust)

    base = np.einsum('nji,nj->ni', m.R, m.acceleration - tool.gravity)
    contact, inertia = ran[:, 3:], tool.mass * (base + at(tool.com))
    torque = np.cross(rig.wall.tip + shift, contact) - np.cross(tool.com + shift, inertia)
    return np.hstack([contact - inertia, torque]), at(rig.sensors.place), ran[:, 0]


def _in_guide(rig: Rig, own: tuple[float, ...]) -> Rig:
    """Let something act between tool and guide, and feel what it changes."""
    known: list[Any] = []

    def change(truth: Any) -> tuple[Array, ...]:
        if not known or known[0] is not truth:
            motion = tuple(follow(rig.robot, truth.commands))
            without, there = (_felt(rig, truth.motion, _guided(motion, rig.tool, rig.wall, one,
                                                               REST))
                              for one in ((0.0, *own[1:3], 0.0, *own[4:]), own))
            known[:] = [truth, tuple(a - b for a, b in zip(there, without))]
        found: tuple[Array, ...] = known[1]
        return found

    return sensing(rig, wrench=lambda truth, u, _: u + change(truth)[0],
                   specific=lambda truth, f, _: f + change(truth)[1],
                   slide=lambda truth, s, _: s + change(truth)[2])


def _friction(rig: Rig, size: float, rng: Random) -> Rig:
    """Rub by bristles of three reaches that give way one after the other, more off the middle."""
    reaches = np.sort(np.exp(rng.uniform(np.log(2e-4), np.log(2e-3), 3)))
    weights = rng.dirichlet([2.0, 2.0, 2.0])
    return _in_guide(rig, (size, rng.uniform(0.0, 0.3), rng.uniform(1.2, 2.5), 0.0, 1.0,
                           *map(float, reaches), *map(float, weights)))


def _stiffening(rig: Rig, size: float, rng: Random) -> Rig:
    """Stiffen by the cube at first (``size``), and by no more further out."""
    return _in_guide(rig, (0.0, 0.0, 1.0, size, between(rng, 0.008, 0.03),
                           1.0, 1.0, 1.0, 0.0, 0.0, 0.0))


FORMS: Mapping[str, Effect] = {one.name: one for one in (
    Effect('wrench_hysteresis', 'wrench_sensor', 0.02, 4.0, 'N', _hysteresis),
    Effect('tool_friction', 'tool', 0.05, 12.0, 'N', _friction),
    Effect('wrench_bias_drift', 'wrench_sensor', 0.02, 10.0, 'N', _drift),
    Effect('wrench_lowpass', 'wrench_sensor', 5e-5, 0.03, 's', _lowpass),
    Effect('wrench_crosstalk', 'wrench_sensor', 3e-4, 0.1, '1', _crosstalk),
    Effect('tool_stiffening', 'tool', 3e4, 3e7, 'N/m^3', _stiffening))}
"""By name."""
