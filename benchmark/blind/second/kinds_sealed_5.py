"""The fifth sealed half of the kinds of discrepancies, and other forms of library effects."""

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
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter

LEVER = np.repeat([1.0, 0.2], 3)
"""Of torques that count as much as forces [m]."""
COARSE = 0.008
"""Of what is followed step by step [s]."""


def _taken_along(m: Moved, x: Array, reach: float) -> Array:
    """Return what x (n, k) takes along once it is ``reach`` ahead of it, as friction does."""
    every = max(1, round(COARSE / m.dt))
    coarse = x[::every]
    out = coarse.copy()
    for n in range(1, len(out)):
        off = coarse[n] - out[n - 1]
        out[n] = coarse[n] - off * min(1.0, reach / max(1e-12, float(np.linalg.norm(off))))
    return np.stack([np.interp(m.t, m.t[::every], one) for one in out.T], axis=1)


def _side(x: Array, low: float, high: float) -> Array:
    """Return 1 from where x exceeds ``high`` until it is below ``low``, else -1."""
    mark = np.where(x > high, 1.0, np.where(x < low, -1.0, 0.0))
    mark[0] = mark[0] or -1.0
    last = np.maximum.accumulate(np.where(mark, np.arange(len(x)), 0))
    return np.asarray(mark[last])


# mechanics


def _cardan_wheel(rng: Random) -> Law:
    """Drive a wheel by a bent universal joint (rad): it runs ahead and behind twice a turn."""
    axis, bend, phase = unit(rng), rng.uniform(0.4, 1.1), rng.uniform(0, 2 * math.pi)

    def law(m: Moved) -> Added:
        angle = phase + np.cumsum(m.omega @ axis) * m.dt
        ahead = np.unwrap(np.arctan2(math.cos(bend) * np.sin(angle), np.cos(angle))) - angle
        rate = np.gradient(lagged(ahead, m.dt, 0.005), m.dt)
        return added(m, torque=np.outer(-np.gradient(rate, m.dt), axis))

    return law


def _paid_out(rng: Random) -> Law:
    """Pay out wire from a spool (m): its weight is less by how far the tool has gone."""
    place = rng.uniform(-0.15, 0.15, 3)

    def law(m: Moved) -> Added:
        gone = np.cumsum(np.linalg.norm(m.velocity, axis=1)) * m.dt
        force = m.force * gone[:, None]
        return added(m, force, np.cross(place, force))

    return law


def _cold_grease(rng: Random) -> Law:
    """Turn in cold grease: a torque by a power of the rate (rad/s), less as it is worked (rad)."""
    power, worked, mix = rng.uniform(0.2, 0.7), between(rng, 1.0, 10.0), rng.uniform(0.3, 1.0, 3)
    left = rng.uniform(0.2, 0.7)

    def law(m: Moved) -> Added:
        square = np.sum(m.omega**2, axis=1)
        path = np.cumsum(np.sqrt(square)) * m.dt
        stiff = left + (1 - left) * np.exp(-path / worked)
        thin = (square + 0.02**2) ** (0.5 * (power - 1))
        return added(m, torque=-mix * m.omega * (stiff * thin)[:, None])

    return law


def _snap_loop(rng: Random) -> Law:
    """Carry a hose in a loop that snaps over at an angle (rad), and back only at a smaller one."""
    axis, pull, place = unit(rng), unit(rng), rng.uniform(-0.15, 0.15, 3)
    middle, half = rng.uniform(-0.15, 0.15), between(rng, 0.02, 0.12)
    stiff, time = rng.uniform(0.2, 1.5), between(rng, 0.008, 0.05)

    def law(m: Moved) -> Added:
        x = np.cumsum(m.omega @ axis) * m.dt
        side = lagged(_side(x, middle - half, middle + half), m.dt, time)
        force = np.outer(side - stiff * (x - middle), pull)
        return added(m, force, np.cross(place, force))

    return law


def _cable_wave(rng: Random) -> Law:
    """Shake a long cable: a wave runs down it, comes back (s) and returns, weaker each time."""
    way, pull, place = unit(rng), unit(rng), rng.uniform(-0.1, 0.1, 3)
    trip, back = between(rng, 0.05, 0.7), rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 0.85)

    def law(m: Moved) -> Added:
        sent = m.force @ way - m.force[0] @ way
        felt = np.zeros(len(m.t))
        for k in range(1, 8):
            sent = lagged(sent, m.dt, 0.06 * trip)
            felt += back**k * np.interp(m.t - k * trip, m.t, sent, left=0.0)
        force = np.outer(felt, pull)
        return added(m, force, np.cross(place, force))

    return law


def _heaped_grain(rng: Random) -> Law:
    """Carry a hopper of grain: it slides beyond its angle of repose (rad), and stays there."""
    up = unit(rng)
    a = np.cross(up, unit(rng))
    a = a / np.linalg.norm(a)
    b, repose = np.cross(up, a), between(rng, 0.03, 0.35)

    def law(m: Moved) -> Added:
        felt = m.force / np.linalg.norm(m.force, axis=1, keepdims=True)
        heap = _taken_along(m, felt @ np.stack([a, b], axis=1), repose)
        at = lagged(-(heap - heap[0]) @ np.stack([a, b]), m.dt, 0.05)
        return added(m, torque=np.cross(at, -m.force))

    return law


def _spring_balancer(rng: Random) -> Law:
    """Hang on a spring balancer (N): it pulls more as it pays out than as it reels in."""
    off, place = rng.uniform([-0.8, -0.8, 0.6], [0.8, 0.8, 1.8]), rng.uniform(-0.1, 0.1, 3)
    rub, slow, stiff = rng.uniform(0.2, 0.6), between(rng, 0.003, 0.03), rng.uniform(0.0, 1.5)

    def law(m: Moved) -> Added:
        line = m.position[0] + off - m.position - m.R @ place
        far = np.linalg.norm(line, axis=1)
        rate = np.gradient(lagged(far, m.dt, 0.005), m.dt)
        pull = 1 + stiff * (far - far[0]) + rub * np.tanh(rate / slow)
        force = m.in_sensor(line * (pull / far)[:, None])
        return added(m, force, np.cross(place, force))

    return law


def _flat_tip(rng: Random) -> Law:
    """Press with a flat tip (m): the middle of the pressure moves to the side that leans (rad)."""
    width, lean = between(rng, 0.01, 0.15), rng.uniform(-0.1, 0.1, 2)
    half = rng.uniform(0.3, 1.0, 2)

    def law(m: Moved) -> Added:
        normal = m.in_sensor(np.tile([1.0, 0.0, 0.0], (len(m.t), 1)))
        at = np.zeros((len(m.t), 3))
        at[:, 1:] = half * np.tanh((normal[:, 1:] - lean) / width)
        return added(m, torque=np.cross(at, m.contact))

    return law


def _grinding_pull(rng: Random) -> Law:
    """Press a wheel that turns (Hz): it pulls aside by a power of the pressure, unevenly."""
    angle, power, hz = rng.uniform(0, 2 * math.pi), rng.uniform(0.5, 0.9), between(rng, 4.0, 40.0)
    uneven, phase = rng.uniform(0.0, 0.4), rng.uniform(0, 2 * math.pi, 2)
    side = np.array([0.0, math.cos(angle), math.sin(angle)])

    def law(m: Moved) -> Added:
        size = (np.linalg.norm(m.contact, axis=1) / 50.0)**power
        turn = np.sin(2 * math.pi * hz * m.t + phase[m.index])
        force = np.outer(size * (1 + uneven * turn), side)
        return added(m, force, np.cross([0.2, 0.0, 0.1], force))

    return law


# electronics


def _rectified_shake(rng: Random) -> Law:
    """Rectify vibration in an amplifier: a bias by the mean square of what is fast (s)."""
    fast, slow, out = between(rng, 0.02, 0.15), between(rng, 0.05, 1.0), unit(rng, 6)

    def law(m: Moved) -> Added:
        x = (m.wrench - lagged(m.wrench, m.dt, fast)) / (m.load * LEVER)
        level = lagged(np.sum(x**2, axis=1), m.dt, slow)
        return in_wrench(m, np.outer(level, out * WRENCH_SCALE))

    return law


def _stuck_bit(rng: Random) -> Law:
    """Convert with a bit that is stuck: too little in every second interval of the reading."""
    axes, period = rng.permutation(3)[:int(rng.integers(1, 4))], between(rng, 0.03, 0.25)
    phase = rng.uniform(0, 1, len(axes))

    def law(m: Moved) -> Added:
        force = np.zeros((len(m.t), 3))
        force[:, axes] = -(np.floor(m.wrench[:, axes] / (period * m.load) + phase) % 2.0)
        return added(m, force)

    return law


def _jittered_clock(rng: Random) -> Law:
    """Sample by a clock that wanders: each value is early or late (s), others each time."""
    seed, size = int(rng.integers(2**32)), between(rng, 3e-4, 3e-3)
    time = between(rng, 0.02, 0.5)

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        grid = np.arange(0.0, m.t[-1] + 0.02, 0.01)
        walk = lagged(np.concatenate([[0.0], own.standard_normal(len(grid) - 1)]), 0.01, time)
        late = np.interp(m.t, grid, size * walk / max(1e-9, float(walk.std())))
        then = np.stack([np.interp(m.t - late, m.t, one) for one in m.wrench.T], axis=1)
        return in_wrench(m, then - m.wrench)

    return law


def _predictor(rng: Random) -> Law:
    """Predict ahead (s) by rate and curvature, to hide a delay that is not there."""
    ahead, time = between(rng, 0.004, 0.04), between(rng, 0.01, 0.06)
    share, bend = rng.uniform(0.5, 1.0, 6), rng.uniform(0.0, 1.0)

    def law(m: Moved) -> Added:
        rate = (m.wrench - lagged(m.wrench, m.dt, time)) / time
        curve = (rate - lagged(rate, m.dt, time)) / time
        return in_wrench(m, share * (ahead * rate + 0.5 * bend * ahead**2 * curve))

    return law


def _despiked(rng: Random) -> Law:
    """Take quick changes for spikes, and give the median of the last while (s) instead."""
    window, least = between(rng, 0.03, 0.25), between(rng, 0.003, 0.05)

    def law(m: Moved) -> Added:
        every = max(1, round(0.002 / m.dt))
        coarse = m.wrench[::every]
        count = 2 * max(1, round(0.5 * window / (every * m.dt))) + 1
        middle = median_filter(coarse, (count, 1), mode='nearest')
        late = np.vstack([np.repeat(middle[:1], count // 2, axis=0), middle])[:len(coarse)]
        late = np.stack([np.interp(m.t, m.t[::every], one) for one in late.T], axis=1)
        off = late - m.wrench
        return in_wrench(m, np.where(np.abs(off) > least * m.load * LEVER, off, 0.0))

    return law


def _current_leak(rng: Random) -> Law:
    """Leak a drive's current: by its acceleration, friction (rad/s) and the weight it holds."""
    push, slow = rng.standard_normal((3, 6)) * WRENCH_SCALE, between(rng, 0.02, 0.2)
    inertia, rub, hold = between(rng, 0.05, 0.6), rng.uniform(0.3, 1.0), rng.uniform(0.0, 0.5)
    level = unit(rng)

    def law(m: Moved) -> Added:
        current = inertia * lagged(m.alpha, m.dt, 0.008) + rub * np.tanh(m.omega / slow)
        current = current + hold * np.cross(level, m.up - m.up[0])
        return in_wrench(m, current @ push)

    return law


def _bridged_gaps(rng: Random) -> Law:
    """Draw straight lines over what a bus has lost (s), as a driver that hides it."""
    seed, rest, lost = int(rng.integers(2**32)), between(rng, 0.2, 1.5), between(rng, 0.04, 0.3)

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        ends = np.cumsum(own.exponential(np.tile([rest, lost], 500)))
        kept = np.searchsorted(ends, m.t) % 2 == 0
        kept[[0, -1]] = True
        drawn = np.stack([np.interp(m.t, m.t[kept], one) for one in m.wrench[kept].T], axis=1)
        return in_wrench(m, drawn - m.wrench)

    return law


def _three_beams(rng: Random) -> Law:
    """Measure by three beams: gains that repeat three times about the axis of the cell."""
    axis = int(rng.integers(3))
    x, y = (axis + 1) % 3, (axis + 2) % 3
    phase, sizes = rng.uniform(0, 2 * math.pi, 3), rng.uniform(0.3, 1.0, 3)

    def law(m: Moved) -> Added:
        out = np.zeros((len(m.t), 6))
        for start, size, own in ((0, sizes[0], phase[0]), (3, sizes[1], phase[1])):
            across = m.wrench[:, start + x] + 1j * m.wrench[:, start + y]
            error = size * across * np.cos(3 * np.angle(across) + own)
            out[:, start + x], out[:, start + y] = error.real, error.imag
        aside = m.wrench[:, x] + 1j * m.wrench[:, y]
        out[:, axis] = sizes[2] * np.abs(aside) * np.sin(3 * np.angle(aside) + phase[2])
        return in_wrench(m, out)

    return law


def _accel_commutation(rng: Random) -> Law:
    """Pick up a motor's commutation: a tone of so many waves a turn, louder as it turns fast."""
    axis, out, waves = unit(rng), unit(rng), between(rng, 60.0, 500.0)
    slow, phase = between(rng, 0.03, 0.5), rng.uniform(0, 2 * math.pi)

    def law(m: Moved) -> Added:
        rate = m.omega @ axis
        tone = np.sin(waves * np.cumsum(rate) * m.dt + phase)
        return added(m, accel=np.outer(tone * np.tanh(np.abs(rate) / slow), out))

    return law


# mounting


def _accel_strain(rng: Random) -> Law:
    """Mount the accelerometer where the tool bends: it feels the strain of torque and force."""
    bent, drawn = rng.standard_normal((3, 3)), 0.3 * rng.standard_normal((3, 3))

    def law(m: Moved) -> Added:
        x = (m.wrench - m.wrench[0]) / (m.load * LEVER)
        return added(m, accel=x[:, 3:] @ bent + np.abs(x[:, :3]) @ drawn)

    return law


def _softening_wax(rng: Random) -> Law:
    """Mount the accelerometer with wax that softens (s): it leans over as it gets warm."""
    way, time, late = unit(rng), between(rng, 2.0, 20.0), rng.uniform(0.0, 0.4)

    def law(m: Moved) -> Added:
        since = np.maximum(m.t - late * m.t[-1], 0.0)
        return added(m, accel=np.cross(m.force, np.outer(-np.expm1(-(since / time)**1.5), way)))

    return law


def _marker_bracket(rng: Random) -> Law:
    """Measure positions by a target on a bracket (Hz) that rings, and sags by its weight."""
    hz, damping, way = between(rng, 2.0, 15.0), between(rng, 0.01, 0.15), unit(rng)

    def law(m: Moved) -> Added:
        off = m.R @ way * swung(-m.force @ way, m.dt, hz, damping)[:, None]
        return added(m, position=off - off[0])

    return law


def _windy_mast(rng: Random) -> Law:
    """Stand on a mast (m) that sways in the wind in a narrow band (Hz), others each time."""
    seed, hz, damping = int(rng.integers(2**32)), between(rng, 0.3, 2.5), between(rng, 0.02, 0.15)
    height, mix = between(rng, 0.5, 4.0), rng.standard_normal((2, 2))

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        before = 20.0 / hz
        grid = np.arange(-before, m.t[-1] + 0.02, 0.01)
        wind = lagged(own.standard_normal((len(grid), 2)), 0.01, 0.05)
        sway = swung(wind, 0.01, hz, damping) @ mix
        lean = CubicSpline(grid, np.hstack([sway, np.zeros((len(grid), 1))]))
        aside = np.cross(lean(m.t, 2), [0.0, 0.0, height])
        return tilted(m, m.in_sensor(lean(m.t))).plus(shaken(m, m.in_sensor(aside)))

    return law


def _levelled_table(rng: Random) -> Law:
    """Stand on air legs that leak and are levelled again every few seconds."""
    period, share, phase = between(rng, 2.5, 12.0), rng.uniform(0.05, 0.3), rng.uniform(0, 1, 2)
    way, soft = unit(rng) * [1.0, 1.0, 0.0], between(rng, 0.02, 0.2)

    def law(m: Moved) -> Added:
        x = (m.t / period + phase[m.index]) % 1.0
        sunk = np.where(x < 1 - share, x / (1 - share), (1 - x) / share)
        return tilted(m, m.in_sensor(np.outer(lagged(sunk, m.dt, soft), way)))

    return law


def _bridging_cable(rng: Random) -> Law:
    """Bridge the sensor by slack cables: they take the more the tighter, with friction."""
    reach, share = between(rng, 0.02, 0.2), rng.uniform(0.2, 1.0, 6)

    def law(m: Moved) -> Added:
        along = _taken_along(m, m.wrench / (m.load * LEVER), reach)
        along = lagged(along - along[0], m.dt, 0.01)
        tight = np.linalg.norm(along, axis=1, keepdims=True)
        return in_wrench(m, -share * LEVER * tight * along)

    return law


def _weak_lock(rng: Random) -> Law:
    """Lift off in a tool changer: it tilts by what the moment exceeds its preload (N m)."""
    preload, time = rng.uniform(0.1, 0.7), between(rng, 0.005, 0.05)
    soft = rng.uniform(0.2, 1.0, 3) * [1.0, 1.0, 0.3]
    soft = soft[rng.permutation(3)]

    def law(m: Moved) -> Added:
        x = m.wrench[:, 3:] / (9.81 * m.mass * float(np.linalg.norm(m.com)))
        size = np.linalg.norm(x, axis=1, keepdims=True)
        beyond = x * np.maximum(size - preload, 0.0) / np.maximum(size, 1e-9)
        return tilted(m, lagged(beyond, m.dt, time) * soft)

    return law


_PLACE, _CONTACT, _ACCEL = (frozenset({one}) for one in ('position', 'contact', 'accel'))

KINDS: Mapping[str, Kind] = {
    'cardan_wheel': Kind(_cardan_wheel),
    'paid_out': Kind(_paid_out, ('tool_mass', 'wrench_gain'), _PLACE),
    'cold_grease': Kind(_cold_grease), 'snap_loop': Kind(_snap_loop),
    'cable_wave': Kind(_cable_wave), 'heaped_grain': Kind(_heaped_grain, ('tool_com',)),
    'spring_balancer': Kind(_spring_balancer, ('cable_force',), _PLACE),
    'flat_tip': Kind(_flat_tip, (), _CONTACT),
    'grinding_pull': Kind(_grinding_pull, ('wrench_crosstalk',), _CONTACT),
    'rectified_shake': Kind(_rectified_shake, ('wrench_bias_drift',)),
    'stuck_bit': Kind(_stuck_bit, ('wrench_quantisation',)),
    'jittered_clock': Kind(_jittered_clock, ('wrench_delay', 'wrench_lowpass')),
    'predictor': Kind(_predictor, ('wrench_delay', 'wrench_lowpass')),
    'despiked': Kind(_despiked, ('wrench_delay', 'wrench_lowpass')),
    'current_leak': Kind(_current_leak),
    'bridged_gaps': Kind(_bridged_gaps, ('dropouts',)),
    'three_beams': Kind(_three_beams, ('wrench_gain', 'wrench_crosstalk')),
    'accel_commutation': Kind(_accel_commutation, (), _ACCEL),
    'accel_strain': Kind(_accel_strain, ('accel_gain', 'accel_misalignment'), _ACCEL),
    'softening_wax': Kind(_softening_wax, ('accel_misalignment', 'accel_bias'), _ACCEL),
    'marker_bracket': Kind(_marker_bracket, ('robot_resonance',), _PLACE),
    'windy_mast': Kind(_windy_mast), 'levelled_table': Kind(_levelled_table, ('base_tilt',)),
    'bridging_cable': Kind(_bridging_cable, ('wrench_gain', 'wrench_hysteresis')),
    'weak_lock': Kind(_weak_lock)}
"""By name."""


# other forms of library effects

FORCES_AND_TORQUES = np.repeat([1.0, 0.05], 3)
"""In what proportion an effect of the sensor sits in forces and torques."""


def _path_loop(x: Array, others: float, widths: tuple[float, float], share: float) -> Array:
    """Return what fades with the length of the path, its own and in part that of the others."""
    steps = np.diff(x, axis=0)
    whole = np.sum(steps**2, axis=1)
    out = np.zeros_like(x)
    for j, own in enumerate(steps.T):
        way = np.sqrt(own**2 + others**2 * (whole - own**2))
        along = np.concatenate([[0.0], np.cumsum(way)]) + 1e-9 * np.arange(len(x))
        step = max(0.02 * min(widths), float(along[-1]) / 400000)
        even = np.arange(0.0, along[-1] + step, step)
        grid = np.interp(even, along, x[:, j])
        loop = sum(part / width * (grid - lagged(grid, step, width))
                   for part, width in zip((share, 1 - share), widths))
        out[:, j] = np.interp(along, even, loop)
    return out


def _hysteresis(rig: Rig, size: float, rng: Random) -> Rig:
    """Add a loop that fades by the path and by that of the other axes; ``size``: half height."""
    widths, share = (between(rng, 2.0, 6.0), between(rng, 8.0, 25.0)), rng.uniform(0.3, 0.7)
    others = between(rng, 0.05, 0.5)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        x = u / FORCES_AND_TORQUES
        loop = np.hstack([_path_loop(one, others, widths, share) for one in (x[:, :3], x[:, 3:])])
        return np.asarray(u + size * FORCES_AND_TORQUES * loop)

    return sensing(rig, wrench=stage)


def _drift(rig: Rig, size: float, rng: Random) -> Rig:
    """Follow the heat of a hall late, which rises until a door is opened and changes then."""
    out = FORCES_AND_TORQUES * np.concatenate([direction(rng), direction(rng)])
    opened, after = rng.uniform(0.3, 0.8), rng.uniform(-0.5, 0.5)
    times = np.exp(rng.uniform(np.log(0.5), np.log(8.0), 6))

    def stage(truth: Any, u: Array, _: Random) -> Array:
        t, end = truth.t, float(truth.t[-1])
        hall = np.minimum(t, opened * end) + after * np.maximum(t - opened * end, 0.0)
        heat = np.stack([lagged(hall / end, float(t[1] - t[0]), one) for one in times], axis=1)
        return np.asarray(u + 1.5 * size * out * heat)

    return sensing(rig, wrench=stage)


def _delay(rig: Rig, size: float, rng: Random) -> Rig:
    """Pass values on once a cycle of a slow bus, and hold them; ``size``: late on average."""
    cycle, phase = size * rng.uniform(0.4, 1.6), rng.uniform(0, 1)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        taken = cycle * (np.floor(truth.t / cycle + phase) - phase)
        then = np.maximum(taken - (size - 0.5 * cycle), 0.0)
        return np.asarray(CubicSpline(truth.t, u)(then))

    return sensing(rig, wrench=stage)


def _resonance(rig: Rig, size: float, rng: Random) -> Rig:
    """Mount it softly, each axis of a mode and damping of its own; ``size``: 1 / mean mode."""
    modes = 2 * math.pi / size * np.exp(rng.uniform(-0.25, 0.25, 3))
    dampings = np.exp(rng.uniform(np.log(0.015), np.log(0.15), 3))

    def stage(truth: Any, f: Array, _: Random) -> Array:
        return np.hstack([second_order(f[:, j:j + 1], float(w), float(damping))
                          for j, (w, damping) in enumerate(zip(modes, dampings))])

    return sensing(rig, specific=stage)


def _saturation(rig: Rig, size: float, rng: Random) -> Rig:
    """Limit by Rapp's law, of another limit either way; ``size``: how far below usual peaks."""
    axis, power = int(rng.integers(3)), between(rng, 60.0, 250.0)
    limit = (1 - size) * (90.0, 90.0, 180.0)[axis]
    wider = rng.uniform(1.0, 1.15, 2)
    wider[int(rng.integers(2))] = 1.0

    def stage(truth: Any, u: Array, _: Random) -> Array:
        out = u.copy()
        x = u[:, axis] / (limit * np.where(u[:, axis] > 0, *wider))
        out[:, axis] = u[:, axis] * np.exp(-np.log1p(np.abs(x)**power) / power)
        return out

    return sensing(rig, wrench_reading=stage)


@njit(cache=True)
def _aged(dy, y, tool, rub):  # type: ignore[no-untyped-def]
    """Return dy/dt with friction that grows with how long it has rested (rate and state)."""
    v, age = dy[0], y[2]
    force = rub[0] * math.tanh(v / rub[1]) * (1.0 + rub[2] * math.log1p(max(age, 0.0) / rub[3]))
    force += rub[0] * rub[5] * v
    older = 1.0 - abs(v) * age / rub[4] if rub[0] > 0.0 else 0.0
    return (dy[0], dy[1] - force / tool.mass, older, dy[3], dy[4], dy[5], dy[6], dy[7])


@njit(cache=True)
def _slope(t, y, i, motion, tool, wall, rub):  # type: ignore[no-untyped-def]
    """Return dy/dt, and the screen's force in S."""
    x, v, a, R, omega, alpha = motion
    got = _balance(t, y, x[i], v[i], a[i], R[i], omega[i], alpha[i], tool, wall)
    return _aged(got[0], y, tool, rub), got[1]


@njit(cache=True)
def _rubbed(motion, tool, wall, rub, rest_steps):  # type: ignore[no-untyped-def]
    """Return slide, its speed and acceleration, and the screen's force in S."""
    count, h = (len(motion[0]) - 1) // 2, 2.0 * STEP
    out, y = np.empty((count, 6)), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for n in range(-rest_steps, count):
        t, i, on = n * h, max(2 * n, 0), 1 if n >= 0 else 0
        k1, contact = _slope(t, y, i, motion, tool, wall, rub)
        if n >= 0:
            out[n, 0], out[n, 1], out[n, 2] = y[0], y[1], k1[1]
            out[n, 3], out[n, 4], out[n, 5] = contact
        half = t + 0.5 * h
        k2, _ = _slope(half, _on(y, 0.5 * h, k1), i + on, motion, tool, wall, rub)
        k3, _ = _slope(half, _on(y, 0.5 * h, k2), i + on, motion, tool, wall, rub)
        k4, _ = _slope(t + h, _on(y, h, k3), i + 2 * on, motion, tool, wall, rub)
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


def _friction(rig: Rig, size: float, rng: Random) -> Rig:
    """Stick the more the longer it rested, and age anew as it slides; ``size``: when it slides."""
    rub = (size, between(rng, 1e-3, 4e-3), rng.uniform(0.05, 0.3), between(rng, 0.02, 0.3),
           between(rng, 5e-5, 1e-3), rng.uniform(0.0, 1.0))
    known: list[Any] = []

    def change(truth: Any) -> tuple[Array, ...]:
        if not known or known[0] is not truth:
            motion = tuple(follow(rig.robot, truth.commands))
            without, there = (_felt(rig, truth.motion, _rubbed(motion, rig.tool, rig.wall, one,
                                                               REST))
                              for one in ((0.0, *rub[1:]), rub))
            known[:] = [truth, tuple(a - b for a, b in zip(there, without))]
        found: tuple[Array, ...] = known[1]
        return found

    return sensing(rig, wrench=lambda truth, u, _: u + change(truth)[0],
                   specific=lambda truth, f, _: f + change(truth)[1],
                   slide=lambda truth, s, _: s + change(truth)[2])


FORMS: Mapping[str, Effect] = {one.name: one for one in (
    Effect('wrench_hysteresis', 'wrench_sensor', 0.02, 4.0, 'N', _hysteresis),
    Effect('tool_friction', 'tool', 0.05, 12.0, 'N', _friction),
    Effect('wrench_bias_drift', 'wrench_sensor', 0.02, 10.0, 'N', _drift),
    Effect('wrench_delay', 'wrench_sensor', 2e-5, 0.02, 's', _delay),
    Effect('wrench_saturation', 'wrench_sensor', 0.02, 0.5, '1', _saturation),
    Effect('accel_resonance', 'accelerometer', 1 / 350, 1 / 20, 's', _resonance))}
"""By name."""
