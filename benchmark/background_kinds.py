"""Small discrepancies that no library of effects has, as additions to a recording's signals.

Each kind draws its forms and frequencies once from a generator and is then a function of the
motion, so that both recordings of a case carry the same discrepancy. Amplitudes are arbitrary:
who adds them scales them to an energy.
"""

from collections.abc import Callable
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_vector
import numpy as np
from scipy.signal import lfilter

SPLIT = 20260731
"""Seed by which the kinds fall into the two halves."""

HALVES = ('development', 'withheld')

LEVER = 0.08
"""Torque for a force of one sensor's noise level [m]."""

WRENCH, ACCEL, POSITION, TURN = slice(0, 6), slice(6, 9), slice(9, 12), slice(12, 15)
"""Columns of what a kind adds: N and N m, m/s^2, m in base, rad in S."""


class Motion(NamedTuple):
    """
    What a noise-free recording says of the motion, on one grid of time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        From the start [s].
    R_base_sensor : ndarray, shape (n, 3, 3)
    position, velocity, acceleration : ndarray, shape (n, 3)
        Of S in base; zero where no position is known.
    omega, alpha : ndarray, shape (n, 3)
        In S [rad/s], [rad/s^2].
    force : ndarray, shape (n, 3)
        Specific force at S, in S [m/s^2].
    wrench, contact : ndarray, shape (n, 6)
        On the wire without bias, and the part of it that the wall makes [N], [N m].
    mass : float
        Of the tool [kg].
    com : ndarray, shape (3,)
        In S [m].
    index : int
        Of the recording in its case.
    """

    t: Array
    R_base_sensor: Array
    position: Array
    velocity: Array
    acceleration: Array
    omega: Array
    alpha: Array
    force: Array
    wrench: Array
    contact: Array
    mass: float
    com: Array
    index: int

    @property
    def dt(self) -> float:
        """Between two instants [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def turned(self) -> Array:
        """Rotation vector since the start, in S at the start [rad], (n, 3)."""
        return np.asarray(rotation_vector(self.R_base_sensor[0].T @ self.R_base_sensor))

    @property
    def load(self) -> float:
        """What the sensor carries at most, roughly: weight, and a push where there is one [N]."""
        return 9.81 * self.mass + 50.0 * bool(self.contact.any())

    @property
    def up(self) -> Array:
        """Unit vector upwards in S, (n, 3)."""
        return np.asarray(self.R_base_sensor[:, 2, :])


Law = Callable[[Motion], Array]


class Kind(NamedTuple):
    """
    One kind of discrepancy.

    Attributes
    ----------
    group : str
        ``mechanics``, ``electronics`` or ``mounting``.
    draw : callable
        Generator -> law: motion -> what is added, (n, 15).
    alias : tuple of str
        Effects of the library of nearly the same form: to name them is not false. By physics
        (hysteresis, a line, steps), or as they take up 0.8 of its energy, see
        background_aliases.py.
    wants : tuple of str
        ``position``, ``contact``, ``wrench`` (it adds to the wrench): what it needs to show.
    """

    group: str
    draw: Callable[[np.random.Generator], Law]
    alias: tuple[str, ...] = ()
    wants: tuple[str, ...] = ('wrench',)


def _added(n: int, **parts: Array) -> Array:
    """Put the parts ``force``, ``torque``, ``accel``, ``position``, ``turn`` where they belong."""
    columns = {'force': slice(0, 3), 'torque': slice(3, 6), 'accel': ACCEL, 'position': POSITION,
               'turn': TURN}
    out = np.zeros((n, 15))
    for name, values in parts.items():
        out[:, columns[name]] += values
    return out


def _direction(rng: np.random.Generator, n: int = 3) -> Array:
    vector = rng.standard_normal(n)
    return np.asarray(vector / np.linalg.norm(vector))


def _wrench_direction(rng: np.random.Generator) -> Array:
    """Return forces and torques in the proportion of a sensor's noise."""
    return _direction(rng, 6) * np.repeat([1.0, LEVER], 3)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _waves(rng: np.random.Generator, low: float, high: float, n_out: int = 3
           ) -> Callable[[Array], Array]:
    """Draw a smooth function (n, 3) -> (n, n_out), of wave numbers between the limits."""
    k = np.array([_log(rng, low, high) * _direction(rng) for _ in range(2)])
    phase, size = rng.uniform(0.0, 2.0 * np.pi, 2), rng.standard_normal((2, n_out))
    return lambda x: np.sin(x @ k.T + phase) @ size


def _tilted(m: Motion, turn: Array) -> Array:
    """Gravity and inertia met by a tool that is turned by a small rotation vector in S, (n, 3)."""
    change = np.cross(m.force, turn)
    force = -m.mass * change
    return _added(len(turn), force=force, torque=np.cross(m.com, force), accel=change)


def _shaken(m: Motion, acceleration: Array) -> Array:
    """Reaction to a further acceleration of the whole tool, given in S, (n, 3)."""
    force = -m.mass * acceleration
    return _added(len(force), force=force, torque=np.cross(m.com, force), accel=acceleration)


def _mode(x: Array, dt: float, frequency: float, damping: float) -> Array:
    """Second-order response of unit static gain, at rest at first, by the bilinear rule."""
    w = 2.0 * np.pi * frequency * dt
    a = np.array([4.0 + 4.0 * damping * w + w * w, 2.0 * w * w - 8.0,
                  4.0 - 4.0 * damping * w + w * w])
    b = w * w * np.array([1.0, 2.0, 1.0])
    return np.asarray(lfilter(b / a[0], a / a[0], x - x[0], axis=0) + x[0])


def _lag(x: Array, dt: float, time: float) -> Array:
    """First-order lag, settled at first."""
    a = np.exp(-dt / time)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], x - x[0], axis=0) + x[0])


# mechanics

def _link_flex(rng: np.random.Generator) -> Law:
    """Links that bend by pose: an orientation error that is smooth in position and turn."""
    of_place, of_turn = _waves(rng, 5.0, 30.0), _waves(rng, 0.7, 2.0)
    return lambda m: _tilted(m, of_place(m.position - m.position[0]) + of_turn(m.turned))


def _eccentric_wrist(rng: np.random.Generator) -> Law:
    """Measure a wrist joint off its axis: an error sinusoidal in its angle, in the pose too."""
    axis, about, phase = _direction(rng), _direction(rng), rng.uniform(0.0, 2.0 * np.pi)
    order = float(rng.integers(1, 4))

    def law(m: Motion) -> Array:
        error = np.outer(np.sin(order * (m.turned @ axis) + phase) - np.sin(phase), about)
        return _tilted(m, error) - _added(len(error), turn=0.2 * error)

    return law


def _slosh(rng: np.random.Generator) -> Law:
    """Let something hang in the tool that swings: a second pendulum, excited sideways."""
    frequency, damping = _log(rng, 0.8, 6.0), _log(rng, 0.02, 0.2)
    place, plane = rng.uniform(-0.15, 0.15, 3), np.eye(3) - np.outer(*[_direction(rng)] * 2)

    def law(m: Motion) -> Array:
        driven = m.force @ plane
        force = driven - _mode(driven, m.dt, frequency, damping)
        return _added(len(force), force=force, torque=np.cross(place, force))

    return law


def _cable_bending(rng: np.random.Generator) -> Law:
    """Bend a cable: a moment quadratic in how far the tool is turned, and a little force."""
    quadratic, pull = rng.standard_normal((3, 3, 3)), 3.0 * rng.standard_normal((3, 3, 3))

    def law(m: Motion) -> Array:
        pairs = np.einsum('ni,nj->nij', m.turned, m.turned)
        return _added(len(pairs), torque=np.einsum('kij,nij->nk', quadratic, pairs),
                      force=np.einsum('kij,nij->nk', pull, pairs))

    return law


def _square_drag(rng: np.random.Generator) -> Law:
    """Drag by the square of the velocity, straight and turning."""
    place, share = rng.uniform(-0.2, 0.2, 3), _log(rng, 0.02, 0.5)

    def law(m: Motion) -> Array:
        velocity = np.einsum('nji,nj->ni', m.R_base_sensor, m.velocity)
        velocity = velocity + np.cross(m.omega, place)
        force = -velocity * np.linalg.norm(velocity, axis=1, keepdims=True)
        spin = -share * m.omega * np.linalg.norm(m.omega, axis=1, keepdims=True)
        return _added(len(force), force=force, torque=np.cross(place, force) + 0.01 * spin)

    return law


def _hose_drag(rng: np.random.Generator) -> Law:
    """Drag a hose over its guide: tanh of the velocity along it, in base."""
    along, pull, place = _direction(rng), _direction(rng), rng.uniform(-0.2, 0.2, 3)
    smooth, spin = _log(rng, 0.01, 0.06), _direction(rng)

    def law(m: Motion) -> Array:
        speed = m.velocity @ along + 0.1 * m.omega @ spin
        force = np.einsum('nji,j->ni', m.R_base_sensor, pull) * np.tanh(speed / smooth)[:, None]
        return _added(len(force), force=force, torque=np.cross(place, force))

    return law


def _seat_hysteresis(rng: np.random.Generator) -> Law:
    """Seat the tool with play by friction: three elements that follow the load with a lag."""
    axis, out = int(rng.integers(0, 3)), _wrench_direction(rng)
    widths, weights = rng.uniform(0.05, 0.6, 3), rng.uniform(0.3, 1.0, 3)

    def law(m: Motion) -> Array:
        load = m.wrench[:, axis]
        total = sum(w * (_played(load, 0.3 * b * m.load) - load) for b, w in zip(widths, weights))
        return _added(len(load), force=np.outer(total, out[:3]), torque=np.outer(total, out[3:]))

    return law


def _played(x: Array, half_width: float) -> Array:
    """Follow within a play of either side."""
    out, at = np.empty_like(x), float(x[0])
    for i, value in enumerate(x.tolist()):
        at = min(max(at, value - half_width), value + half_width)
        out[i] = at
    return out


def _sagging_tool(rng: np.random.Generator) -> Law:
    """Shift the centre of mass by how gravity pulls: a moment quadratic in the load."""
    shift = rng.standard_normal((3, 3))

    def law(m: Motion) -> Array:
        torque = np.cross(m.force @ shift.T, m.force)
        return _added(len(torque), torque=torque)

    return law


def _loose_part(rng: np.random.Generator) -> Law:
    """Let a part fall from one stop to the other where the tool is turned over an angle."""
    way, width = _direction(rng), _log(rng, 0.05, 0.3)
    middle = rng.uniform(-0.3, 0.3)

    def law(m: Motion) -> Array:
        side = np.tanh(((m.up - m.up[0]) @ way - middle) / width)
        torque = np.cross(way, -m.force) * side[:, None]
        return _added(len(torque), torque=torque)

    return law


def _rotor(rng: np.random.Generator) -> Law:
    """Carry a rotor that spins: its gyroscopic moment."""
    spin = _direction(rng)
    return lambda m: _added(len(m.t), torque=np.cross(m.omega, spin))


def _soft_tip(rng: np.random.Generator) -> Law:
    """Press with a tip that stiffens: the force in contact by its square and root."""
    share = rng.uniform(-0.5, 0.5)

    def law(m: Motion) -> Array:
        size = np.abs(m.contact[:, :1])
        return _added(len(size), force=m.contact[:, :3] * (size / 50.0 + share * np.sqrt(
            size / 50.0)), torque=m.contact[:, 3:] * size / 50.0)

    return law


def _rubbing_tip(rng: np.random.Generator) -> Law:
    """Rub on the wall: a force across it, by the pressure and tanh of the velocity."""
    smooth, bias, place = _log(rng, 0.001, 0.01), rng.uniform(-1.0, 1.0), rng.uniform(0, 0.2, 3)

    def law(m: Motion) -> Array:
        speed = np.tanh(m.velocity / smooth + bias) * [0.0, 1.0, 1.0]
        force = np.einsum('nji,nj->ni', m.R_base_sensor, speed)
        force = force * np.linalg.norm(m.contact[:, :3], axis=1, keepdims=True)
        return _added(len(force), force=force, torque=np.cross(place, force))

    return law


def _gear_ripple(rng: np.random.Generator) -> Law:
    """Follow teeth: an error periodic in the way, which shakes the tool."""
    way, about, phase = _direction(rng), _direction(rng), rng.uniform(0.0, 2.0 * np.pi)
    pitch = _log(rng, 0.008, 0.03)

    def law(m: Motion) -> Array:
        ripple = np.sin(2.0 * np.pi * ((m.position - m.position[0]) @ way
                                       + 0.1 * m.turned @ about) / pitch + phase)
        second = np.gradient(np.gradient(ripple, m.dt), m.dt)
        shaken = np.einsum('nji,nj->ni', m.R_base_sensor, np.outer(second, way))
        return _shaken(m, shaken) + _added(len(ripple), position=np.outer(ripple, way))

    return law


# electronics

def _warming(rng: np.random.Generator) -> Law:
    """Warm up: biases that drift with the logarithm of the time."""
    out, time = _wrench_direction(rng), _log(rng, 0.3, 5.0)

    def law(m: Motion) -> Array:
        course = np.log1p((m.t - m.t[0]) / time)[:, None] * out
        return _added(len(course), force=course[:, :3], torque=course[:, 3:])

    return law


def _warming_gain(rng: np.random.Generator) -> Law:
    """Warm up: gains that change as the sensor does."""
    gain, time = _direction(rng, 6), _log(rng, 3.0, 20.0)

    def law(m: Motion) -> Array:
        course = -np.expm1(-(m.t - m.t[0]) / time)[:, None] * gain * m.wrench
        return _added(len(course), force=course[:, :3], torque=course[:, 3:])

    return law


def _root_crosstalk(rng: np.random.Generator) -> Law:
    """Talk across by the root of what one channel feels."""
    source, out, small = int(rng.integers(0, 3)), _wrench_direction(rng), _log(rng, 0.02, 0.2)
    out[source] = 0.0

    def law(m: Motion) -> Array:
        felt = m.wrench[:, source]
        course = np.outer(np.sqrt(np.sqrt((felt / m.load) ** 2 + small ** 2)), out)
        return _added(len(felt), force=course[:, :3], torque=course[:, 3:])

    return law


def _curved_gain(rng: np.random.Generator) -> Law:
    """Bend the characteristic: gains that depend on the square of the load."""
    out = _direction(rng, 6)

    def law(m: Motion) -> Array:
        x = m.wrench / (m.load * np.repeat([1.0, 0.2], 3))
        course = out * np.repeat([1.0, LEVER], 3) * (x ** 3 - 0.6 * x)
        return _added(len(course), force=course[:, :3], torque=course[:, 3:])

    return law


def _creep(rng: np.random.Generator) -> Law:
    """Creep in the cell: what it has felt for some seconds lingers."""
    gain, times = _direction(rng, 6), [_log(rng, 0.5, 3.0), _log(rng, 3.0, 15.0)]

    def law(m: Motion) -> Array:
        course = gain * sum(_lag(m.wrench, m.dt, time) - m.wrench for time in times)
        return _added(len(course), force=course[:, :3], torque=course[:, 3:])

    return law


def _hum(rng: np.random.Generator) -> Law:
    """Pick up the mains: two lines close to each other."""
    lines = rng.uniform(45.0, 65.0) + np.array([0.0, rng.uniform(0.2, 1.5)])
    sizes = np.stack([_wrench_direction(rng), rng.uniform(0.2, 0.9) * _wrench_direction(rng)])
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, 2))

    def law(m: Motion) -> Array:
        angle = 2.0 * np.pi * np.outer(m.t, lines) + phases[m.index]
        course = np.sin(angle) @ sizes
        return _added(len(course), force=course[:, :3], torque=course[:, 3:])

    return law


def _uneven_codes(rng: np.random.Generator) -> Law:
    """Convert unevenly: an error periodic in the reading, as of a converter's codes."""
    axes, phase = rng.permutation(3)[:2], rng.uniform(0.0, 2.0 * np.pi, 2)
    periods = np.array([_log(rng, 0.08, 0.4), _log(rng, 0.08, 0.4)])

    def law(m: Motion) -> Array:
        force = np.zeros((len(m.t), 3))
        codes = m.wrench[:, axes] / (periods * m.load)
        force[:, axes] = np.sin(2.0 * np.pi * codes + phase)
        return _added(len(force), force=force)

    return law


def _disturbed(rng: np.random.Generator) -> Law:
    """Be disturbed by what is switched nearby: slow steps at instants of their own."""
    seed, n = int(rng.integers(2 ** 32)), int(rng.integers(3, 6))
    out = np.stack([_wrench_direction(rng) for _ in range(n)])

    def law(m: Motion) -> Array:
        own = np.random.default_rng([seed, m.index])
        at = m.t[0] + own.uniform(0.05, 0.95, n) * (m.t[-1] - m.t[0])
        course = 0.5 * (1.0 + np.tanh((m.t[:, None] - at) / own.uniform(0.1, 0.6, n))) @ out
        return _added(len(course), force=course[:, :3], torque=course[:, 3:])

    return law


def _curved_imu(rng: np.random.Generator) -> Law:
    """Bend the accelerometer's characteristic: gains by the square of the specific force."""
    gain, own = _direction(rng), 0.5 * _direction(rng)

    def law(m: Motion) -> Array:
        f = m.force / 9.81
        return _added(len(f), accel=gain * (f ** 3 - 0.6 * f) + own * f ** 2)

    return law


def _cross_imu(rng: np.random.Generator) -> Law:
    """Let two axes of the accelerometer move the third: their product."""
    out = rng.standard_normal((3, 3))

    def law(m: Motion) -> Array:
        f = m.force / 9.81
        return _added(len(f), accel=np.roll(f, 1, axis=1) * np.roll(f, 2, axis=1) @ out)

    return law


def _wandering_imu(rng: np.random.Generator) -> Law:
    """Wander: an accelerometer's bias that comes and goes over tens of seconds."""
    out, phase = _direction(rng), rng.uniform(0.0, 2.0 * np.pi, 2)
    frequency = _log(rng, 0.02, 0.15)

    def law(m: Motion) -> Array:
        course = np.sin(2.0 * np.pi * frequency * m.t + phase[m.index])
        return _added(len(course), accel=np.outer(course - course[0], out))

    return law


# mounting

def _imu_lever(rng: np.random.Generator) -> Law:
    """Mount the accelerometer elsewhere than the drawing says."""
    lever = _direction(rng)
    return lambda m: _added(len(m.t), accel=_lever(m, lever))


def _lever(m: Motion, lever: Array) -> Array:
    return np.cross(m.alpha, lever) + np.cross(m.omega, np.cross(m.omega, lever))


def _sensor_lever(rng: np.random.Generator) -> Law:
    """Mount the sensor elsewhere than where the pose is measured."""
    lever = _direction(rng)

    def law(m: Motion) -> Array:
        moved = (m.R_base_sensor - m.R_base_sensor[0]) @ lever
        return _shaken(m, _lever(m, lever)) + _added(len(moved), position=-0.2 * moved)

    return law


def _centrifugal(rng: np.random.Generator) -> Law:
    """Feel a centrifugal force about an axis that the model does not have."""
    lever = _direction(rng)
    return lambda m: _shaken(m, np.cross(m.omega, np.cross(m.omega, lever)))


def _yielding_base(rng: np.random.Generator) -> Law:
    """Stand on a base that yields: it tilts by the moment that the tool's load makes about it."""
    yields, foot = rng.uniform(0.3, 1.0, 3) * [1.0, 1.0, 0.3], np.array([0.0, 0.0, -0.5])

    def law(m: Motion) -> Array:
        force = np.einsum('nij,nj->ni', m.R_base_sensor, m.wrench[:, :3])
        moment = np.cross(m.position - foot, force)
        moment += np.einsum('nij,nj->ni', m.R_base_sensor, m.wrench[:, 3:])
        tilt = (moment - moment[0]) * yields
        return _tilted(m, np.einsum('nji,nj->ni', m.R_base_sensor, tilt))

    return law


def _rocking_floor(rng: np.random.Generator) -> Law:
    """Stand on a floor that rocks after each move of the robot."""
    frequency, damping = _log(rng, 2.0, 9.0), _log(rng, 0.02, 0.1)
    way = np.outer(*[_direction(rng)] * 2)

    def law(m: Motion) -> Array:
        driven = m.acceleration @ way
        rocking = _mode(driven, m.dt, frequency, damping) - driven
        return _shaken(m, np.einsum('nji,nj->ni', m.R_base_sensor, rocking))

    return law


def _warped_flange(rng: np.random.Generator) -> Law:
    """Clamp the sensor on a flange that warps as it is loaded: forces squared into torques."""
    pairs = rng.standard_normal((3, 3, 3))

    def law(m: Motion) -> Array:
        x = m.wrench[:, :3] / m.load
        return _added(len(x), torque=np.einsum('kij,ni,nj->nk', pairs, x, x))

    return law


KINDS: dict[str, Kind] = {
    'link_flex': Kind('mechanics', _link_flex),
    'eccentric_wrist': Kind('mechanics', _eccentric_wrist),
    'slosh': Kind('mechanics', _slosh),
    'cable_bending': Kind('mechanics', _cable_bending),
    'square_drag': Kind('mechanics', _square_drag),
    'hose_drag': Kind('mechanics', _hose_drag),
    'seat_hysteresis': Kind('mechanics', _seat_hysteresis, ('wrench_hysteresis',)),
    'sagging_tool': Kind('mechanics', _sagging_tool),
    'loose_part': Kind('mechanics', _loose_part),
    'rotor': Kind('mechanics', _rotor),
    'soft_tip': Kind('mechanics', _soft_tip, (), ('wrench', 'contact')),
    'rubbing_tip': Kind('mechanics', _rubbing_tip, (), ('wrench', 'contact')),
    'gear_ripple': Kind('mechanics', _gear_ripple),
    'warming': Kind('electronics', _warming, ('wrench_bias_drift',)),
    'warming_gain': Kind('electronics', _warming_gain, ('wrench_gain',)),
    'root_crosstalk': Kind('electronics', _root_crosstalk, ('wrench_crosstalk',)),
    'curved_gain': Kind('electronics', _curved_gain, ('wrench_gain',)),
    'creep': Kind('electronics', _creep, ('wrench_gain', 'wrench_hysteresis')),
    'hum': Kind('electronics', _hum, ('spindle_vibration',)),
    'uneven_codes': Kind('electronics', _uneven_codes),
    'disturbed': Kind('electronics', _disturbed, ('wrench_bias_step',)),
    'curved_imu': Kind('electronics', _curved_imu, (), ('accel',)),
    'cross_imu': Kind('electronics', _cross_imu, (), ('accel',)),
    'wandering_imu': Kind('electronics', _wandering_imu, (), ('accel',)),
    'imu_lever': Kind('mounting', _imu_lever, (), ('accel',)),
    'sensor_lever': Kind('mounting', _sensor_lever),
    'centrifugal': Kind('mounting', _centrifugal),
    'yielding_base': Kind('mounting', _yielding_base, (), ('wrench', 'position')),
    'rocking_floor': Kind('mounting', _rocking_floor, (), ('wrench', 'position')),
    'warped_flange': Kind('mounting', _warped_flange),
}
"""Every kind by its name."""


def half(name: str) -> tuple[str, ...]:
    """
    Return the kinds of one half; each has its share of every group.

    Parameters
    ----------
    name : str
        ``development`` or ``withheld``.
    """
    rng = np.random.default_rng(SPLIT)
    chosen: list[str] = []
    for group in ('mechanics', 'electronics', 'mounting'):
        names = sorted(k for k, kind in KINDS.items() if kind.group == group)
        chosen += rng.permutation(names)[HALVES.index(name)::2].tolist()
    return tuple(chosen)
