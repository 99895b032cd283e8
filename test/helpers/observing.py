"""A tool in motion whose contact wrench is known, for the observer's tests.

Written from the equations of the rig in closed form (sines), nothing of ``forcecal_ros.observe``
in it; and the calibration that fits it.
"""

from dataclasses import dataclass, replace

from forcecal_ros.core.calibration import (
    Accelerometer,
    Calibration,
    Estimate,
    Noise,
    ObserverGain,
    Tool,
)
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.observe.live import LiveObserver
from forcecal_ros.observe.playback import events
import numpy as np
from scipy.spatial.transform import Rotation

G = 9.80665
MASS = 13.0
COM = np.array([0.03, -0.01, 0.14])
INERTIA = np.diag([0.12, 0.15, 0.06])
BIAS = np.array([4.0, -3.0, 8.0, 0.3, -0.2, 0.1])
ACCELEROMETER = np.array([0.05, 0.0, 0.18])
TIP = np.array([0.2, 0.0, 0.1])
GAIN, OFFSET = -0.2937, 5.0938
FORCE_NOISE, TORQUE_NOISE, VOLTS_NOISE = 0.25, 0.02, 0.01
K1 = np.array([[0.04, 0.0006, -0.0073], [0.1, 0.0001, 1.0]])
K2 = np.array([[0.06, 0.0002, -0.0012], [0.225, -0.0002, 1.0]])
"""[Gamez2005] Eq. 32 and 33."""


@dataclass(frozen=True)
class Swing:
    """Sines: the sensor's place [m], its rotation [rad] about ``axis``, the tool's slide [m]."""

    place: tuple = (0.0, 0.0, 0.0)
    place_hz: float = 2.0
    turn: float = 0.0
    turn_hz: float = 0.5
    axis: tuple = (0.0, 0.0, 1.0)
    slide: float = 0.0
    slide_hz: float = 3.0
    start: float = 0.0
    """Before this, rest; the swing then swells within one second [s]."""


def _sine(t, amplitude, hz, start):
    """Return a sine that swells over 1 s, and its first two derivatives (numerically exact)."""
    u = np.clip(t - start, 0.0, 1.0)
    w = 2 * np.pi * hz
    e = u ** 3 * (10 - 15 * u + 6 * u * u)
    e1 = 30 * u * u * (1 - u) ** 2
    e2 = 60 * u * (1 - u) * (1 - 2 * u)
    s, c = np.sin(w * (t - start)), w * np.cos(w * (t - start))
    return (amplitude * e * s, amplitude * (e1 * s + e * c),
            amplitude * (e2 * s + 2 * e1 * c - w * w * e * s))


def _motion(t, swing, home):
    turn, rate, push = _sine(t, swing.turn, swing.turn_hz, swing.start)
    axis = np.array(swing.axis) / np.linalg.norm(swing.axis)
    R = (Rotation.from_matrix(home) * Rotation.from_rotvec(turn[:, None] * axis)).as_matrix()
    p, _, a = (x[:, None] * np.array(swing.place)
               for x in _sine(t, 1.0, swing.place_hz, swing.start))
    return R, np.array([1.0, 0.0, 1.0]) + p, a, rate[:, None] * axis, push[:, None] * axis


def _specific_force(R, a, omega, alpha, slide, point):
    """Acceleration less gravity of a point that slides with the tool, in ft_sensor."""
    s, ds, dds = slide
    x = np.array([1.0, 0.0, 0.0])
    r = point + s[:, None] * x
    f = np.einsum('nji,nj->ni', R, a + [0.0, 0.0, G])
    return (f + np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
            + 2 * np.cross(omega, ds[:, None] * x) + dds[:, None] * x)


def record(seconds, swing=Swing(), contact=None, seed=0, noise=1.0, delay=0.0, home=None,
           rates=(1000.0, 1000.0, 250.0), wash=0.0, without=()):
    """
    Record the tool in motion.

    ``contact(t)`` gives the force of the environment at the tip, shape (n, 3), in ft_sensor;
    ``rates`` are those of wrench, accelerometer and pose; ``wash`` is the corner of the
    accelerometer's high-pass [Hz], settled at the start; ``delay`` shifts its stamps;
    ``without`` names streams to leave out.
    """
    rng = np.random.default_rng(seed)
    home = np.diag([1.0, -1.0, -1.0]) if home is None else home
    t, t_acc, t_pose = (np.arange(1, int(seconds * rate) + 1) / rate for rate in rates)

    R, _, a, omega, alpha = _motion(t, swing, home)
    slide = _sine(t, swing.slide, swing.slide_hz, swing.start)
    r = COM + slide[0][:, None] * [1.0, 0.0, 0.0]
    force = MASS * _specific_force(R, a, omega, alpha, slide, COM)
    torque = (np.cross(r, force) + alpha @ INERTIA + np.cross(omega, omega @ INERTIA))
    push = np.zeros((len(t), 3)) if contact is None else contact(t)
    truth = np.hstack([push, np.cross(TIP + slide[0][:, None] * [1.0, 0.0, 0.0], push)])
    wrench = truth - np.hstack([force, torque]) + BIAS
    wrench += noise * rng.normal(size=wrench.shape) * ([FORCE_NOISE] * 3 + [TORQUE_NOISE] * 3)

    R, _, a, omega, alpha = _motion(t_acc, swing, home)
    f = _specific_force(R, a, omega, alpha, _sine(t_acc, swing.slide, swing.slide_hz, swing.start),
                        ACCELEROMETER)
    if wash:
        keep = np.exp(-2 * np.pi * wash / rates[1])
        passed = np.zeros_like(f)
        for i in range(1, len(f)):
            passed[i] = keep * passed[i - 1] + (1 + keep) / 2 * (f[i] - f[i - 1])
        f = passed
    volts = OFFSET + GAIN * f + noise * rng.normal(scale=VOLTS_NOISE, size=f.shape)

    R, p, *_ = _motion(t_pose, swing, home)
    p = p + noise * rng.normal(scale=2e-5, size=p.shape)
    R = R @ Rotation.from_rotvec(noise * rng.normal(scale=2e-5, size=p.shape)).as_matrix()
    s = slide[0] + noise * rng.normal(scale=2e-5, size=len(t))
    streams = {
        'wrench': Stream(t, wrench), 'accelerometer': Stream(t_acc + delay, volts),
        'pose': PoseStream(t_pose, p, R), 'optidrive': Stream(t, s[:, None]),
        'contact_truth': Stream(t, truth)}
    return Recording(**{k: v for k, v in streams.items() if k not in without})


def calibration(delay=0.0, wash=0.0, K=K1, rigid=False, noise=1.0, **changes):
    """Give the calibration that belongs to :func:`record`."""
    def known(value, unit='1'):
        return Estimate(value, 0.0, unit)
    sigma = noise * np.array([FORCE_NOISE] * 3 + [TORQUE_NOISE] * 3)
    accelerometer = Accelerometer(
        offset=known([OFFSET] * 3, 'V'), gain=known([GAIN] * 3, 'V/(m/s^2)'), map=known(np.eye(3)),
        delay=known(delay, 's'), coupling='ac' if wash else 'dc',
        cutoff=known(wash, 'Hz') if wash else None, position=known(ACCELEROMETER, 'm'))
    parts = {
        'mass': known(MASS, 'kg'), 'com': known(COM, 'm'), 'wrench_bias': known(BIAS, 'N, N m'),
        'inertia': known(INERTIA, 'kg m^2'), 'accelerometer': accelerometer,
        'tool': None if rigid else Tool(known(5000.0, 'N/m'), known(130.0, 'N s/m')),
        'noise': Noise(known(1e-6 * np.eye(2), '(m, m/s)^2 s'),
                       known(1e-6 * np.eye(3), '(m, m/s, m/s^2)^2 s'),
                       known(np.diag(sigma ** 2), '(N, N m)^2'),
                       known((noise * VOLTS_NOISE / GAIN) ** 2 * np.eye(3), '(m/s^2)^2'),
                       1000.0, 1000.0),
        'observer': ObserverGain(K=known(K), A=known([[0.0, 1.0], [0.0, 0.0]]),
                                 C=known([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]), dt=0.001)}
    return Calibration(**{**parts, **changes})


def push(axis, size, start=0.0, end=np.inf):
    """Give a contact force that steps on and off."""
    def force(t):
        f = np.zeros((len(t), 3))
        f[:, axis] = size * ((t >= start) & (t < end))
        return f
    return force


def lossy(recording, seed, lost=0.05, jitter=0.1):
    """Lose a share of every stream's samples, and let stamps jitter by a share of its period."""
    rng = np.random.default_rng([seed, 1])

    def damaged(stream):
        kept = rng.random(len(stream)) >= lost
        t = stream.t + jitter * np.median(np.diff(stream.t)) * rng.uniform(-1, 1, len(stream))
        return replace(stream, t=t).rows(kept)

    return replace(recording, **{
        name: damaged(getattr(recording, name))
        for name in ('wrench', 'accelerometer', 'pose', 'optidrive')})


def orientation_only(recording):
    """Return a recording whose poses hold no position."""
    pose = recording.pose
    return replace(recording, pose=PoseStream(
        pose.t, np.full_like(pose.position, np.nan), pose.R_base_sensor))


def without_times(stream, *gaps):
    """Return a stream without the samples of some intervals [s]."""
    keep = np.ones(len(stream), dtype=bool)
    for start, end in gaps:
        keep &= (stream.t < start) | (stream.t >= end)
    return stream.rows(keep)


def answers_of(live, recording, end=np.inf):
    """Let an observer hear a recording as the node hears topics; return what it answers."""
    takes = {'wrench': live.on_wrench, 'accelerometer': live.on_accelerometer,
             'pose': live.on_pose, 'displacement': live.on_displacement}
    return [sample for t, kind, values in events(recording) if t < end
            for sample in takes[kind](t, values)]


def observed(recording, model, seconds=0.5):
    """Return an observer that has heard a recording."""
    live = LiveObserver(seconds, 0.5)
    live.take_over(model)
    answers_of(live, recording)
    return live
