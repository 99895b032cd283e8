"""Motion as commands and sensors show it, never as the word of a phase has it.

A phase is announced when its first command is due. On a busy computer the commands come later,
and the robot later still, so that a phase ``move`` may begin, and a phase ``measure`` too, with a
robot that does something else.
"""

from collections.abc import Iterator
from itertools import pairwise

from forcecal_ros.checks import limits
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import (
    FREE,
    phase_spans,
    PoseStream,
    Recording,
    STILL,
    Stream,
)
import numpy as np
from numpy.typing import NDArray


def refuse_frozen_pose(recording: Recording) -> None:
    """
    Refuse a pose that repeats itself to the last bit while the robot moves.

    A robot that was late to move goes on from where it stood; a pose that had been frozen jumps,
    or repeats itself to the end. That the robot moved meanwhile the commands say, and where none
    were recorded the other sensors.

    Raises
    ------
    DataError
        Says when, and what moved.
    """
    pose = recording.pose
    if pose is None or len(pose) < 3:
        return
    for first, last in _repetitions(pose):
        start, end = float(pose.t[first]), float(pose.t[last])
        goes_on = last + 1 < len(pose)
        if goes_on and not _jumps(pose, last):
            continue
        late = limits.LATE if goes_on else limits.LATE_AT_END
        if what := _what_moves(recording, start, end - late):
            raise DataError(f'current_pose repeats itself to the last bit from {start:.2f} s '
                            f'to {end:.2f} s of {recording.source or "the recording"}, while '
                            f'{what}; look at its driver')


def refuse_silent_pose(recording: Recording) -> None:
    """
    Refuse a pose that falls silent for good while the robot moves on.

    Raises
    ------
    DataError
        Says when, and what moved.
    """
    pose, others = recording.pose, (recording.wrench, recording.accelerometer)
    if pose is None or not len(pose):
        return
    start = float(pose.t[-1])
    end = max((float(stream.t[-1]) for stream in others if stream is not None), default=start)
    if what := _what_moves(recording, start, end - limits.LATE_AT_END):
        raise DataError(f'current_pose says nothing from {start:.2f} s on of '
                        f'{recording.source or "the recording"}, while {what}; look at its driver')


def _repetitions(pose: PoseStream) -> Iterator[tuple[int, int]]:
    """First and last sample of each stretch that repeats itself for long."""
    rows = np.hstack([pose.R_base_sensor.reshape(len(pose), 9), np.nan_to_num(pose.position)])
    changes = np.flatnonzero((np.diff(rows, axis=0) != 0).any(axis=1))
    firsts, lasts = np.append(0, changes + 1), np.append(changes, len(pose) - 1)
    long = pose.t[lasts] - pose.t[firsts] >= limits.FROZEN
    yield from zip(firsts[long].tolist(), lasts[long].tolist())


def _jumps(pose: PoseStream, last: int) -> bool:
    """Say whether a pose goes on after ``last`` as none that had stood there could."""
    there, next_one = _way(pose, last, last + 1), _way(pose, last + 1, last + 2)
    t = np.append(pose.t, pose.t[-1] + pose.t[last + 1] - pose.t[last])
    speed, following = there / (t[last + 1] - t[last]), next_one / (t[last + 2] - t[last + 1])
    return there > 1.0 and speed > limits.JUMPED * following


def _way(pose: PoseStream, i: int, j: int) -> float:
    """Way between two samples, in what has moved for certain; zero beyond the end."""
    if j >= len(pose):
        return 0.0
    return float(_ways(pose.between(pose.t[i], np.nextafter(pose.t[j], np.inf)))[-1])


def _ways(pose: PoseStream) -> Array:
    """Ways from the first sample, in what has moved for certain."""
    turned = np.linalg.norm(rotation_vector(pose.R_base_sensor[0].T @ pose.R_base_sensor), axis=1)
    moved = np.linalg.norm(np.nan_to_num(pose.position - pose.position[0]), axis=1)
    return np.asarray(np.maximum(turned / limits.TURNED, moved / limits.MOVED))


def _what_moves(recording: Recording, start: float, end: float) -> str:
    """Say what moves in a stretch of time, by the commands if there are any; empty: nothing."""
    target = recording.target
    if target is not None and len(target) and target.t[0] < end:
        held = max(0, int(np.searchsorted(target.t, start, side='right')) - 1)
        sent = target.between(float(target.t[held]), end)
        return 'the commands move' if len(sent) > 1 and _ways(sent).max() > 1.0 else ''
    start += limits.RINGING
    for name in ('angular_velocity', 'accelerometer', 'wrench'):
        stream: Stream | None = getattr(recording, name)
        if stream is not None and _changes(stream, name, recording, start, end):
            return f'the {name.replace("_", " ")} says that the robot moves'
    return ''


def _changes(stream: Stream, name: str, recording: Recording, start: float, end: float) -> bool:
    """
    Say whether a sensor shows that the robot moves.

    A wrench shows it only where nothing touches the tool, which phases alone can say.
    """
    spans = [(-np.inf, np.inf)] if name != 'wrench' else phase_spans(
        recording.phases, (*FREE, *STILL))
    means, errors = _means(stream, float(stream.t[0]), float(stream.t[-1]))
    if not len(means):
        return False
    usual = np.ptp(means, axis=0)
    if name == 'accelerometer':
        tilted = limits.TILTED / limits.LARGE * np.linalg.norm(means.mean(axis=0))
        usual = np.maximum(usual, tilted)
    for begin, stop in spans:
        means, errors = _means(stream, max(start, begin), min(end, stop))
        if len(means) > 1:
            change = np.ptp(means, axis=0)
            certain = change > limits.CERTAIN * np.median(errors, axis=0)
            if (certain & (change > limits.LARGE * usual)).any():
                return True
    return False


def _means(stream: Stream, start: float, end: float) -> tuple[Array, Array]:
    """Means over equal stretches, with their standard errors were the noise white."""
    count = max(0, int((end - start) / limits.AVERAGED))
    edges = np.searchsorted(stream.t, start + limits.AVERAGED * np.arange(count + 1))
    parts = [stream.values[i:j] for i, j in pairwise(edges) if j - i > 3]
    if not parts:
        none = np.empty((0, stream.values.shape[1]))
        return none, none
    return (np.array([part.mean(axis=0) for part in parts]),
            np.array([part.std(axis=0) / np.sqrt(len(part)) for part in parts]))


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
    origin = start - limits.BEFORE
    cut = pose.between(origin, end)
    slices = int((end - origin) / limits.SLICE)
    edges = np.searchsorted(cut.t, origin + limits.SLICE * np.arange(slices + 1))
    if slices < 4 or np.diff(edges).min() < 3:
        return start, end
    moving = _moving(cut, edges)
    borders = np.flatnonzero(np.diff(np.concatenate([[True], moving, [True]]).astype(int)))
    if not moving.any() or not len(borders):
        return start, end
    begins, ends = borders[::2], borders[1::2]
    i = int(np.argmax(ends - begins))
    stop = end if ends[i] == len(moving) else float(origin + limits.SLICE * ends[i])
    stopped = float(origin + limits.SLICE * (begins[i] + 1)) if begins[i] else -np.inf
    if stop - max(start, stopped) < limits.SHORTEST_REST:
        return start, end
    return max(start, min(stopped + limits.SETTLING, stop - limits.SHORTEST_REST)), stop


def _moving(cut: PoseStream, edges: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Say of each pair of neighbouring slices whether the pose moves from one to the next."""
    turned = rotation_vector(cut.R_base_sensor[len(cut) // 2].T @ cut.R_base_sensor)
    rows = np.hstack([turned / limits.TURN_RATE, np.nan_to_num(cut.position) / limits.SPEED])
    steps = np.diff(rows, axis=0)
    noise = 1.48 / np.sqrt(2.0) * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0)
    means = np.array([rows[i:j].mean(axis=0) for i, j in pairwise(edges)])
    doubt = 5.0 * noise * np.sqrt(2.0 / np.diff(edges).min())
    way = np.maximum(np.abs(np.diff(means, axis=0)) - doubt, 0.0)
    return np.asarray(np.linalg.norm(way, axis=1) > limits.SLICE)
