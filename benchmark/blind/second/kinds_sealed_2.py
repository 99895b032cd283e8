"""The second sealed half of the kinds of discrepancies, and other forms of library effects."""

from collections.abc import Mapping
import math
from typing import Any

from blind.dynamics import _balance, _on, REST
from blind.effect import direction, Effect, sensing
from blind.effects_sensing import delayed
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
from scipy.ndimage import uniform_filter1d
from scipy.special import erfc

# mechanics

def _pump_pulse(rng: Random) -> Law:
    """Carry a hose in which a pump's pressure rises slowly and falls at once."""
    hz, fall, way = between(rng, 0.6, 4.0), rng.uniform(0.05, 0.3), unit(rng)
    place, phase = rng.uniform(-0.15, 0.15, 3), rng.uniform(0, 1, 2)

    def law(m: Moved) -> Added:
        x = (hz * m.t + phase[m.index]) % 1.0
        pulse = np.where(x < 1 - fall, 1 - np.exp(-3 * x / (1 - fall)),
                         (1 - math.exp(-3)) * (1 - x) / fall)
        force = np.outer(lagged(pulse, m.dt, 0.01), way)
        return added(m, force, np.cross(place, force))

    return law


def _loose_mass(rng: Random) -> Law:
    """Hold a part by friction: it pushes only with what exceeds a threshold."""
    way, threshold = unit(rng), rng.uniform(1.0, 7.0)
    place = rng.uniform(-0.1, 0.1, 3)

    def law(m: Moved) -> Added:
        x = m.force @ way
        beyond = np.sign(x) * np.maximum(np.abs(x) - threshold, 0.0)
        force = np.outer(-beyond, way)
        return added(m, force, np.cross(place, force))

    return law


def _spun_fluid(rng: Random) -> Law:
    """Turn a vessel whose content is dragged along by its walls: two lags of the turning."""
    times, size = (between(rng, 0.05, 0.3), between(rng, 0.3, 2.0)), rng.uniform(0.3, 1.0, 3)

    def law(m: Moved) -> Added:
        slip = sum(m.omega - lagged(m.omega, m.dt, time) for time in times)
        return added(m, torque=-size * slip)

    return law


def _capstan(rng: Random) -> Law:
    """Wrap a line about a post: its pull grows exponentially with the angle."""
    axis, pull, grip = unit(rng), unit(rng), rng.uniform(1.0, 3.0)
    place = rng.uniform(-0.15, 0.15, 3)

    def law(m: Moved) -> Added:
        force = np.outer(np.expm1(grip * np.clip(m.turned @ axis, -2.0, 2.0)), pull)
        return added(m, force, np.cross(place, force))

    return law


def _detent(rng: Random) -> Law:
    """Turn over detents: a torque that repeats many times a turn, steeper on one side."""
    axis, order = unit(rng), between(rng, 8.0, 40.0)
    skew, phase = rng.uniform(0.0, 0.5), rng.uniform(0, 2 * math.pi)

    def law(m: Moved) -> Added:
        x = order * (m.turned @ axis) + phase
        return added(m, torque=np.outer(np.sin(x + skew * np.sin(x)), axis))

    return law


def _end_strap(rng: Random) -> Law:
    """Draw a strap tight beyond an angle, and leave it slack before."""
    axis, pull, slack = unit(rng), unit(rng), rng.uniform(0.0, 0.2)
    place = rng.uniform(-0.2, 0.2, 3)

    def law(m: Moved) -> Added:
        force = np.outer(np.maximum(0.0, m.turned @ axis - slack), pull)
        return added(m, force, np.cross(place, force))

    return law


def _magnet(rng: Random) -> Law:
    """Pass a magnet: it draws towards a place in base, by the cube of the distance."""
    off, place = between(rng, 0.15, 0.6) * unit(rng), rng.uniform(-0.1, 0.1, 3)

    def law(m: Moved) -> Added:
        middle = m.position.mean(axis=0)
        line = middle + off - m.position - np.einsum('nij,j->ni', m.R, place)
        far = np.sqrt(np.sum(line**2, axis=1, keepdims=True) + 0.05**2)
        force = m.in_sensor(line / far**4)
        return added(m, force, np.cross(place, force))

    return law


def _eddy_brake(rng: Random) -> Law:
    """Brake by eddy currents: a drag that falls again beyond a speed, along a rail in base."""
    rail, fast, place = unit(rng), between(rng, 0.02, 0.2), rng.uniform(-0.2, 0.2, 3)

    def law(m: Moved) -> Added:
        v = m.velocity @ rail / fast
        force = m.in_sensor(np.outer(-2 * v / (1 + v**2), rail))
        return added(m, force, np.cross(place, force))

    return law


def _impact_ring(rng: Random) -> Law:
    """Ring after an impact: a mode behind the tip that contact excites."""
    hz, damping = between(rng, 20.0, 90.0), between(rng, 0.01, 0.08)
    place, mix = rng.uniform(0.0, 0.2, 3), rng.uniform(0.2, 1.0, 3)

    def law(m: Moved) -> Added:
        force = mix * (swung(m.contact, m.dt, hz, damping) - m.contact)
        return added(m, force, np.cross(place, force))

    return law


def _curved_screen(rng: Random) -> Law:
    """Press on a screen that is not plane: the force leans by where it is touched."""
    lean = rng.standard_normal((3, 3)) * [1.0, 0.3, 1.0]

    def law(m: Moved) -> Added:
        normal = np.linalg.norm(m.contact, axis=1) > 0.1
        where = (m.position - m.position[0]) @ lean
        force = np.cross(m.in_sensor(where), m.contact) * normal[:, None]
        return added(m, force, np.cross([0.2, 0.0, 0.1], force))

    return law


# electronics

def _fan_runup(rng: Random) -> Law:
    """Hear a fan that runs up: a line whose frequency settles."""
    hz, low = between(rng, 15.0, 70.0), rng.uniform(0.3, 0.8)
    time, out = between(rng, 1.0, 8.0), unit(rng, 6) * WRENCH_SCALE
    phase = rng.uniform(0, 2 * math.pi, 2)

    def law(m: Moved) -> Added:
        angle = 2 * math.pi * hz * (m.t - (1 - low) * time * -np.expm1(-m.t / time))
        return in_wrench(m, np.outer(np.sin(angle + phase[m.index]), out))

    return law


def _telegraph(rng: Random) -> Law:
    """Pop between two levels at random (a bad contact), other instants in each recording."""
    seed, up, down = int(rng.integers(2**32)), between(rng, 0.1, 1.0), between(rng, 0.3, 3.0)
    out = unit(rng, 6) * WRENCH_SCALE

    def law(m: Moved) -> Added:
        own = np.random.default_rng([seed, m.index])
        lengths = own.exponential(np.tile([down, up], 400))
        state = np.searchsorted(np.cumsum(lengths), m.t) % 2
        return in_wrench(m, np.outer(lagged(state.astype(float), m.dt, 0.004), out))

    return law


def _supply_dip(rng: Random) -> Law:
    """Share a supply with the drives: gains that dip by how fast it turns, with a lag."""
    gain, time = unit(rng, 6), between(rng, 0.02, 0.5)

    def law(m: Moved) -> Added:
        effort = lagged(np.linalg.norm(m.omega, axis=1), m.dt, time)
        return in_wrench(m, -effort[:, None] * gain * m.wrench)

    return law


def _dead_band(rng: Random) -> Law:
    """Swallow what is small: distortion where an amplifier crosses zero."""
    width, out = between(rng, 0.02, 0.15), rng.uniform(0.2, 1.0, 6)

    def law(m: Moved) -> Added:
        x = m.wrench / (m.load * np.repeat([width, 0.2 * width], 3))
        return in_wrench(m, -out * WRENCH_SCALE * x * np.exp(-0.5 * x**2))

    return law


def _two_slopes(rng: Random) -> Law:
    """Read pushes and pulls with other gains, about the load that it was tared at."""
    gain = unit(rng, 6)
    return lambda m: in_wrench(m, gain * np.abs(m.wrench - m.wrench.mean(axis=0)))


def _coil_talk(rng: Random) -> Law:
    """Couple channels by induction: the rate of one force in the others, low-passed."""
    source, time, out = int(rng.integers(3)), between(rng, 0.01, 0.1), unit(rng, 6) * WRENCH_SCALE
    out[source] = 0.0

    def law(m: Moved) -> Added:
        x = m.wrench[:, source]
        return in_wrench(m, np.outer((x - lagged(x, m.dt, time)) / time, out))

    return law


def _motor_heat(rng: Random) -> Law:
    """Heat the bridge by the motor beside it: a bias by the work that has been done, leaking."""
    out, time = unit(rng, 6) * WRENCH_SCALE, between(rng, 3.0, 30.0)

    def law(m: Moved) -> Added:
        a = math.exp(-m.dt / time)
        power = np.sum(m.omega**2, axis=1)
        return in_wrench(m, np.outer(_leaky(power * m.dt, a), out))

    return law


@njit(cache=True)
def _leaky(x, a):  # type: ignore[no-untyped-def]
    out, total = np.empty(len(x)), 0.0
    for n in range(len(x)):
        total = a * total + x[n]
        out[n] = total
    return out


def _accel_memory(rng: Random) -> Law:
    """Remember what was felt: the accelerometer relaxes over a second or so."""
    time, gain = between(rng, 0.2, 3.0), rng.uniform(0.2, 1.0, 3)
    return lambda m: added(m, accel=gain * (lagged(m.force, m.dt, time) - m.force))


def _accel_segments(rng: Random) -> Law:
    """Convert acceleration in segments, each of a slope of its own."""
    at, off = np.linspace(-25.0, 25.0, 14), rng.standard_normal((3, 14))

    def law(m: Moved) -> Added:
        return added(m, accel=np.stack([np.interp(f, at, o) for f, o in zip(m.force.T, off)],
                                       axis=1))

    return law


# mounting

def _soft_mount(rng: Random) -> Law:
    """Bolt the sensor on something that twists by the torques: its axes lean under load."""
    soft, time = rng.standard_normal((3, 3)), between(rng, 0.002, 0.02)

    def law(m: Moved) -> Added:
        turn = lagged(m.wrench[:, 3:] @ soft, m.dt, time)
        return added(m, np.cross(m.wrench[:, :3], turn), np.cross(m.wrench[:, 3:], turn))

    return law


def _settling_base(rng: Random) -> Law:
    """Sink in after it was set down: a tilt of base that settles, and again after a jolt."""
    way, time, jolt = unit(rng) * [1.0, 1.0, 0.1], between(rng, 2.0, 15.0), rng.uniform(0.2, 0.8)

    def law(m: Moved) -> Added:
        at = jolt * m.t[-1]
        course = -np.expm1(-m.t / time) - 0.6 * np.where(
            m.t > at, np.expm1(-np.maximum(m.t - at, 0.0) / (0.3 * time)), 0.0)
        return tilted(m, m.in_sensor(np.outer(course, way)))

    return law


def _tile_step(rng: Random) -> Law:
    """Stand across two tiles: base tips as the load moves from over one to over the other."""
    way, lean = unit(rng), unit(rng) * [1.0, 1.0, 0.0]
    width, line = between(rng, 0.01, 0.1), rng.uniform(-0.05, 0.1)

    def law(m: Moved) -> Added:
        side = np.tanh(((m.position - m.position[0]) @ way - line) / width)
        return tilted(m, m.in_sensor(np.outer(side, lean)))

    return law


def _cable_mic(rng: Random) -> Law:
    """Bend the accelerometer's cable: an error by the size of the turn about one axis."""
    axis, bend, out = unit(rng), rng.uniform(-0.2, 0.2), unit(rng)
    return lambda m: added(m, accel=np.outer(np.abs(m.turned @ axis - bend) - abs(bend), out))


_PLACE, _CONTACT, _ACCEL = (frozenset({one}) for one in ('position', 'contact', 'accel'))

KINDS: Mapping[str, Kind] = {
    'pump_pulse': Kind(_pump_pulse, ('spindle_vibration',)),
    'loose_mass': Kind(_loose_mass, ('tool_mass', 'wrench_gain')),
    'spun_fluid': Kind(_spun_fluid),
    'capstan': Kind(_capstan), 'detent': Kind(_detent), 'end_strap': Kind(_end_strap),
    'magnet': Kind(_magnet, ('cable_force',), _PLACE),
    'eddy_brake': Kind(_eddy_brake, (), _PLACE),
    'impact_ring': Kind(_impact_ring, ('contact_damping',), _CONTACT),
    'curved_screen': Kind(_curved_screen, (), _CONTACT | _PLACE),
    'fan_runup': Kind(_fan_runup, ('spindle_vibration',)),
    'telegraph': Kind(_telegraph, ('wrench_bias_step',)),
    'supply_dip': Kind(_supply_dip, ('wrench_gain',)),
    'dead_band': Kind(_dead_band, ('wrench_gain',)),
    'two_slopes': Kind(_two_slopes, ('wrench_gain',)),
    'coil_talk': Kind(_coil_talk, ('wrench_crosstalk',)),
    'motor_heat': Kind(_motor_heat, ('wrench_bias_drift',)),
    'accel_memory': Kind(_accel_memory, ('accel_highpass', 'accel_gain'), _ACCEL),
    'accel_segments': Kind(_accel_segments, ('accel_gain',), _ACCEL),
    'soft_mount': Kind(_soft_mount), 'settling_base': Kind(_settling_base, ('base_tilt',)),
    'tile_step': Kind(_tile_step, (), _PLACE), 'cable_mic': Kind(_cable_mic, (), _ACCEL)}
"""By name."""


# other forms of library effects

@njit(cache=True)
def _widening(x, width, growth, power):  # type: ignore[no-untyped-def]
    """Follow Dahl's law with an exponent, of a width that grows with the load."""
    z = np.zeros_like(x)
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            step, last = x[n, j] - x[n - 1, j], z[n - 1, j]
            limit = width[j] * (1.0 + growth * abs(x[n, j]) / (10.0 * width[j]))
            left = 1.0 - (1.0 if step > 0.0 else -1.0) * last / limit
            new = last + step * math.copysign(abs(left) ** power, left)
            z[n, j] = min(max(new, -limit), limit)
    return z


def _hysteresis(rig: Rig, size: float, rng: Random) -> Rig:
    """Add a loop that opens with the load; ``size`` is its half height at no load."""
    scale = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    widths = scale * rng.uniform(5.0, 20.0)
    growth, power = rng.uniform(0.3, 1.5), rng.uniform(0.6, 1.6)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        return np.asarray(u + size * scale * _widening(u, widths, growth, power) / widths)

    return sensing(rig, wrench=stage)


def _drift(rig: Rig, size: float, rng: Random) -> Rig:
    """Drift as heat arrives from afar: nothing at first, at other times in each channel."""
    out = np.concatenate([direction(rng), 0.05 * direction(rng)])
    times = np.exp(rng.uniform(np.log(1.0), np.log(20.0), 6))

    def stage(truth: Any, u: Array, _: Random) -> Array:
        late = np.sqrt(times / np.maximum(truth.t[:, None], 1e-3))
        return np.asarray(u + 2.0 * size * out * erfc(late))

    return sensing(rig, wrench=stage)


def _lowpass(rig: Rig, size: float, rng: Random) -> Rig:
    """Average over a window, and over a shorter one again; ``size`` is the delay of both."""
    share = rng.uniform(0.5, 1.0)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        fine = float(truth.t[1] - truth.t[0])
        late = delayed(truth.t, u, size)
        for part in (share, 1 - share):
            count = max(1, round(2 * part * size / fine))
            late = uniform_filter1d(late, count, axis=0, mode='nearest')
        return np.asarray(late)

    return sensing(rig, wrench=stage)


@njit(cache=True)
def _guided(dy, rest, tool, rub):  # type: ignore[no-untyped-def]
    """Return dy/dt with friction of a guide that is pressed by what it carries."""
    pressed = math.sqrt(rest[1] ** 2 + rest[2] ** 2) / 9.80665
    force = rub[0] * (1.0 - rub[2] + rub[2] * pressed) * math.tanh(dy[0] / rub[1])
    force *= 1.0 + (rub[3] if dy[0] > 0.0 else -rub[3])
    less = force / tool.mass
    return (dy[0], dy[1] - less, dy[2], dy[3], dy[4], dy[5], dy[6], dy[7]), less


@njit(cache=True)
def _slope(t, y, i, motion, tool, wall, rub):  # type: ignore[no-untyped-def]
    x, v, a, R, omega, alpha = motion
    got = _balance(t, y, x[i], v[i], a[i], R[i], omega[i], alpha[i], tool, wall)
    return _guided(got[0], got[4], tool, rub)[0]


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
        dy, _ = _guided(got[0], got[4], tool, rub)
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
    """Rub in a guide that is pressed by what it carries, more one way than the other."""
    rub = (size, between(rng, 1e-3, 6e-3), rng.uniform(0.2, 0.7), rng.uniform(-0.3, 0.3))
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
    Effect('wrench_lowpass', 'wrench_sensor', 5e-5, 0.03, 's', _lowpass))}
"""By name."""
