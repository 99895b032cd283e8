"""The development half of the kinds of discrepancies."""

from blind.robot import Array
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


def _shifting_load(rng: Random) -> Law:
    """Let a load creep along a rail of the tool, pulled by gravity, with a lag."""
    rail, time, reach = unit(rng), between(rng, 0.1, 1.5), between(rng, 2.0, 12.0)

    def law(m: Moved) -> Added:
        at = lagged(np.tanh(m.force @ rail / reach), m.dt, time)
        return added(m, torque=np.cross(np.outer(at - at[0], rail), -m.force))

    return law


def _coiled_hose(rng: Random) -> Law:
    """Wind up a hose about one axis: a torque cubic in the turn, and a pull along it."""
    axis, pull, slant = unit(rng), unit(rng), rng.uniform(-0.4, 0.4)

    def law(m: Moved) -> Added:
        turn = m.turned @ axis - slant
        course = turn**3 + slant**3
        return added(m, np.outer(2.0 * course, pull), np.outer(course, axis))

    return law


def _pose_sag(rng: Random) -> Law:
    """Sag by heading and elevation: products of the directions that the tool points to."""
    mix = rng.standard_normal((3, 3, 3))

    def law(m: Moved) -> Added:
        pairs = np.einsum('ni,nj->nij', m.R[:, :, 0], m.R[:, :, 2])
        return tilted(m, np.einsum('kij,nij->nk', mix, pairs - pairs[0]))

    return law


def _tooth_ripple(rng: Random) -> Law:
    """Follow teeth along a way: two harmonics of a pitch, which shake the tool."""
    way, pitch, second = unit(rng), between(rng, 0.01, 0.04), rng.uniform(0.0, 0.5)
    phase = rng.uniform(0, 2 * np.pi, 2)

    def law(m: Moved) -> Added:
        x = 2 * np.pi / pitch * ((m.position - m.position[0]) @ way)
        ripple = np.outer(np.sin(x + phase[0]) + second * np.sin(2 * x + phase[1]), way)
        ripple = lagged(ripple - ripple[0], m.dt, 0.002)
        again = np.gradient(np.gradient(ripple, m.dt, axis=0), m.dt, axis=0)
        out = shaken(m, m.in_sensor(again))
        return out._replace(position=ripple)

    return law


def _rail_friction(rng: Random) -> Law:
    """Rub a guided cable on its rail: Stribeck's curve of the speed along it, in base."""
    rail, pull, place = unit(rng), unit(rng), rng.uniform(-0.15, 0.15, 3)
    slow, dip = between(rng, 0.01, 0.05), rng.uniform(0.2, 1.0)

    def law(m: Moved) -> Added:
        v = m.velocity @ rail / slow
        force = m.in_sensor(np.outer(np.tanh(v) * (1 + dip * np.exp(-v**2)), pull))
        return added(m, force, np.cross(place, force))

    return law


@njit(cache=True)
def _dragged(at, pressed, reach):  # type: ignore[no-untyped-def]
    """Hold a tip by a bristle that breaks beyond ``reach`` while it is pressed."""
    out = np.zeros_like(at)
    for n in range(1, len(at)):
        if pressed[n]:
            z = out[n - 1] + at[n] - at[n - 1]
            size = np.sqrt(np.sum(z**2))
            out[n] = z if size < reach else z * (reach / size)
    return out


def _tip_stick(rng: Random) -> Law:
    """Stick to the wall until a bristle breaks: a force along it, by the pressure."""
    reach, place = between(rng, 2e-4, 5e-3), rng.uniform(0.0, 0.2, 3)

    def law(m: Moved) -> Added:
        normal = np.linalg.norm(m.contact, axis=1)
        z = _dragged(m.position * [0.0, 1.0, 1.0], normal > 0.5, reach)
        force = m.in_sensor(-z * normal[:, None] / reach)
        return added(m, force, np.cross(place, force))

    return law


def _mains(rng: Random) -> Law:
    """Pick up the mains: 50 or 60 Hz and its third harmonic, whose size comes and goes."""
    hz = rng.choice([50.0, 60.0]) + rng.uniform(-0.1, 0.1)
    sizes = np.stack([unit(rng, 6), rng.uniform(0.1, 0.6) * unit(rng, 6)]) * WRENCH_SCALE
    slow, phase = between(rng, 0.05, 0.5), rng.uniform(0, 2 * np.pi, (2, 3))

    def law(m: Moved) -> Added:
        own = phase[m.index]
        size = 1 + 0.5 * np.sin(2 * np.pi * slow * m.t + own[0])
        lines = np.sin(2 * np.pi * hz * np.outer(m.t, [1.0, 3.0]) + own[1:])
        return in_wrench(m, size[:, None] * (lines @ sizes))

    return law


def _cross_square(rng: Random) -> Law:
    """Let one force reach other channels by its square."""
    source, out = int(rng.integers(3)), unit(rng, 6) * WRENCH_SCALE
    out[source], skew = 0.0, rng.uniform(-0.3, 0.3)
    return lambda m: in_wrench(m, np.outer((m.wrench[:, source] / m.load - skew)**2, out))


def _accel_walk(rng: Random) -> Law:
    """Let the accelerometer's offset wander: three slow sines, other ones in each recording."""
    hz, out = rng.uniform(0.01, 0.2, 3), np.stack([unit(rng) for _ in range(3)])
    phase = rng.uniform(0, 2 * np.pi, (2, 3))

    def law(m: Moved) -> Added:
        course = np.sin(2 * np.pi * np.outer(m.t, hz) + phase[m.index])
        return added(m, accel=(course - course[0]) @ out)

    return law


def _slew_limit(rng: Random) -> Law:
    """Follow fast changes too slowly: an error by the rate of the load, which levels off."""
    rate, gain = between(rng, 2.0, 20.0), unit(rng, 6) * WRENCH_SCALE

    def law(m: Moved) -> Added:
        speed = np.gradient(lagged(m.wrench, m.dt, 0.01), m.dt, axis=0)
        return in_wrench(m, -gain * np.tanh(speed / (rate * m.load * WRENCH_SCALE)))

    return law


def _code_ripple(rng: Random) -> Law:
    """Convert unevenly: a saw of the reading on two forces."""
    axes, period = rng.permutation(3)[:2], between(rng, 0.05, 0.3)
    phase = rng.uniform(0, 1, 2)

    def law(m: Moved) -> Added:
        force: Array = np.zeros((len(m.t), 3))
        x = m.wrench[:, axes] / (period * m.load) + phase
        force[:, axes] = 2 * np.abs(2 * (x - np.floor(x)) - 1) - 1
        return added(m, force)

    return law


def _visco_creep(rng: Random) -> Law:
    """Creep: what it felt lingers with a power of the time (five lags, one a decade apart)."""
    gain, power = unit(rng, 6), rng.uniform(0.2, 0.8)

    def law(m: Moved) -> Added:
        course = sum(10.0**(power * k) * (lagged(m.wrench, m.dt, 0.1 * 10.0**k) - m.wrench)
                     for k in (0.0, 0.5, 1.0, 1.5, 2.0))
        return in_wrench(m, gain * course)

    return law


def _yield_base(rng: Random) -> Law:
    """Stand on a base that tilts by the moment about its foot, with a lag."""
    soft, foot = rng.uniform(0.2, 1.0, 3) * [1.0, 1.0, 0.2], np.array([0.0, 0.0, -0.4])
    time = between(rng, 0.005, 0.1)

    def law(m: Moved) -> Added:
        pull = np.einsum('nij,nj->ni', m.R, m.wrench[:, :3])
        tilt = lagged(np.cross(m.position - foot, pull) * soft, m.dt, time)
        return tilted(m, m.in_sensor(tilt - tilt[0]))

    return law


def _floor_mode(rng: Random) -> Law:
    """Rock on a floor with a mode of its own, excited by the robot's accelerations."""
    hz, damping, way = between(rng, 3.0, 12.0), between(rng, 0.01, 0.08), unit(rng)
    driven = unit(rng)

    def law(m: Moved) -> Added:
        x = m.acceleration @ driven
        return shaken(m, m.in_sensor(np.outer(swung(x, m.dt, hz, damping) - x, way)))

    return law


def _accel_lever(rng: Random) -> Law:
    """Mount the accelerometer elsewhere than the drawing says."""
    lever = unit(rng)
    return lambda m: added(m, accel=np.cross(m.alpha, lever)
                           + np.cross(m.omega, np.cross(m.omega, lever)))


_PLACE, _CONTACT, _ACCEL = (frozenset({one}) for one in ('position', 'contact', 'accel'))

KINDS: dict[str, Kind] = {
    'shifting_load': Kind(_shifting_load), 'coiled_hose': Kind(_coiled_hose),
    'pose_sag': Kind(_pose_sag), 'tooth_ripple': Kind(_tooth_ripple, (), _PLACE),
    'rail_friction': Kind(_rail_friction, (), _PLACE),
    'tip_stick': Kind(_tip_stick, (), _CONTACT | _PLACE),
    'mains': Kind(_mains, ('spindle_vibration',)),
    'cross_square': Kind(_cross_square, ('wrench_crosstalk',)),
    'accel_walk': Kind(_accel_walk, (), _ACCEL),
    'slew_limit': Kind(_slew_limit, ('wrench_delay', 'wrench_lowpass')),
    'code_ripple': Kind(_code_ripple),
    'visco_creep': Kind(_visco_creep, ('wrench_gain', 'wrench_hysteresis', 'wrench_bias_drift')),
    'yield_base': Kind(_yield_base, (), _PLACE), 'floor_mode': Kind(_floor_mode, (), _PLACE),
    'accel_lever': Kind(_accel_lever, (), _ACCEL)}
"""By name."""
FORMS: dict[str, object] = {}
"""Forms of library effects other than those of the first edition."""
