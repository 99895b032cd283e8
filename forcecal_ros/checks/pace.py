"""How fast a recording's rows follow one another and its robot moves: what no clock and no arm do.

Times in another unit (milliseconds taken for seconds, numbers of rows) leave a recording whole but
for its pace: readings come at a rate that no sensor has, and the arm creeps, or flies.
"""

from collections.abc import Mapping
from itertools import permutations

from forcecal_ros.checks import limits
from forcecal_ros.checks.clocks import means_between
from forcecal_ros.checks.units import mended
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
import numpy as np

SPAN = 50
"""Intervals that a rate is averaged over: bursts of arrival are shorter."""

_SHOWN = 0.75
"""Share of the inertia that sound logs show, 0.5 to 1."""

_STATE = ('state its unit in the specification of forcecal import, or mend the stamps in the '
          'driver')


def refuse_other_pace(recording: Recording) -> None:
    """
    Refuse times in another unit, and poses that turn or move as fast as no arm does.

    Raises
    ------
    DataError
        Names rate and speed, and the unit that they tell of.
    """
    streams = {name: stream for name in ('wrench', 'pose', 'accelerometer')
               if (stream := getattr(recording, name)) is not None
               and len(stream) >= limits.PACED}
    if not streams:
        return
    fastest = max(streams, key=lambda name: _rate(streams[name]))
    rate = _rate(streams[fastest])
    if rate > limits.MOST_RATE:
        raise DataError(
            f'{fastest}: {rate:.3g} readings a second, more than any sensor or robot sends: its '
            f'time is in another unit (s taken for ms, or ms for us); {_STATE}')
    _refuse_other_spans(streams)
    pose = recording.pose
    if pose is None or 'pose' not in streams:
        return
    slow = max(rate, _rate(streams[fastest], 1)) < limits.SLOW_RATE
    if slow and (turning := _creeps(pose)):
        raise DataError(
            f'{fastest}: {rate:.2g} readings a second, and the pose turns by {turning:.2g} rad/s '
            'where it turns fastest, as of no robot: time is in ms or us and taken for s, or '
            f'counts rows; {_STATE} (rate: where rows are evenly apart)')
    turning, moving = float(np.quantile(_turns(pose)[1], limits.FAST_SHARE)), speed_of(pose)
    if turning > limits.WHIRLS and moving > limits.FASTEST:
        raise DataError(
            f'pose: it turns by {turning:.3g} rad/s and moves at {moving:.3g} m/s for a tenth of '
            f'the recording, as no arm does: time is in s and taken for ms or us; {_STATE}')
    if turning > limits.WHIRLS:
        raise DataError(
            f'pose: it turns by {turning:.3g} rad/s for a tenth of the recording, as no arm '
            'does: its angles are in degrees and taken for radians, or time is in s and taken '
            f'for ms; {_STATE}')
    if moving > limits.FASTEST:
        raise DataError(f'pose: its position moves at {moving:.3g} m/s for a tenth of the '
                        f'recording, which no arm does: it is in mm; {mended(1e-3, "mm")}')


def refuse_other_length(times: float, std: float, pose: PoseStream) -> None:
    """
    Refuse positions whose accelerations are far from what forces show.

    Parameters
    ----------
    times, std : float
        Inertial force shown over mass times acceleration, and its standard error.

    Raises
    ------
    DataError
        Names the unit that explains it.
    """
    speed = speed_of(pose)
    if speed > limits.OTHER_LENGTH and times + limits.SURE_SHOWN * std < limits.UNSHOWN:
        unit, size = min((('mm', 1e-3), ('cm', 1e-2), ('inches', 0.0254)),
                         key=lambda one: abs(np.log(max(times, limits.TINY) / one[1] / _SHOWN)))
        raise DataError(
            f'pose: its position moves at {speed:.3g} m/s for a tenth of the recording, and '
            f'forces show {times:.2g} of the inertia that this makes: it is in {unit}; '
            f'{mended(size, unit)}')
    if speed < limits.SLOW_HAND and times > max(limits.OVERSHOWN, limits.SURE_SHOWN * std):
        raise DataError(
            f'pose: forces show {times:.3g} times the inertia that its positions make, which '
            f'move at {speed:.2g} m/s: they are in m and taken for mm or cm, or the stamps pass '
            f'{times**0.5:.2g} times too slowly; state their unit in the specification of '
            'forcecal import, or mend the driver')


def refuse_degrees_a_second(recording: Recording) -> None:
    """
    Refuse a gyro that turns as many times as fast as the pose, or gravity, as degrees do.

    Raises
    ------
    DataError
        Says how many times.
    """
    gyro = recording.angular_velocity
    if gyro is None or len(gyro) < limits.PACED:
        return
    times, by = _gyro_beside_pose(gyro, recording.pose), 'the pose turns'
    if not times:
        times, by = _gyro_beside_gravity(gyro, recording), 'gravity turns in the accelerometer'
    if abs(times / np.degrees(1.0) - 1.0) < limits.LIKE_DEGREES:
        raise DataError(f'angular_velocity: it is {times:.3g} times as fast as {by}: it is in '
                        f'deg/s; {mended(np.pi / 180.0, "deg/s")}')


def _gyro_beside_pose(gyro: Stream, pose: PoseStream | None) -> float:
    """Return how many times as fast as the pose a gyro turns; 0: nothing turns, or no pose."""
    if pose is None or len(pose) < limits.PACED:
        return 0.0
    edges = np.arange(max(pose.t[0], gyro.t[0]), min(pose.t[-1], gyro.t[-1]), limits.SLICE)
    if len(edges) < limits.PACED:
        return 0.0
    R = pose.R_base_sensor[np.searchsorted(pose.t, edges)]
    turning = np.linalg.norm(
        rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=1) / limits.SLICE
    said = np.linalg.norm(means_between(gyro.t, gyro.values, edges), axis=1)
    moves = turning > limits.TURNING
    return float(said[moves].sum() / turning[moves].sum()) if moves.any() else 0.0


def _gyro_beside_gravity(gyro: Stream, recording: Recording) -> float:
    """Return how many times as fast as gravity a gyro turns; 0: nothing tells."""
    force = recording.accelerometer
    if force is None or len(force) < limits.PACED or recording.accelerometer_unit == 'V':
        return 0.0
    edges = np.arange(max(force.t[0], gyro.t[0]), min(force.t[-1], gyro.t[-1]), limits.SLICE)
    if len(edges) < limits.PACED:
        return 0.0
    f, rate = (means_between(one.t, one.values, edges) for one in (force, gyro))
    change = (f[2:] - f[:-2]) / (2.0 * limits.SLICE)
    wanted = -np.cross(rate, f)[1:-1]
    both, own, others = (change * wanted).sum(), (change**2).sum(), (wanted**2).sum()
    if both <= limits.FOLLOWS_GYRO * np.sqrt(own * others):
        return 0.0
    return float(others / both)


def _rate(stream: Stream | PoseStream, over: int = SPAN) -> float:
    """Return how many readings come a second, by the median of so many steps [Hz]."""
    n = min(over, len(stream) - 1)
    return n / max(float(np.median(stream.t[n:] - stream.t[:-n])), limits.TINY)


def _refuse_other_spans(streams: Mapping[str, Stream | PoseStream]) -> None:
    """Refuse a stream that lasts a thousand times as long as another one."""
    last = {name: float(one.t[-1] - one.t[0]) for name, one in streams.items()}
    for (long, span), (short, less) in permutations(last.items(), 2):
        for factor, unit in ((1e3, 'ms'), (1e6, 'us')):
            if abs(span / less / factor - 1.0) < limits.SAME_SPAN:
                raise DataError(
                    f'{long}: its {len(streams[long])} readings last {span:.3g} s, the '
                    f'{len(streams[short])} of {short} {less:.3g} s: time is in {unit} in one and '
                    f'in s in the other; {_STATE}')


def _slice(pose: PoseStream, length: float = limits.SLICE) -> int:
    """Return how many poses last so long, a hundredth of them at most."""
    return max(1, min(round(length * _rate(pose)), len(pose) // limits.PACED))


def _turns(pose: PoseStream) -> tuple[Array, Array]:
    """Turn from slice to slice and its speed, shape (k,) [rad], [rad/s]."""
    each = _slice(pose, limits.SHORT_SLICE)
    R = pose.R_base_sensor[::each]
    turned = np.linalg.norm(rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=1)
    return np.asarray(turned), np.asarray(turned / _took(pose, pose.t[::each], each))


def _creeps(pose: PoseStream) -> float:
    """Fastest turn [rad/s] of an arm that is watched as it turns about and creeps; else 0."""
    turned, speed = _turns(pose)
    watched = turned.sum() > limits.TURNED_ABOUT and turned.max() < limits.SEEN_TURNING
    return float(speed.max()) if watched and speed.max() < limits.CREEPS else 0.0


def speed_of(pose: PoseStream) -> float:
    """Return the speed that a tenth of the recording exceeds, by means [m/s]; 0: unknown."""
    each, n = _slice(pose), len(pose) // _slice(pose)
    if not pose.has_position:
        return 0.0
    t, place = (x[:n * each].reshape(n, each, -1).mean(axis=1) for x in (pose.t, pose.position))
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) / _took(pose, t[:, 0], each)
    return float(np.quantile(speed, limits.FAST_SHARE))


def _took(pose: PoseStream, t: Array, each: int) -> Array:
    """Time between slices [s]: half of what they take at least, for poses that come in bursts."""
    return np.asarray(np.diff(t).clip(min=0.5 * each / _rate(pose)))
