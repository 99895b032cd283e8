"""Static poses: how the paper orients the sensor, where a robot stands still, and means there."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from forcecal_ros.checks.signals import Clipping, columns, PAUSE_PERIODS, PAUSE_S
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import (
    Array,
    continuous_sign,
    quaternion_from_matrix,
    rotation_about,
)
from forcecal_ros.core.streams import PoseStream, Recording, STILL, Stream
from forcecal_ros.core.topics import require
import numpy as np
from scipy.spatial.transform import Rotation

_SHORTEST_STAND = 0.5
"""A robot that stands for less has not stopped to be measured [s]."""

_RING_DOWN = 1.0
"""Left out after the robot has stopped, for the tool to ring down [s]."""

_SPEED = 0.002
"""Speed, and angular speed, below which the robot stands [m/s], [rad/s]."""

_AVERAGED = 0.1
"""Means of poses over so long are compared [s], which evens out a pose's noise."""

_HELD = 1.5
"""A robot that is held by hand, or yields, sways; it stands where it stays for so long [s] within
what one that creeps at the speeds above does meanwhile."""


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
    """

    start: float
    end: float
    R_base_sensor: Array

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
    # by how much stamps of phases are rounded [s]
    rounding = 1e-6
    if recording.phases:
        last = recording.phases[-1].end
        windows = [(p.start - rounding, p.end + (rounding if p.end == last else -rounding))
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
            'static poses; record wrench and pose together, with one clock')
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


def _standstills(pose: PoseStream, ring_down: float = _RING_DOWN,
                 shortest: float = _SHORTEST_STAND) -> list[tuple[float, float]]:
    """Stretches without motion, the first part of each left to the tool's ringing."""
    step = max(1, round(float(_AVERAGED / np.median(np.diff(pose.t))))) if len(pose) > 2 else 1
    n = len(pose) // step
    if n < 3:
        return []
    q = continuous_sign(quaternion_from_matrix(pose.R_base_sensor))
    ways = [2.0 * q, pose.position] if pose.has_position else [2.0 * q]
    t, *means = (np.reshape(x[:n * step], (n, step, -1)).mean(axis=1) for x in (pose.t, *ways))
    by_chance = [_by_chance(way, step) for way in ways]
    windows = []
    for first, last in _stands(t[:, 0], means, by_chance):
        begin = float(t[first, 0]) + (ring_down if first else 0.0)
        if t[last, 0] - begin >= shortest:
            windows.append((begin, float(t[last, 0])))
    return windows


def _stands(t: Array, means: Sequence[Array], by_chance: Sequence[float]
            ) -> Iterator[tuple[int, int]]:
    """First and last mean of each stretch in which a robot stands, however it sways."""
    n = len(t)
    span = max(2, round(_HELD / float(np.median(np.diff(t)))))
    moving, stays = np.zeros(n - 1, dtype=bool), np.ones(max(0, n - span), dtype=bool)
    for way, noise in zip(means, by_chance):
        moving |= np.linalg.norm(np.diff(way, axis=0), axis=1) > _SPEED * np.diff(t) + noise
        for j in range(1, span + 1):
            far = np.linalg.norm(way[j:][:len(stays)] - way[:len(stays)], axis=1)
            stays &= far <= _SPEED * _HELD + noise
    held = np.zeros(n - 1, dtype=bool)
    for j in range(span):
        held[j:j + len(stays)] |= stays
    edges = np.flatnonzero(np.diff(np.concatenate([[True], moving & ~held, [True]]).astype(int)))
    # so much of a stand at most that ends in motion is the motion's own, and no sway [s]
    trimmed = 0.5
    most = round(trimmed / _HELD * span)
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist()):
        still = np.flatnonzero(~moving[first:last])
        begin, end = (still[0], still[-1] + 1) if len(still) else (0, last - first)
        yield first + min(int(begin), most), last - min(last - first - int(end), most)


def _by_chance(samples: Array, step: int) -> float:
    """
    Return how far means of ``step`` samples are apart by a pose's noise alone.

    Second differences of samples are noise, whatever the motion: of white noise sqrt(6) of it.
    """
    noise = np.median(np.abs(np.diff(samples, 2, axis=0))) / (0.6745 * np.sqrt(6.0))
    # standard errors of a difference beyond which it is motion: one in 10^5 is by chance
    certain = 5.0
    return float(certain * np.sqrt(2.0 / step) * noise)


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
            mean = Rotation.from_matrix(np.array(R)).mean()
            poses.append(StaticPose(start, end, mean.as_matrix()))
        else:
            empty.append(f'{start:.2f}')
    if empty:
        raise DataError(f'{name}: no current_pose during the static poses that start at '
                        f'{", ".join(empty)} s; record it throughout')
    return poses


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
        Start and end [s] of the longest rest; those given where there is no pose, where it does
        not move, and where it moves nearly all along, which is for the fit to judge.
    """
    # a motion that ends so shortly before still rings; the least that is kept of a phase [s]
    before, ring_down, shortest = 0.2, 0.5, 0.3
    cut = pose.between(start - before, end)
    if not len(cut.t):
        return start, end
    stands = _standstills(cut, ring_down, shortest)
    first, last = max(stands, key=lambda one: one[1] - one[0], default=(start, end))
    return (max(start, first) if first > cut.t[0] + _AVERAGED else start,
            last if last < cut.t[-1] - 2.0 * _AVERAGED else end)


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
        raise DataError(f'no {what} between {start:.3f} s and {end:.3f} s, during a static pose; '
                        'record it throughout')
    return np.asarray(values.mean(axis=0))


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
    found = [f'{stop.channel} is clipped at {stop.limit:.6g} in pose {i + 1}'
             for i, pose in enumerate(poses) for stop in stops
             if _stands_at(*channels[stop.channel], pose, stop.limit)]
    if found:
        raise DataError(f'{"; ".join(found)}; increase the range of the sensor')


def _stands_at(t: Array, values: Array, pose: StaticPose, limit: float) -> bool:
    at = values[(t >= pose.start) & (t < pose.end)] == limit
    # from this share of a pose on that is spent at a limit, its mean is the limit, not the load
    mostly = 0.5
    return len(at) > 0 and bool(at.mean() >= mostly)
