"""Static poses: how the paper orients the sensor, where a robot stands still, and means there."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from forcecal_ros.checks.signals import Clipping, columns, PAUSE_PERIODS, PAUSE_S
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_about, rotation_from_vector, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording, STILL, Stream
from forcecal_ros.core.topics import require
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_ROUNDING = 1e-6
"""By how much stamps of phases are rounded [s]."""

_SHORTEST_STAND = 0.5
"""A robot that stands for less has not stopped to be measured [s]."""

_RING_DOWN = 1.0
"""Left out after the robot has stopped, for the tool to ring down [s]."""

_SPEED = 0.002
"""Speed, and angular speed, below which the robot stands [m/s], [rad/s]."""

_AVERAGED = 0.1
"""Means of poses over so long are compared [s], which evens out a pose's noise."""

_CERTAIN = 5.0
"""Standard errors of a difference beyond which it is motion: one in 10^5 is by chance."""


_HELD = 1.5
"""A robot that is held by hand, or yields, sways; it stands where it stays for so long [s] within
what one that creeps at the speeds above does meanwhile."""

_TRIMMED = 0.5
"""So much of a stand at most that ends in motion is the motion's own, and no sway [s]."""


class NeverAtRest(DataError):
    """The robot moves throughout a recording."""


class StaticPose(NamedTuple):
    """
    A stretch of time in which the robot stands still.

    Attributes
    ----------
    start, end : float
        ``start <= t < end`` [s].
    R_base_sensor : ndarray, shape (3, 3)
    rotation_variance : float
        Of its rotation vector, per axis [rad^2]; NaN where one sample tells nothing.
    """

    start: float
    end: float
    R_base_sensor: Array
    rotation_variance: float

    def gravity(self, magnitude: float) -> Array:
        """Gravity in ft_sensor, shape (3,) [m/s^2]."""
        return -magnitude * np.asarray(self.R_base_sensor[2])


def orientation_h(theta: float = 0.0, alpha: float = np.pi / 2, delta: float = np.pi) -> Array:
    """
    Orientation of step 1: x of ft_sensor vertical, [Gamez2005] Eq. 9.

    Parameters
    ----------
    theta, alpha, delta : float
        About Z, Y and X [rad]; those of the paper where not given.

    Returns
    -------
    ndarray, shape (3, 3)
        R_base_sensor, the matrix written out in [Gamez2005] Eq. 10.
    """
    return rotation_about('y', alpha) @ orientation_v(theta, delta)


def orientation_v(theta: float = 0.0, delta: float = np.pi) -> Array:
    """
    Orientation of step 3: x of ft_sensor horizontal, [Gamez2005] Eq. 12.

    Parameters
    ----------
    theta, delta : float
        About Z and X [rad]; those of the paper where not given.

    Returns
    -------
    ndarray, shape (3, 3)
        R_base_sensor, the matrix written out in [Gamez2005] Eq. 13.
    """
    return rotation_about('x', delta) @ rotation_about('z', theta)


def static_windows(recording: Recording) -> list[tuple[float, float]]:
    """
    Find the stretches of time in which the robot stands to be measured.

    Phases say so where there are any, less what the measured pose still moves in them; otherwise
    the pose that does not move does.

    Parameters
    ----------
    recording : Recording
        With a pose.

    Returns
    -------
    list of tuple of float
        Start and end [s].

    Raises
    ------
    DataError
        There is none; :class:`NeverAtRest` where the pose moves throughout.
    """
    assert recording.pose is not None
    if recording.phases:
        last = recording.phases[-1].end
        windows = [(p.start - _ROUNDING, p.end + (_ROUNDING if p.end == last else -_ROUNDING))
                   for p in recording.phases if p.name in STILL]
        if not windows:
            raise DataError(
                f'{recording.source or "the recording"}: none of its {len(recording.phases)} '
                "phases is `measure`; record the sequencer's phases")
        return [rest_within(recording.pose, *window) for window in windows]
    standstills = _standstills(recording.pose)
    windows = (standstills if recording.wrench is None
               else _recorded_throughout(recording.wrench, standstills))
    if standstills and not windows:
        raise DataError(
            f'{recording.source or "the recording"}: no wrench in any of the {len(standstills)} '
            'places where the robot stood; record both at once, by one clock')
    if not windows:
        raise NeverAtRest(
            f'{recording.source or "the recording"}: the pose never stands still for '
            f'{_SHORTEST_STAND + _RING_DOWN:g} s; hold each pose longer')
    return windows


def _recorded_throughout(wrench: Stream, windows: list[tuple[float, float]]
                         ) -> list[tuple[float, float]]:
    """Keep what the wrench was recorded in throughout: of its pauses the checks tell."""
    if not len(wrench):
        return []
    pause = max(PAUSE_S, PAUSE_PERIODS / wrench.rate) if len(wrench) > 1 else np.inf
    kept = []
    for start, end in windows:
        start, end = max(start, float(wrench.t[0])), min(end, float(wrench.t[-1]))
        inside = wrench.between(start, np.nextafter(end, np.inf)).t
        if end - start >= _SHORTEST_STAND and len(inside) and (
                np.diff(np.concatenate([[start], inside, [end]])).max() < pause):
            kept.append((start, end))
    return kept


def _standstills(pose: PoseStream) -> list[tuple[float, float]]:
    """Stretches without motion, the first second of each left to the tool's ringing."""
    step = max(1, round(float(_AVERAGED / np.median(np.diff(pose.t))))) if len(pose) > 2 else 1
    n = len(pose) // step
    if n < 3:
        return []
    t = pose.t[:n * step].reshape(n, step).mean(axis=1)
    R = pose.R_base_sensor[:n * step].reshape(n, step, 3, 3)
    about = R[:, step // 2]
    mean = about @ rotation_from_vector(
        rotation_vector(np.swapaxes(about, 1, 2)[:, np.newaxis] @ R).mean(axis=1))
    ways: list[_Way] = [(lambda i, j: rotation_vector(np.swapaxes(mean[i], 1, 2) @ mean[j]),
                         _SPEED, rotation_vector(np.swapaxes(
                             pose.R_base_sensor[:-1], 1, 2) @ pose.R_base_sensor[1:]))]
    if pose.has_position:
        place = pose.position[:n * step].reshape(n, step, 3).mean(axis=1)
        ways.append((lambda i, j: place[j] - place[i], _SPEED, np.diff(pose.position, axis=0)))
    windows = []
    for first, last in _stands(t, ways, step):
        begin = t[first] + (_RING_DOWN if first else 0.0)
        if t[last] - begin >= _SHORTEST_STAND:
            windows.append((float(begin), float(t[last])))
    return windows


_Way = tuple[Callable[[slice, slice], Array], float, Array]
"""Way between means, the speed below which it is none, and the ways between samples."""


def _stands(t: Array, ways: list[_Way], step: int) -> Iterator[tuple[int, int]]:
    """First and last mean of each stretch in which a robot stands, however it sways."""
    n = len(t)
    span = max(2, round(_HELD / float(np.median(np.diff(t)))))
    moving, stays = np.zeros(n - 1, dtype=bool), np.ones(max(0, n - span), dtype=bool)
    for way, slowest, between_samples in ways:
        by_chance = _by_chance(between_samples, step)
        moving |= _far(way(slice(None, -1), slice(1, None)), slowest * np.diff(t) + by_chance)
        for j in range(1, span + 1):
            stays &= ~_far(way(slice(0, n - span), slice(j, n - span + j)),
                           slowest * _HELD + by_chance)
    held = np.zeros(n - 1, dtype=bool)
    for j in range(span):
        held[j:j + len(stays)] |= stays
    edges = np.flatnonzero(np.diff(np.concatenate([[True], moving & ~held, [True]]).astype(int)))
    most = round(_TRIMMED / _HELD * span)
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist()):
        still = np.flatnonzero(~moving[first:last])
        begin, end = (still[0], still[-1] + 1) if len(still) else (0, last - first)
        yield first + min(int(begin), most), last - min(last - first - int(end), most)


def _far(way: Array, limit: Array | float) -> NDArray[np.bool_]:
    return np.asarray(np.linalg.norm(way, axis=1) > limit)


def _by_chance(between_samples: Array, step: int) -> float:
    """
    Return how far means of ``step`` samples are apart by a pose's noise alone.

    Second differences of samples are noise, whatever the motion: of white noise sqrt(6) of it.
    """
    noise = np.median(np.abs(np.diff(between_samples, axis=0))) / (0.6745 * np.sqrt(6.0))
    return float(_CERTAIN * np.sqrt(2.0 / step) * noise)


def static_poses(recording: Recording) -> list[StaticPose]:
    """
    Measure the orientation of each static pose.

    Raises
    ------
    DataError
        No pose was recorded, or none while the robot stood.
    """
    pose = recording.pose
    name = recording.source or 'the recording'
    require(recording, ['pose'])
    assert pose is not None
    poses, empty = [], []
    for start, end in static_windows(recording):
        R = pose.between(start, end).R_base_sensor
        if len(R):
            poses.append(StaticPose(start, end, *_mean_rotation(np.asarray(R))))
        else:
            empty.append(f'{start:.2f}')
    if empty:
        raise DataError(f'{name}: no current_pose during the static poses that start at '
                        f'{", ".join(empty)} s; record it throughout')
    return poses


def _mean_rotation(R: Array) -> tuple[Array, float]:
    mean = Rotation.from_matrix(np.array(R)).mean().as_matrix()
    if len(R) < 2:
        return mean, np.nan
    scatter = rotation_vector(mean.T @ R)
    return mean, float((scatter**2).sum() / (3 * (len(R) - 1)) / len(R))


SHORTEST_REST_S = 0.3
"""So much of a phase at rest is kept [s]."""


def rest_within(pose: PoseStream, start: float, end: float) -> tuple[float, float]:
    """
    Cut off where the measured pose still, or already, moves in a phase at rest.

    Parameters
    ----------
    start, end : float
        Of the phase [s].

    Returns
    -------
    tuple of float
        Start and end [s] of the longest rest; those given where the pose does not move, and where
        it moves nearly all along, which is for the fit to judge.
    """
    origin = start - 0.2  # a motion that ends so shortly before still rings [s]
    cut = pose.between(origin, end)
    slices = int((end - origin) / _AVERAGED)
    edges = np.searchsorted(cut.t, origin + _AVERAGED * np.arange(slices + 1))
    if slices < 4 or np.diff(edges).min() < 3:
        return start, end
    moving = _moving(cut, edges)
    borders = np.flatnonzero(np.diff(np.concatenate([[True], moving, [True]]).astype(int)))
    if not moving.any() or not len(borders):
        return start, end
    begins, ends = borders[::2], borders[1::2]
    i = int(np.argmax(ends - begins))
    stop = end if ends[i] == len(moving) else float(origin + _AVERAGED * ends[i])
    stopped = float(origin + _AVERAGED * (begins[i] + 1)) if begins[i] else -np.inf
    if stop - max(start, stopped) < SHORTEST_REST_S:
        return start, end
    return max(start, min(stopped + 0.5, stop - SHORTEST_REST_S)), stop


def _moving(cut: PoseStream, edges: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Say of each pair of neighbouring slices whether the pose moves from one to the next."""
    turned = rotation_vector(cut.R_base_sensor[len(cut) // 2].T @ cut.R_base_sensor)
    rows = np.hstack([turned / 0.01, np.nan_to_num(cut.position) / 0.005])
    steps = np.diff(rows, axis=0)
    noise = 1.48 / np.sqrt(2.0) * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0)
    means = np.array([rows[i:j].mean(axis=0) for i, j in pairwise(edges)])
    least = 5.0 * noise * np.sqrt(2.0 / np.diff(edges).min())
    way = np.maximum(np.abs(np.diff(means, axis=0)) - least, 0.0)
    return np.asarray(np.linalg.norm(way, axis=1) > _AVERAGED)


def values_in(stream: Stream, poses: Sequence[StaticPose]) -> list[Array]:
    """Return the samples of a stream in each static pose, (n_i, k)."""
    return [np.asarray(stream.between(pose.start, pose.end).values) for pose in poses]


def window_mean(stream: Stream, start: float, end: float, what: str = 'signal') -> Array:
    """
    Mean of a signal while the robot stands still, [Gamez2005] Eq. 11, [Gamez2005] Eq. 14.

    Parameters
    ----------
    start, end : float
        ``start <= t < end`` [s].
    what : str
        For the message.

    Returns
    -------
    ndarray, shape (k,)

    Raises
    ------
    DataError
        There is no sample.
    """
    values = stream.between(start, end).values
    if not len(values):
        raise DataError(f'no {what} between {start:.3f} s and {end:.3f} s, where the robot stood '
                        'to be measured; record it throughout')
    return np.asarray(values.mean(axis=0))


MOSTLY = 0.5
"""From this share of a pose on that is spent at a limit, its mean is the limit, not the load."""


def require_wrench(recording: Recording) -> Stream:
    """
    Return the wrench.

    Raises
    ------
    DataError
        There is none.
    """
    require(recording, ['wrench'])
    assert recording.wrench is not None
    return recording.wrench


def refuse_poses_at_a_limit(recording: Recording, stops: Iterable[Clipping],
                            poses: Iterable[StaticPose]) -> None:
    """
    Refuse channels that stand at the end of their range while the robot stands in a pose.

    Parameters
    ----------
    stops : iterable of Clipping
        Where channels stop.
    poses : iterable of StaticPose
        At rest.

    Raises
    ------
    DataError
        Names the channels, their limits and the poses.
    """
    channels = {name: (t, values) for name, t, values in columns(recording)}
    found = [f'{stop.channel} stands at {stop.limit:.6g} in pose {i + 1}'
             for i, pose in enumerate(poses) for stop in stops
             if _stands_at(*channels[stop.channel], pose, stop.limit)]
    if found:
        raise DataError(f'{"; ".join(found)}: the end of its range; raise the range of the '
                        'sensor')


def _stands_at(t: Array, values: Array, pose: StaticPose, limit: float) -> bool:
    at = values[(t >= pose.start) & (t < pose.end)] == limit
    return len(at) > 0 and bool(at.mean() >= MOSTLY)
