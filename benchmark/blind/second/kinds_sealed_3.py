"""The third sealed half of the kinds of discrepancies, and other forms of library effects."""

from collections.abc import Mapping
import math
from typing import Any

from blind.dynamics import _balance, _on, REST
from blind.effect import direction, Effect, sensing
from blind.rig import follow, Rig
from blind.robot import Array, STEP
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
    swung,
    tilted,
    unit,
    WRENCH_SCALE,
)
from numba import njit
import numpy as np

# mechanics


def _pile(rng: Random) -> Law:
    """Carry a chain that lies down on the floor: its weight by the height, none below."""
    low, width = rng.uniform(0.1, 0.6), rng.uniform(0.02, 0.1)
    place = rng.uniform(-0.15, 0.15, 3)

    def law(m: Moved) -> Added:
        z = m.position[:, 2] + (m.R @ place)[:, 2]
        floor = np.quantile(z, low)
        hung = width * np.logaddexp(0.0, (z - floor) / width)
        force = -m.up * hung[:, None]
        return added(m, force, np.cross(place, force))

    return law


def _bellows(rng: Random) -> Law:
    """Draw out a bellows fixed to the cell: gas that is compressed and let out, adiabatic."""
    way, stroke, place = unit(rng), rng.uniform(1.3, 3.0), rng.uniform(-0.1, 0.1, 3)

    def law(m: Moved) -> Added:
        x = (m.position - m.position[0]) @ way
        share = x / (stroke * max(1e-3, float(np.abs(x).max())))
        force = m.in_sensor(np.outer((1 + share) ** -1.4 - 1, way))
        return added(m, force, np.cross(place, force))

    return law


def _half_full(rng: Random) -> Law:
    """Hold a vessel half full: the middle of its content by products of the tilts of the level."""
    a, b = unit(rng), unit(rng)
    share = rng.uniform(0.2, 0.8)

    def law(m: Moved) -> Added:
        up = m.force / np.linalg.norm(m.force, axis=1, keepdims=True)
        x, y = up @ a, up @ b
        at = np.outer(x * y, a) + share * np.outer(x * x - y * y, b)
        return added(m, torque=np.cross(at - at[0], -m.force))

    return law


def _flow(rng: Random) -> Law:
    """Be flown through: Coriolis' force on a stream that is turned on and off."""
    way, place = unit(rng), rng.uniform(-0.2, 0.2, 3)
    on, width, off = rng.uniform(0.0, 0.3), rng.uniform(0.01, 0.06), rng.uniform(0.7, 1.2)

    def law(m: Moved) -> Added:
        x = m.t / m.t[-1]
        course = 0.5 * (np.tanh((x - on) / width) - np.tanh((x - off) / width))
        force = np.cross(m.omega, way) * course[:, None]
        return added(m, force, np.cross(place, force))

    return law


@njit(cache=True)
def _sealed(turn, width, power):  # type: ignore[no-untyped-def]
    """Return a torque vector that follows turning and saturates (a rubber seal)."""
    z = np.zeros_like(turn)
    for n in range(1, len(turn)):
        step = turn[n] - turn[n - 1]
        size = np.sqrt(np.sum(z[n - 1] ** 2)) / width
        path = np.sqrt(np.sum(step**2))
        new = z[n - 1] + step - path * size ** (power - 1.0) * z[n - 1] / width
        much = np.sqrt(np.sum(new**2)) / width
        z[n] = new if much < 1.0 else new / much
    return z


def _lip_seal(rng: Random) -> Law:
    """Turn in a rubber seal: a torque that builds up over some degrees and saturates."""
    width, power, mix = between(rng, 0.03, 0.3), rng.uniform(1.0, 3.0), rng.uniform(0.3, 1.0, 3)

    def law(m: Moved) -> Added:
        path = np.cumsum(m.omega * m.dt, axis=0)
        return added(m, torque=-mix * _sealed(path, width, power))

    return law


def _gusts(rng: Random) -> Law:
    """Stand in a draught: gusts (1 - cos) at instants of their own, from about one side."""
    seed, many = int(rng.integers(2**32)), int(rng.integers(2, 9))
    side, place = unit(rng), rng.uniform(-0.2, 0.2, 3)

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        force = np.zeros((len(m.t), 3))
        for _ in range(many):
            way = side + 0.4 * own.standard_normal(3)
            long = float(np.exp(own.uniform(np.log(0.3), np.log(4.0))))
            x = (m.t - own.uniform(0.0, 0.9) * m.t[-1]) / long
            force += np.outer(np.where((x > 0) & (x < 1), 1 - np.cos(2 * math.pi * x), 0.0), way)
        force = m.in_sensor(force)
        return added(m, force, np.cross(place, force))

    return law


def _dosing(rng: Random) -> Law:
    """Give off mass in doses: what it weighs and where that hangs, by how much is left."""
    place, doses = rng.uniform(-0.15, 0.15, 3), int(rng.integers(2, 7))
    share, first = rng.uniform(0.3, 1.0), rng.uniform(0.0, 0.2)

    def law(m: Moved) -> Added:
        x = np.clip((m.t / m.t[-1] - first) / (1 - first), 0.0, 1.0) * doses
        k = np.floor(x)
        given = (k + np.clip((x - k) / share, 0.0, 1.0)) / doses
        force = m.force * given[:, None]
        return added(m, force, np.cross(place, force))

    return law


@njit(cache=True)
def _clipped(x, most, left):  # type: ignore[no-untyped-def]
    """Follow until it slips, and then begin anew from a share of it."""
    out, at = np.zeros(len(x)), x[0]
    for n in range(len(x)):
        d = x[n] - at
        if d > most or d < -most:
            at = x[n] - left * d
            d = x[n] - at
        out[n] = d
    return out


def _slipping_clip(rng: Random) -> Law:
    """Pull a cable through a clip that holds and slips: saws of the turn about an axis."""
    axis, pull, most = unit(rng), unit(rng), between(rng, 0.05, 0.3)
    left, place = rng.uniform(0.0, 0.5), rng.uniform(-0.15, 0.15, 3)

    def law(m: Moved) -> Added:
        x = lagged(_clipped(m.turned @ axis, most, left), m.dt, 0.004)
        force = np.outer(-x / most, pull)
        return added(m, force, np.cross(place, force))

    return law


@njit(cache=True)
def _selfkept(push, w, grow, kick, dt):  # type: ignore[no-untyped-def]
    """Return a van der Pol oscillation that the motion pushes."""
    out, x, v = np.empty(len(push)), 0.02, 0.0
    for n in range(len(push)):
        v += dt * (w * (grow * (1.0 - x * x) * v - w * x) + kick * w * w * push[n])
        x += dt * v
        x = min(max(x, -4.0), 4.0)
        v = min(max(v, -4.0 * w), 4.0 * w)
        out[n] = x
    return out


def _flutter(rng: Random) -> Law:
    """Flutter: an oscillation that keeps itself, and that acceleration disturbs."""
    hz, grow, kick = between(rng, 2.0, 14.0), between(rng, 0.02, 0.4), rng.uniform(0.0, 0.05)
    way, out, place = unit(rng), unit(rng), rng.uniform(-0.2, 0.2, 3)

    def law(m: Moved) -> Added:
        push = (m.force - m.force.mean(axis=0)) @ way
        x = _selfkept(push, 2 * math.pi * hz, grow, kick, m.dt)
        force = np.outer(x, out)
        return added(m, force, np.cross(place, force))

    return law


def _wet_film(rng: Random) -> Law:
    """Squeeze a film on the screen: held back as it leaves, for a short while."""
    time, place = between(rng, 0.01, 0.08), rng.uniform(0.0, 0.2, 3)
    mix = rng.uniform(0.3, 1.0)

    def law(m: Moved) -> Added:
        late = lagged(m.contact, m.dt, time) - lagged(m.contact, m.dt, 0.2 * time)
        load = np.linalg.norm(m.contact, axis=1, keepdims=True)
        force = -late * (mix + (1 - mix) * np.exp(-load / 5.0))
        return added(m, force, np.cross(place, force))

    return law


def _ribbed_screen(rng: Random) -> Law:
    """Slide over ribs: contact by where it touches, and aside on their flanks."""
    along, pitch = unit(rng) * [0.1, 1.0, 1.0], between(rng, 0.004, 0.05)
    phase, flank = rng.uniform(0, 2 * math.pi), rng.uniform(0.0, 0.6)

    def law(m: Moved) -> Added:
        x = 2 * math.pi / pitch * ((m.position - m.position[0]) @ along) + phase
        normal = np.linalg.norm(m.contact, axis=1)
        aside = m.in_sensor(np.outer(flank * normal * np.cos(x), along))
        force = m.contact * np.sin(x)[:, None] + aside
        return added(m, force, np.cross([0.2, 0.0, 0.1], force))

    return law


def _foam(rng: Random) -> Law:
    """Press into foam: contact relaxes over two times and is slow to come back."""
    fast, slow, share = between(rng, 0.1, 0.5), between(rng, 1.0, 6.0), rng.uniform(0.2, 0.8)

    def law(m: Moved) -> Added:
        gone = share * lagged(m.contact, m.dt, fast) + (1 - share) * lagged(m.contact, m.dt, slow)
        touching = np.linalg.norm(m.contact, axis=1, keepdims=True)
        force = -gone * touching / (touching + 1.0)
        return added(m, force, np.cross([0.2, 0.0, 0.1], force))

    return law


# electronics


def _gain_beat(rng: Random) -> Law:
    """Excite a bridge by a supply that beats: gains that swell and fade, one phase each."""
    hz, gain = between(rng, 0.15, 4.0), unit(rng, 6)
    phase = rng.uniform(0, 2 * math.pi, (2, 6))

    def law(m: Moved) -> Added:
        swell = np.sin(2 * math.pi * hz * m.t[:, None] + phase[m.index])
        return in_wrench(m, gain * swell * m.wrench)

    return law


def _gain_pops(rng: Random) -> Law:
    """Have a bad joint in a bridge: a gain that falls for a while at random instants."""
    seed, long, rest = int(rng.integers(2**32)), between(rng, 0.1, 2.0), between(rng, 0.5, 4.0)
    gain = np.zeros(6)
    gain[rng.permutation(6)[:int(rng.integers(1, 4))]] = 1.0

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        ends = np.cumsum(own.exponential(np.tile([rest, long], 300)))
        low = lagged((np.searchsorted(ends, m.t) % 2).astype(float), m.dt, 0.006)
        return in_wrench(m, -gain * low[:, None] * m.wrench)

    return law


def _convection(rng: Random) -> Law:
    """Warm from below: a bias by the direction of up, seconds late."""
    time, mix = between(rng, 1.0, 12.0), rng.standard_normal((3, 6)) * WRENCH_SCALE

    def law(m: Moved) -> Added:
        heat = lagged(lagged(m.up, m.dt, time), m.dt, 0.4 * time)
        return in_wrench(m, (heat - heat[0]) @ mix)

    return law


def _thermostat(rng: Random) -> Law:
    """Sit beside a heater with a thermostat: a bias that rises and falls in exponentials."""
    period, share = between(rng, 3.0, 15.0), rng.uniform(0.2, 0.7)
    phase, out = rng.uniform(0, 1, 2), unit(rng, 6) * WRENCH_SCALE
    time = rng.uniform(0.1, 0.5)

    def law(m: Moved) -> Added:
        on = ((m.t / period + phase[m.index]) % 1.0 < share).astype(float)
        heat = lagged(on, m.dt, time * period)
        return in_wrench(m, np.outer(heat - heat[0], out))

    return law


def _log_amplifier(rng: Random) -> Law:
    """Compress by a logarithm: what is small reads too large and what is large too small."""
    knee, gain = between(rng, 0.03, 0.3), rng.uniform(0.2, 1.0, 6)

    def law(m: Moved) -> Added:
        x = m.wrench / (m.load * np.repeat([1.0, 0.2], 3))
        y = np.sign(x) * np.log1p(np.abs(x) / knee) / math.log1p(1 / knee)
        return in_wrench(m, gain * WRENCH_SCALE * (y - x))

    return law


def _tacho_bleed(rng: Random) -> Law:
    """Bleed from tachometers: each rate of turning in the wrench, rising slower when fast."""
    fast, mix = between(rng, 0.1, 1.0), rng.standard_normal((3, 6)) * WRENCH_SCALE
    late = between(rng, 0.002, 0.03)

    def law(m: Moved) -> Added:
        x = m.omega / (fast + np.abs(m.omega))
        return in_wrench(m, lagged(x, m.dt, late) @ mix)

    return law


def _scanned(rng: Random) -> Law:
    """Convert one channel after the other with a slow multiplexer: each later than the last."""
    order = rng.permutation(6).astype(float) + 1.0
    late = between(rng, 5e-4, 3e-3)

    def law(m: Moved) -> Added:
        then = np.stack([np.interp(m.t - late * k, m.t, x) for k, x in zip(order, m.wrench.T)],
                        axis=1)
        return in_wrench(m, then - m.wrench)

    return law


@njit(cache=True)
def _levelled(x, up, down):  # type: ignore[no-untyped-def]
    out, at = np.empty(len(x)), x[0]
    for n in range(len(x)):
        at += (up if x[n] > at else down) * (x[n] - at)
        out[n] = at
    return out


def _auto_gain(rng: Random) -> Law:
    """Level a gain by what was measured: down at once, up again over seconds."""
    up, down, gain = between(rng, 0.01, 0.1), between(rng, 0.5, 6.0), rng.uniform(0.2, 1.0, 6)

    def law(m: Moved) -> Added:
        size = np.linalg.norm(m.wrench[:, :3], axis=1) / m.load
        level = _levelled(size, 1 - math.exp(-m.dt / up), 1 - math.exp(-m.dt / down))
        return in_wrench(m, -gain * (level - level.mean())[:, None] * m.wrench)

    return law


@njit(cache=True)
def _stops(x, width):  # type: ignore[no-untyped-def]
    z = np.zeros_like(x)
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            z[n, j] = min(max(z[n - 1, j] + x[n, j] - x[n - 1, j], -width[j]), width[j])
    return z


def _accel_stiction(rng: Random) -> Law:
    """Stick in the accelerometer's pivots: two stops of other widths."""
    widths, gain = np.exp(rng.uniform(np.log(0.05), np.log(3.0), (2, 3))), unit(rng)

    def law(m: Moved) -> Added:
        x = lagged(m.force, m.dt, 0.01)
        return added(m, accel=-gain * sum(_stops(x, one) / one for one in widths))

    return law


def _accel_spin(rng: Random) -> Law:
    """Take turning for acceleration: rates and their sizes in all axes."""
    mix, odd = rng.standard_normal((3, 3)), rng.uniform(0.0, 1.0)

    def law(m: Moved) -> Added:
        fast = np.linalg.norm(m.omega, axis=1, keepdims=True)
        return added(m, accel=(m.omega * (1 + odd * fast)) @ mix)

    return law


def _accel_jerk(rng: Random) -> Law:
    """Slew in the accelerometer's amplifier: by the root of how fast what it feels changes."""
    time, gain = between(rng, 0.005, 0.03), rng.uniform(0.2, 1.0, 3)

    def law(m: Moved) -> Added:
        rate = (m.force - lagged(m.force, m.dt, time)) / time
        return added(m, accel=-gain * rate / np.sqrt(1.0 + np.abs(rate)))

    return law


# mounting


def _rocking_seat(rng: Random) -> Law:
    """Rock on a seat that is not flat: the sensor's axes lean one way or the other by a moment."""
    arm, lean, sharp = unit(rng), unit(rng), between(rng, 0.02, 0.3)
    middle = rng.uniform(-0.3, 0.3)

    def law(m: Moved) -> Added:
        moment = m.wrench[:, 3:] @ arm
        x = (moment - moment.mean()) / max(1e-9, float(moment.std()))
        turn = np.outer(lagged(np.tanh((x - middle) / sharp), m.dt, 0.01), lean)
        return added(m, np.cross(m.wrench[:, :3], turn), np.cross(m.wrench[:, 3:], turn))

    return law


def _uneven_ring(rng: Random) -> Law:
    """Turn on a base ring that is not flat: base tilts by the second and third of the heading."""
    sizes = rng.standard_normal((2, 2, 2))

    def law(m: Moved) -> Added:
        forward = m.R[:, :, 0] + 0.3 * m.R[:, :, 1]
        yaw = np.arctan2(forward[:, 1], forward[:, 0])
        tilt = np.zeros((len(m.t), 3))
        for k, both in zip((2, 3), sizes):
            wave = np.stack([np.cos(k * yaw), np.sin(k * yaw)], axis=1) @ both
            tilt[:, :2] += np.hypot(forward[:, 0], forward[:, 1])[:, None] * wave / k
        return tilted(m, m.in_sensor(tilt - tilt[0]))

    return law


def _wrist_play(rng: Random) -> Law:
    """Have play in the last joint: the tool lies on either side by its weight's moment."""
    axis, wide = unit(rng), between(rng, 0.3, 3.0)
    lag = between(rng, 0.01, 0.1)

    def law(m: Moved) -> Added:
        moment = np.cross(m.com, -m.mass * m.force) @ axis
        x = moment / max(1e-9, float(np.abs(moment).std()))
        side = lagged(_stops(np.ascontiguousarray(x[:, None]), np.array([wide * 0.3]))[:, 0],
                      m.dt, lag)
        return tilted(m, np.outer(side, axis))

    return law


def _rung_base(rng: Random) -> Law:
    """Stand on air springs: base swings out slowly after it was pushed, other phases each time."""
    hz, time = between(rng, 0.4, 3.0), between(rng, 2.0, 12.0)
    ways = rng.standard_normal((2, 3)) * [1.0, 1.0, 0.0]
    phase = rng.uniform(0, 2 * math.pi, (2, 2))

    def law(m: Moved) -> Added:
        x = 2 * math.pi * hz * m.t[:, None] * [1.0, 1.23] + phase[m.index]
        tilt = (np.exp(-m.t / time)[:, None] * np.sin(x)) @ ways
        return tilted(m, m.in_sensor(tilt))

    return law


def _driven_floor(rng: Random) -> Law:
    """Share a floor with what the robot's own turning shakes: a soft mode driven by alpha."""
    hz, damping = between(rng, 1.0, 7.0), between(rng, 0.03, 0.3)
    drive, way = unit(rng), unit(rng) * [1.0, 1.0, 0.3]

    def law(m: Moved) -> Added:
        x = lagged(m.alpha, m.dt, 0.01) @ drive
        y = swung(np.tanh(x / max(1e-9, float(x.std()))), m.dt, hz, damping)
        return tilted(m, m.in_sensor(np.outer(y, way)))

    return law


_PLACE, _CONTACT, _ACCEL = (frozenset({one}) for one in ('position', 'contact', 'accel'))

KINDS: Mapping[str, Kind] = {
    'pile': Kind(_pile, ('cable_force',), _PLACE),
    'bellows': Kind(_bellows, ('cable_force',), _PLACE),
    'half_full': Kind(_half_full, ('tool_com',)), 'flow': Kind(_flow),
    'lip_seal': Kind(_lip_seal), 'gusts': Kind(_gusts),
    'dosing': Kind(_dosing, ('tool_mass', 'wrench_gain')),
    'slipping_clip': Kind(_slipping_clip),
    'flutter': Kind(_flutter, ('spindle_vibration',)),
    'wet_film': Kind(_wet_film, ('contact_damping',), _CONTACT),
    'ribbed_screen': Kind(_ribbed_screen, (), _CONTACT | _PLACE),
    'foam': Kind(_foam, ('contact_stiffness', 'contact_damping'), _CONTACT),
    'gain_beat': Kind(_gain_beat, ('wrench_gain',)),
    'gain_pops': Kind(_gain_pops, ('wrench_gain',)),
    'convection': Kind(_convection, ('wrench_gain', 'tool_com', 'wrench_bias_drift')),
    'thermostat': Kind(_thermostat, ('wrench_bias_drift',)),
    'log_amplifier': Kind(_log_amplifier, ('wrench_gain',)),
    'tacho_bleed': Kind(_tacho_bleed),
    'scanned': Kind(_scanned, ('wrench_delay', 'wrench_lowpass')),
    'auto_gain': Kind(_auto_gain, ('wrench_gain',)),
    'accel_stiction': Kind(_accel_stiction, (), _ACCEL),
    'accel_spin': Kind(_accel_spin, (), _ACCEL),
    'accel_jerk': Kind(_accel_jerk, ('accel_delay', 'accel_resonance'), _ACCEL),
    'rocking_seat': Kind(_rocking_seat), 'uneven_ring': Kind(_uneven_ring, ('base_tilt',)),
    'wrist_play': Kind(_wrist_play), 'rung_base': Kind(_rung_base),
    'driven_floor': Kind(_driven_floor)}
"""By name."""


# other forms of library effects

@njit(cache=True)
def _coleman(x, width, curve):  # type: ignore[no-untyped-def]
    """Follow Coleman and Hodgdon: towards a curve, at a rate of how far it goes."""
    z = np.zeros_like(x)
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            step = x[n, j] - x[n - 1, j]
            towards = curve * math.tanh(x[n, j] / (3.0 * width[j])) * width[j]
            new = z[n - 1, j] + step * (1.0 - curve)
            new += abs(step) * (towards - z[n - 1, j]) / width[j]
            z[n, j] = min(max(new, -1.5 * width[j]), 1.5 * width[j])
    return z


def _hysteresis(rig: Rig, size: float, rng: Random) -> Rig:
    """Add a loop about a curve of its own; ``size`` is its half height."""
    scale = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    widths, curve = scale * rng.uniform(4.0, 18.0), rng.uniform(0.1, 0.4)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        return np.asarray(u + size * scale * _coleman(u, widths, curve) / widths)

    return sensing(rig, wrench=stage)


def _drift(rig: Rig, size: float, rng: Random) -> Rig:
    """Drift by the logarithm of the time, and another way along an S."""
    first, second = (np.concatenate([direction(rng), 0.05 * direction(rng)]) for _ in range(2))
    time, middle, width = between(rng, 0.3, 6.0), rng.uniform(0.2, 0.8), rng.uniform(0.05, 0.3)
    turn = rng.uniform(0.0, 0.6)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        x = truth.t / truth.t[-1]
        rise = np.log1p(truth.t / time) / math.log1p(float(truth.t[-1]) / time)
        bend = 0.5 * (np.tanh((x - middle) / width) - math.tanh(-middle / width))
        return np.asarray(u + size * (np.outer(rise, first) + turn * np.outer(bend, second)))

    return sensing(rig, wrench=stage)


def _lowpass(rig: Rig, size: float, rng: Random) -> Rig:
    """Pass three first orders in turn; ``size`` is the delay of all of them."""
    shares = rng.dirichlet([2.0, 2.0, 2.0])

    def stage(truth: Any, u: Array, _: Random) -> Array:
        fine = float(truth.t[1] - truth.t[0])
        late = u
        for share in shares:
            late = lagged(late, fine, max(1e-7, size * float(share)))
        return np.asarray(late)

    return sensing(rig, wrench=stage)


def _crosstalk(rig: Rig, size: float, rng: Random) -> Rig:
    """Bolt the sensor on turned: forces and torques in axes a rotation vector away."""
    x, y, z = size * direction(rng)
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

    def stage(truth: Any, u: Array, _: Random) -> Array:
        return np.hstack([u[:, :3] + u[:, :3] @ turn.T, u[:, 3:] + u[:, 3:] @ turn.T])

    return sensing(rig, wrench=stage)


def _highpass(rig: Rig, size: float, rng: Random) -> Rig:
    """Leak in two stages of other rates, from the reset on; ``size`` is the sum of both."""
    share = rng.uniform(0.15, 0.5)

    def stage(truth: Any, f: Array, _: Random) -> Array:
        fine = float(truth.t[1] - truth.t[0])
        out = f
        for part in (share, 1 - share):
            kept = np.vstack([np.zeros((1, 3)), out])
            out = out - lagged(kept, fine, 1 / (size * part))[1:]
        return np.asarray(out)

    return sensing(rig, specific=stage)


@njit(cache=True)
def _worn(t, dy, y, rest, tool, rub):  # type: ignore[no-untyped-def]
    """Return dy/dt with friction that ripples along the guide and runs in."""
    force = rub[0] * math.tanh(dy[0] / rub[1])
    force *= 1.0 + rub[2] * math.cos(6.283185307179586 * y[0] / rub[3] + rub[4])
    force *= 1.0 + rub[5] * math.exp(-max(t, 0.0) / rub[6])
    less = force / tool.mass
    return (dy[0], dy[1] - less, dy[2], dy[3], dy[4], dy[5], dy[6], dy[7]), less


@njit(cache=True)
def _slope(t, y, i, motion, tool, wall, rub):  # type: ignore[no-untyped-def]
    x, v, a, R, omega, alpha = motion
    got = _balance(t, y, x[i], v[i], a[i], R[i], omega[i], alpha[i], tool, wall)
    return _worn(t, got[0], y, got[4], tool, rub)[0]


@njit(cache=True)
def _next(t, y, i, j, k, motion, tool, wall, rub):  # type: ignore[no-untyped-def]
    h = 2.0 * STEP
    k1 = _slope(t, y, i, motion, tool, wall, rub)
    k2 = _slope(t + 0.5 * h, _on(y, 0.5 * h, k1), j, motion, tool, wall, rub)
    k3 = _slope(t + 0.5 * h, _on(y, 0.5 * h, k2), j, motion, tool, wall, rub)
    k4 = _slope(t + h, _on(y, h, k3), k, motion, tool, wall, rub)
    return _on(_on(_on(_on(y, h / 6.0, k1), h / 3.0, k2), h / 3.0, k3), h / 6.0, k4)


@njit(cache=True)
def _rubbed(motion, tool, wall, rub, rest_steps):  # type: ignore[no-untyped-def]
    """Return slide, its speed and acceleration, and the screen's force in S."""
    count, h = (len(motion[0]) - 1) // 2, 2.0 * STEP
    out = np.empty((count, 6))
    y = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for n in range(-rest_steps, 0):
        y = _next(n * h, y, 0, 0, 0, motion, tool, wall, rub)
    for n in range(count):
        i = 2 * n
        x, v, a, R, omega, alpha = motion
        got = _balance(n * h, y, x[i], v[i], a[i], R[i], omega[i], alpha[i], tool, wall)
        dy, _ = _worn(n * h, got[0], y, got[4], tool, rub)
        out[n, 0], out[n, 1], out[n, 2] = y[0], y[1], dy[1]
        out[n, 3], out[n, 4], out[n, 5] = got[1]
        y = _next(n * h, y, i, i + 1, i + 2, motion, tool, wall, rub)
    return out


def _change(rig: Rig, truth: Any, rub: tuple[float, ...]) -> tuple[Array, Array, Array]:
    """Return what friction changes of wrench, specific force and slide."""
    motion = follow(rig.robot, truth.commands)
    plain, rubbed = (_rubbed(tuple(motion), rig.tool, rig.wall, one, REST)
                     for one in ((0.0, *rub[1:]), rub))
    s, ds, dds = (rubbed - plain)[:, :3].T
    contact = rubbed[:, 3:] - plain[:, 3:]
    m, tool, along = truth.motion, rig.tool, np.array([1.0, 0.0, 0.0])
    shift = np.outer(s, along)
    more = np.outer(dds, along) + 2 * np.cross(m.omega, np.outer(ds, along)) + np.cross(
        m.alpha, shift) + np.cross(m.omega, np.cross(m.omega, shift))
    felt = np.einsum('nji,nj->ni', m.R, m.acceleration - tool.gravity)
    r = tool.com + np.outer(plain[:, 0], along)
    turning = np.cross(m.alpha, r) + np.cross(m.omega, np.cross(m.omega, r))
    moving = felt + turning + 2 * np.cross(m.omega, np.outer(plain[:, 1], along)) + np.outer(
        plain[:, 2], along)
    tip = rig.wall.tip + np.outer(plain[:, 0], along)
    force = contact - tool.mass * more
    torque = (np.cross(tip + shift, contact) + np.cross(shift, plain[:, 3:])
              - tool.mass * (np.cross(r + shift, more) + np.cross(shift, moving)))
    return np.hstack([force, torque]), more, s


def _friction(rig: Rig, size: float, rng: Random) -> Rig:
    """Rub in a guide that is uneven along its way, and that runs in."""
    rub = (size, between(rng, 1e-3, 6e-3), rng.uniform(0.1, 0.5), between(rng, 3e-3, 1.5e-2),
           rng.uniform(0, 2 * math.pi), rng.uniform(0.0, 0.8), between(rng, 3.0, 15.0))
    known: list[Any] = []

    def change(truth: Any) -> tuple[Array, Array, Array]:
        if not known or known[0] is not truth:
            known[:] = [truth, _change(rig, truth, rub)]
        found: tuple[Array, Array, Array] = known[1]
        return found

    return sensing(rig, wrench=lambda truth, u, _: u + change(truth)[0],
                   specific=lambda truth, f, _: f + change(truth)[1],
                   slide=lambda truth, s, _: s + change(truth)[2])


FORMS: Mapping[str, Effect] = {one.name: one for one in (
    Effect('wrench_hysteresis', 'wrench_sensor', 0.02, 4.0, 'N', _hysteresis),
    Effect('tool_friction', 'tool', 0.05, 12.0, 'N', _friction),
    Effect('wrench_bias_drift', 'wrench_sensor', 0.02, 10.0, 'N', _drift),
    Effect('wrench_lowpass', 'wrench_sensor', 5e-5, 0.03, 's', _lowpass),
    Effect('wrench_crosstalk', 'wrench_sensor', 3e-4, 0.1, '1', _crosstalk),
    Effect('accel_highpass', 'accelerometer', 2e-5, 1.0, '1/s', _highpass))}
"""By name."""
