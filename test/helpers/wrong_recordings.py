"""A gripper's logs as drivers, loggers and clocks spoil them: message by message, then a bag."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_from_vector,
    rotation_vector,
)
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.core.topics import POSE, WRENCH
from forcecal_ros.io.bags.messages import encode, FIELDS, Messages
from forcecal_ros.io.bags.write import BagWriter
import numpy as np
from scipy.signal import butter, lfilter, sosfilt
from scipy.spatial.transform import Rotation

G = 9.80665
MASS, COM, INERTIA = 1.3, np.array([0.005, -0.012, 0.06]), np.diag([2e-3, 2e-3, 1e-3])
BIAS = np.array([3.0, -2.0, 5.0, 0.1, 0.2, -0.1])
NOISE = np.repeat([0.05, 0.003], 3)
RATE, POSE_RATE = 200.0, 125.0
EPOCH = 1_700_000_000 * 10**9


@dataclass(frozen=True)
class Log:
    """
    What two topics say, one row a message.

    Attributes
    ----------
    t, pose_t : ndarray, shape (n,), (k,)
        When it was measured [s].
    wrench, contact : ndarray, shape (n, 6)
        As sent, and the true contact of that instant in ft_sensor.
    frame : ndarray of str, shape (n,)
    place, q : ndarray, shape (k, 3), (k, 4)
        As sent; xyzw.
    stamp, pose_stamp : ndarray of int
        In the header [ns].
    """

    t: np.ndarray
    wrench: np.ndarray
    contact: np.ndarray
    frame: np.ndarray
    pose_t: np.ndarray
    place: np.ndarray
    q: np.ndarray
    stamp: np.ndarray
    pose_stamp: np.ndarray

    def of_wrench(self, rows, **changes):
        """Return some of the wrenches, or some of them more than once."""
        return replace(self, t=self.t[rows], wrench=self.wrench[rows], contact=self.contact[rows],
                       frame=self.frame[rows], stamp=self.stamp[rows], **changes)

    def of_pose(self, rows, **changes):
        """Return some of the poses."""
        return replace(self, pose_t=self.pose_t[rows], place=self.place[rows], q=self.q[rows],
                       pose_stamp=self.pose_stamp[rows], **changes)

    def stamped(self, of_time):
        """Stamp both topics by a function of the time [s] that gives nanoseconds."""
        return replace(self, stamp=of_time(self.t), pose_stamp=of_time(self.pose_t))


class Motion(NamedTuple):
    """Exact motion at some instants: all of ft_sensor, angular rates in it."""

    place: np.ndarray
    R: np.ndarray
    acceleration: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray


class Path(NamedTuple):
    """Poses in which the arm stands for ``hold`` [s], and moves of ``move`` [s] between them."""

    places: np.ndarray
    R: np.ndarray
    hold: float
    move: float

    @property
    def duration(self):
        return len(self.R) * (self.hold + self.move) - self.move

    def at(self, t):
        """Minimum-jerk moves, each about one axis and along one line."""
        span = self.hold + self.move
        i = np.minimum((t // span).astype(int), len(self.R) - 2)
        x = np.clip((t - i * span - self.hold) / self.move, 0.0, 1.0)
        s = 10 * x**3 - 15 * x**4 + 6 * x**5
        v = (30 * x**2 - 60 * x**3 + 30 * x**4) / self.move
        a = (60 * x - 180 * x**2 + 120 * x**3) / self.move**2
        turn = rotation_vector(np.swapaxes(self.R[:-1], 1, 2) @ self.R[1:])[i]
        way = np.diff(self.places, axis=0)[i]
        R = self.R[i] @ rotation_from_vector(s[:, None] * turn)
        return Motion(self.places[i] + s[:, None] * way, R, a[:, None] * way, v[:, None] * turn,
                      a[:, None] * turn)


def path(rng, poses, hold, move):
    """Draw poses between which the sensor turns by 40 to 120 deg."""
    R = [Rotation.from_euler('x', np.pi)]
    for _ in range(poses - 1):
        axis = rng.standard_normal(3)
        R.append(R[-1] * Rotation.from_rotvec(
            np.radians(rng.uniform(40.0, 120.0)) * axis / np.linalg.norm(axis)))
    places = [0.5, 0.1, 0.4] + rng.uniform(-0.15, 0.15, (poses, 3))
    return Path(places, np.array([one.as_matrix() for one in R]), hold, move)


def load(motion, mass=MASS, com=COM, down=(0.0, 0.0, -1.0)):
    """Wrench of weight and inertia of the gripper on the wire, (n, 6)."""
    gravity = G * np.array(down)
    felt = np.einsum('nji,nj->ni', motion.R, motion.acceleration - gravity)
    felt = felt + np.cross(motion.alpha, com) + np.cross(
        motion.omega, np.cross(motion.omega, com))
    spin = motion.alpha @ INERTIA + np.cross(motion.omega, motion.omega @ INERTIA)
    return np.hstack([-mass * felt, np.cross(com, -mass * felt) - spin])


def pushes(t, rng):
    """Contacts of a second every five seconds, of 5 to 25 N."""
    out = np.zeros((len(t), 6))
    for begin in np.arange(2.0, t[-1] - 1.0, 5.0):
        inside = (t >= begin) & (t < begin + 1.0)
        force = rng.uniform(5.0, 25.0) * _unit(rng.standard_normal(3))
        bump = np.sin(np.pi * (t[inside] - begin))[:, None]**2
        out[inside] = bump * np.concatenate([force, np.cross([0.0, 0.0, 0.15], force)])
    return out


def _unit(vector):
    return vector / np.linalg.norm(vector)


def log(seed, poses=14, hold=3.0, move=1.5, touched=False, rate=RATE, mass=MASS, noise=NOISE):
    """Record the gripper: to calibrate it, or at work with contacts."""
    rng = np.random.default_rng(seed)
    way = path(rng, poses, hold, move)
    t = np.arange(0.0, way.duration, 1 / rate)
    pose_t = np.arange(0.003, way.duration, 1 / POSE_RATE)
    contact = pushes(t, rng) if touched else np.zeros((len(t), 6))
    motion, seen = way.at(t), way.at(pose_t)
    wrench = load(motion, mass) + BIAS + contact + noise * rng.standard_normal((len(t), 6))
    wobble = rotation_from_vector(2e-5 * rng.standard_normal((len(pose_t), 3)))
    place = seen.place + 2e-5 * rng.standard_normal((len(pose_t), 3))
    return Log(t, wrench, contact, np.full(len(t), 'ft_sensor'), pose_t, place,
               quaternion_from_matrix(seen.R @ wobble), _since(EPOCH)(t), _since(EPOCH)(pose_t))


def work(seed, **changes):
    """Record the gripper at work."""
    return log(seed, **{'poses': 16, 'hold': 0.8, 'move': 1.8, 'touched': True} | changes)


def _since(start):
    return lambda t: start + np.rint(t * 1e9).astype(np.int64)


RECEIVED = _since(EPOCH + 10**6)


def write(one, folder):
    """Write a log as a bag, received a millisecond after it was measured."""
    messages = []
    for frame in dict.fromkeys(one.frame.tolist()):
        rows = one.frame == frame
        messages.append(Messages('wrench', WRENCH, RECEIVED(one.t[rows]), encode(
            WRENCH, one.stamp[rows], FIELDS[WRENCH], one.wrench[rows],
            {'header.frame_id': frame})))
    messages.append(Messages('current_pose', POSE, RECEIVED(one.pose_t), encode(
        POSE, one.pose_stamp, FIELDS[POSE], np.hstack([one.place, one.q]),
        {'header.frame_id': 'base'})))
    with BagWriter(folder) as bag:
        bag.write(messages)
    return folder


# What is wrong --------------------------------------------------------------------------------


def held(t, rate):
    """Row of the last sample at a lower rate, for each instant."""
    first = np.floor(t * rate + 1e-9) / rate
    return np.searchsorted(t, first - 1e-9).clip(max=len(t) - 1)


def orientations(one):
    return matrix_from_quaternion(one.q)


def at_wrench(one):
    """R_base_sensor at the stamps of the wrenches."""
    i = np.searchsorted(one.pose_t, one.t).clip(max=len(one.pose_t) - 1)
    return orientations(one)[i]


def in_base(one, rows, parts=(0, 3)):
    R, out = at_wrench(one)[rows], one.wrench.copy()
    for k in parts:
        out[rows, k:k + 3] = np.einsum('nij,nj->ni', R, one.wrench[rows, k:k + 3])
    return out


def half(one):
    return one.t > one.t[-1] / 2


def lowpass(one, hertz):
    filtered = lfilter(*butter(1, hertz, fs=1 / np.median(np.diff(one.t))),
                       one.wrench - one.wrench[0], axis=0)
    contact = lfilter(*butter(1, hertz, fs=1 / np.median(np.diff(one.t))), one.contact, axis=0)
    return replace(one, wrench=filtered + one.wrench[0], contact=contact)


def averaged(one, seconds):
    n = round(seconds / np.median(np.diff(one.t)))
    kernel = np.ones(n) / n
    padded = np.pad(one.wrench, ((n // 2, n - 1 - n // 2), (0, 0)), mode='edge')
    return replace(one, wrench=np.stack(
        [np.convolve(column, kernel, 'valid') for column in padded.T], axis=1))


def without_drift(one, seconds):
    """Take the slow mean off, as drift compensation of a driver does."""
    high = butter(1, 1 / (2 * np.pi * seconds), 'high', fs=1 / np.median(np.diff(one.t)),
                  output='sos')
    return replace(one, wrench=sosfilt(high, one.wrench - one.wrench[0], axis=0))


def lost(one, share, rng, burst=20):
    """Lose bursts of messages of each topic."""
    def keep(n):
        drop = np.repeat(rng.random(-(-n // burst)) < share, burst)[:n]
        return np.flatnonzero(~drop)
    return one.of_wrench(keep(len(one.t))).of_pose(keep(len(one.pose_t)))


def held_where_lost(one, rng, share=0.15, burst=80):
    """Repeat the last reading where the sensor's line fails for 0.4 s."""
    n = len(one.t)
    bad = np.repeat(rng.random(-(-n // burst)) < share, burst)[:n]
    bad[0] = False
    last = np.maximum.accumulate(np.where(bad, 0, np.arange(n)))
    return replace(one, wrench=one.wrench[last])


def twice(one):
    """Record every message twice."""
    return one.of_wrench(np.repeat(np.arange(len(one.t)), 2)).of_pose(
        np.repeat(np.arange(len(one.pose_t)), 2))


def with_other_arm(one, frame):
    """Let another arm's sensor publish on the same topic, two milliseconds later."""
    n = len(one.t)
    rng = np.random.default_rng(99)
    other = load(path(rng, 14, 2.0, 2.0).at(np.minimum(one.t, 50.0)), 0.8) - BIAS
    rows = np.repeat(np.arange(n), 2)
    second = np.arange(2 * n) % 2 == 1
    both = one.of_wrench(rows)
    noisy = other[rows] + NOISE * rng.standard_normal((2 * n, 6))
    return replace(both, t=both.t + 2e-3 * second, stamp=both.stamp + 2_000_000 * second,
                   wrench=np.where(second[:, None], noisy, both.wrench),
                   frame=np.where(second, frame, both.frame))


def of_another_arm(one):
    rng = np.random.default_rng(98)
    motion = path(rng, 40, 2.0, 2.0).at(one.t)
    return replace(one, wrench=load(motion, 0.9) + BIAS + one.contact
                   + NOISE * rng.standard_normal(one.wrench.shape))


def resampled(one, rate):
    """Interpolate poses of a low rate linearly, quaternions too, without norm."""
    few = np.arange(0, len(one.pose_t), round(POSE_RATE / rate))
    q = one.q[few].copy()
    for i in range(1, len(q)):
        q[i] *= np.sign(q[i] @ q[i - 1])
    return replace(one, q=np.stack([np.interp(one.pose_t, one.pose_t[few], x) for x in q.T],
                                   axis=1), place=np.stack(
        [np.interp(one.pose_t, one.pose_t[few], x) for x in one.place[few].T], axis=1))


def wrapped(one, limit):
    """Let one channel of 16 bits wrap around."""
    out = one.wrench.copy()
    out[:, 2] = (out[:, 2] + limit) % (2 * limit) - limit
    return replace(one, wrench=out)


def dead_band(one, limit):
    out = one.wrench.copy()
    out[:, :3][np.abs(out[:, :3]) < limit] = 0.0
    return replace(one, wrench=out)


def zeros_between(one, share, rng):
    out = one.wrench.copy()
    out[rng.random(len(out)) < share] = 0.0
    return replace(one, wrench=out)


def on_a_slope(one, degrees):
    """Let the base of the robot tilt half-way: gravity turns in base, the pose does not say."""
    R = at_wrench(one)
    tilt = np.radians(degrees)
    change = G * MASS * (np.array([np.sin(tilt), 0.0, 1.0 - np.cos(tilt)]))
    extra = np.einsum('nji,j->ni', R, change) * half(one)[:, None]
    return replace(one, wrench=one.wrench + np.hstack([extra, np.cross(COM, extra)]))


def about_another_point(one, lever):
    out = one.wrench.copy()
    out[:, 3:] -= np.cross(lever, out[:, :3])
    return replace(one, wrench=out)


def pulled(one, pull, lever=0.0):
    """Add a force in base by how far the sensor is from its mean place, so far along z of it."""
    place = Stream(one.pose_t, one.place).at(one.t)
    force = np.einsum('nji,nj->ni', at_wrench(one), pull(place - place.mean(axis=0)))
    return replace(one, wrench=one.wrench + np.hstack([
        force, np.cross([0.0, 0.0, lever], force)]))


def bursts(one, size):
    """Stamp on arrival, so many messages at once."""
    last = (np.arange(len(one.t)) // size + 1) * size - 1
    at = one.t[last.clip(max=len(one.t) - 1)] + 5e-5 * (np.arange(len(one.t)) % size)
    return replace(one, stamp=_since(EPOCH)(at))


def _single(start):
    return lambda t: np.rint(np.float32(start + t).astype(float) * 1e9).astype(np.int64)


def _microseconds(t):
    """Write microseconds where nanoseconds belong."""
    ns = _since(EPOCH)(t)
    return ns // 10**9 * 10**9 + ns % 10**9 // 1000


def _of_day(t):
    return np.rint((86_370.0 + t) % 86_400.0 * 1e9).astype(np.int64)


def _winter(t):
    """Clock that goes back by an hour half-way."""
    return _since(EPOCH)(t - 3600.0 * (t > t[-1] / 2))


def _by(factor, unit_of):
    """Read times in another unit, those of receipt too, as where a table was imported."""
    def make(one, rng):
        t, pose_t = factor * one.t, factor * one.pose_t
        return replace(one, t=t, pose_t=pose_t).stamped(_since(EPOCH))
    return Wrong(make, unit_of)


class Wrong(NamedTuple):
    """
    What is wrong with a log.

    Attributes
    ----------
    make : callable
        Takes a Log and a generator, returns the wrong one.
    cause : str
        What a refusal or a note says that names the true cause, as a regular expression.
    """

    make: Callable[[Log, Any], Log]
    cause: str = '$.'


def _wrench(change):
    return lambda one, rng: replace(one, wrench=change(one.wrench))


def _FORCE(factor):
    return np.repeat([factor, 1.0], 3)


def _TORQUE(factor):
    return np.repeat([1.0, factor], 3)


WRONG = {
    'nothing': Wrong(lambda one, rng: one),
    'begins at stamp 0': Wrong(lambda one, rng: one.stamped(_since(0))),
    'stamps of single precision, since boot': Wrong(
        lambda one, rng: one.stamped(_single(65_536.0)), 'stamp'),
    'stamps of single precision, of the epoch': Wrong(
        lambda one, rng: one.stamped(_single(1.7e9)), 'stamp'),
    'microseconds in nanosec': Wrong(lambda one, rng: one.stamped(_microseconds), 'stamp'),
    'stamps of whole seconds': Wrong(
        lambda one, rng: one.stamped(lambda t: _since(EPOCH)(np.floor(t))), 'stamp'),
    'milliseconds as seconds': Wrong(
        lambda one, rng: one.stamped(lambda t: 1000 * _since(0)(t + 1.0)), 'rate|stamp|second'),
    'time of day, past midnight': Wrong(lambda one, rng: one.stamped(_of_day), 'stamps jump'),
    'an hour apart': Wrong(
        lambda one, rng: replace(one, stamp=one.stamp + 3600 * 10**9), r'3600.0 s'),
    'an hour back half-way': Wrong(lambda one, rng: one.stamped(_winter), 'stamps jump'),
    'wrench since boot, pose of the epoch': Wrong(
        lambda one, rng: replace(one, stamp=_since(5 * 10**12)(one.t)), 'another clock|stamps'),
    'every message twice': Wrong(lambda one, rng: twice(one)),
    'stamped on arrival, in bursts of 10': Wrong(
        lambda one, rng: bursts(one, 10), 'jitter|bursts'),
    '30 % lost in bursts': Wrong(lambda one, rng: lost(one, 0.3, rng), 'messages are missing'),
    'another arm on the same topic': Wrong(
        lambda one, rng: with_other_arm(one, 'ft_sensor'), 'two|another|several|merged'),
    'another arm of another frame_id': Wrong(
        lambda one, rng: with_other_arm(one, 'ft_left'), 'frame_id|two'),
    'wrench of another arm': Wrong(
        lambda one, rng: of_another_arm(one), 'different|another'),
    'frame_id and axes change half-way': Wrong(lambda one, rng: replace(
        one, wrench=in_base(one, half(one)), frame=np.where(half(one), 'base', one.frame)),
        'frame_id'),
    'frame_id alone changes half-way': Wrong(
        lambda one, rng: replace(one, frame=np.where(half(one), 'tool0', one.frame)), 'frame_id'),
    'quaternions change sign': Wrong(
        lambda one, rng: replace(one, q=one.q * rng.choice([-1.0, 1.0], (len(one.q), 1)))),
    'quaternions w first': Wrong(
        lambda one, rng: replace(one, q=one.q[:, [3, 0, 1, 2]]), 'order w, x, y, z'),
    'pose of base in the sensor': Wrong(
        lambda one, rng: replace(one, q=one.q * [-1.0, -1.0, -1.0, 1.0]),
        'inverted'),
    'pose repeats at 10 Hz': Wrong(
        lambda one, rng: replace(one, **{name: getattr(one, name)[held(one.pose_t, 10.0)]
                                         for name in ('place', 'q')}), 'repeat|10 Hz|10 a second'),
    'poses interpolated from 2 Hz': Wrong(
        lambda one, rng: resampled(one, 2.0), 'interpolated'),
    'poses of two digits': Wrong(
        lambda one, rng: replace(one, q=np.round(one.q, 2), place=np.round(one.place, 2)),
        'digits|round|steps'),
    'wrench behind a low-pass of 10 Hz': Wrong(lambda one, rng: lowpass(one, 10.0), 'low-pass'),
    'wrench behind a low-pass of 0.5 Hz': Wrong(
        lambda one, rng: lowpass(one, 0.5), 'filter|smooth'),
    'wrench averaged over 1 s': Wrong(
        lambda one, rng: averaged(one, 1.0), 'filter|smooth|average'),
    'wrench of 10 Hz published at 200': Wrong(
        lambda one, rng: replace(one, wrench=one.wrench[held(one.t, 10.0)]), 'repetitions|10 Hz'),
    'wrench 80 ms late': Wrong(lambda one, rng: replace(
        one, stamp=one.stamp + 80_000_000), 'late|delay|behind|clock'),
    'torque about the tool centre': Wrong(
        lambda one, rng: about_another_point(one, [0.0, 0.0, 0.15]), 'centre of mass'),
    'force alone, torque zero': Wrong(
        _wrench(lambda w: w * [1, 1, 1, 0, 0, 0]), 'torque.* constant at 0'),
    'force alone, torque NaN': Wrong(
        _wrench(lambda w: np.where(np.arange(6) < 3, w, np.nan)), 'not finite.*torque'),
    'counts, 1000 a newton': Wrong(_wrench(lambda w: np.round(1000.0 * w)), 'count|mN|unit'),
    'counts, 10^6 a newton': Wrong(_wrench(lambda w: np.round(1e6 * w)), 'count|unit'),
    'force and torque exchanged': Wrong(
        _wrench(lambda w: w[:, [3, 4, 5, 0, 1, 2]]), 'swapped|torque'),
    'torque in base, force not': Wrong(
        lambda one, rng: replace(one, wrench=in_base(one, np.full(len(one.t), True), (3,))),
        'torques? .*(base|axes)'),
    'weight taken off by the driver': Wrong(
        lambda one, rng: replace(one, wrench=one.wrench - _weight(one, MASS)),
        'weigh'),
    'dead band of 2 N': Wrong(lambda one, rng: dead_band(one, 2.0), 'dead band'),
    'drift compensation of 20 s': Wrong(
        lambda one, rng: without_drift(one, 20.0), 'drift|tared'),
    '2 % zero packets': Wrong(
        lambda one, rng: zeros_between(one, 0.02, rng), 'zero'),
    'last reading where the line fails': Wrong(held_where_lost, 'repeat'),
    'a channel of 16 bits wraps': Wrong(lambda one, rng: wrapped(one, 10.0), 'overflow'),
    'base tilts by 5 deg half-way': Wrong(
        lambda one, rng: on_a_slope(one, 5.0), 'base|level|tilt'),
    'a table in ms, read as s': _by(1e3, 'time (is )?in ms'),
    'a table in us, read as s': _by(1e6, 'time is in ms or us'),
    'a table in s, read as ms': _by(1e-3, 's (but )?read as ms'),
    'a table in s, read as us': _by(1e-6, 's (but )?read as ms'),
    'numbers of rows as seconds': _by(RATE, 'counts rows'),
    'position in mm': Wrong(
        lambda one, rng: replace(one, place=1e3 * one.place), 'it is in mm'),
    'position in cm': Wrong(
        lambda one, rng: replace(one, place=1e2 * one.place), 'position is in cm'),
    'position in inches': Wrong(
        lambda one, rng: replace(one, place=one.place / 0.0254), 'position is in inches'),
    'position in m, read as mm': Wrong(
        lambda one, rng: replace(one, place=1e-3 * one.place), 'in m but read as mm'),
    'torque in N mm': Wrong(_wrench(lambda w: w * _TORQUE(1e3)), 'N mm'),
    'torque in N cm': Wrong(_wrench(lambda w: w * _TORQUE(1e2)), 'N cm'),
    'torque in kN m': Wrong(_wrench(lambda w: w * _TORQUE(1e-3)), 'kN m'),
    'torque in lbf in': Wrong(
        _wrench(lambda w: w * _TORQUE(1 / 0.1129848290276167)), 'lbf in'),
    'force in kgf': Wrong(_wrench(lambda w: w * _FORCE(1 / G)), 'kgf'),
    'force and torque in kgf, kgf m': Wrong(_wrench(lambda w: w / G), 'kgf'),
    'force in lbf': Wrong(_wrench(lambda w: w * _FORCE(1 / 4.4482216152605)), 'lbf'),
    'force in mN': Wrong(_wrench(lambda w: w * _FORCE(1e3)), 'mN'),
    'force in kN': Wrong(_wrench(lambda w: w * _FORCE(1e-3)), 'kN'),
    'played at half speed, stamped anew': Wrong(
        lambda one, rng: one.stamped(lambda t: _since(EPOCH)(2.0 * t)), 'time|stamps|speed|clock'),
}


def _weight(one, mass):
    force = -mass * G * at_wrench(one)[:, 2]
    return np.hstack([force, np.cross(COM, force)])


def recording_of(one):
    """Return a log as it is read, where its stamps are in order."""
    start = min(one.stamp[0], one.pose_stamp[0])
    return Recording(
        wrench=Stream((one.stamp - start) / 1e9, one.wrench, str(one.frame[0])),
        pose=PoseStream((one.pose_stamp - start) / 1e9, one.place, orientations(one)),
        start_ns=int(start))
