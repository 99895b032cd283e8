"""Whether the streams of a recording can be compared: values, clocks, pauses, what is missing."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.diagnose.channels import CHANNELS, COLUMNS
from forcecal_ros.diagnose.datachecks import PAUSE
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import PoseStream, Recording, Stream
from forcecal_ros.recording.topics import ROLES
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

SENSORS = ('wrench', 'accelerometer', 'optidrive', 'pose')

ABSURD = 1e6
"""No sensor reads more, in whatever unit."""

SPOILT = 0.01
"""Share of samples that are no numbers, or absurd, from which a stream is no good."""

TURNED = 0.1
"""Change of the orientation that a sensor has to feel [rad]."""

LONGEST = 60.0
"""Silence that is still replayed [s]."""

SETTLING = 1.0
"""Left out after a pause, in which the robot went nobody knows where [s]."""

STAGES = {'wrench': 'wrench_sensor and environment', 'accelerometer': 'accelerometer'}
"""Stages that only one stream shows."""


class Sound(NamedTuple):
    """A recording that can be compared, and what had to be left out."""

    recording: Recording
    notes: tuple[str, ...]


def sound(recording: Recording, reference: str, shortest: float) -> Sound:
    """
    Check the streams, and leave out single values that no sensor reads.

    Parameters
    ----------
    recording : Recording
    reference : str
        Stream on whose clock the others have to be.
    shortest : float
        For how long they have to be there together [s].

    Returns
    -------
    Sound

    Raises
    ------
    DataError
        Too many values are no numbers or absurd, a sensor is dead, or clocks are apart.
    """
    notes: list[str] = []
    changed: dict[str, Any] = {}
    for name in SENSORS:
        if not _has(recording, name):
            continue
        stream = getattr(recording, name)
        good = _readable(stream)
        bad = 1.0 - float(good.mean())
        if bad > SPOILT:
            raise DataError(f'{name}: {100.0 * bad:.1f} % of the samples are not finite or beyond '
                            f'{ABSURD:g}; check the driver and record again')
        if bad:
            notes.append(f'{name}: {np.sum(~good)} samples are not finite or beyond {ABSURD:g} '
                         'and left out')
            changed[name] = _chosen(stream, good)
        if name != 'pose':
            notes += _stuck(recording, name, good)
    _check_clocks(recording, reference, shortest)
    return Sound(replace(recording, **changed), tuple(notes))


def _stuck(recording: Recording, name: str, good: NDArray[np.bool_]) -> list[str]:
    """Refuse a sensor that says the same for ever, or while it is turned; tell of a channel."""
    stream, pose = getattr(recording, name), recording.pose or recording.target
    t, values = stream.t[good], stream.values[good]
    still = np.ptp(values, axis=0) == 0.0
    if still.all():
        raise DataError(f'{name}: the values never change; check the driver and record again')
    edges = np.flatnonzero((np.diff(values, axis=0) != 0.0).any(axis=1)) + 1
    edges = np.concatenate([[0], edges, [len(t)]])
    longest = int(np.argmax(np.diff(edges)))
    start, end = float(t[edges[longest]]), float(t[edges[longest + 1] - 1])
    R = pose.between(start, end).R_base_sensor if pose is not None else np.zeros((0, 3, 3))
    if name in STAGES and end - start > PAUSE and len(R) and np.abs(R - R[0]).max() > TURNED:
        raise DataError(f'{name}: the values stand still from {start:.1f} s to {end:.1f} s '
                        'while the robot turns; check the driver and record again')
    return [f'{c.name}: the value never changes' for c, x in zip(CHANNELS[COLUMNS[name]], still)
            if x]


def _readable(stream: Stream | PoseStream) -> NDArray[np.bool_]:
    """Say which samples a sensor may have read; of a pose the orientation may be all there is."""
    if isinstance(stream, Stream):
        return np.asarray((np.abs(stream.values) < ABSURD).all(axis=1))
    place = np.nan_to_num(stream.position, nan=0.0, posinf=np.inf, neginf=np.inf)
    return np.asarray((np.abs(place) < ABSURD).all(axis=1)
                      & np.isfinite(stream.R_base_sensor).all(axis=(1, 2)))


def _check_clocks(recording: Recording, reference: str, shortest: float) -> None:
    clock = getattr(recording, reference)
    if clock is None or len(clock) < 2 or clock.t[-1] - clock.t[0] < shortest:
        return
    apart = {}
    for name in SENSORS:
        stream = getattr(recording, name)
        if name == reference or stream is None or not len(stream):
            continue
        common = min(stream.t[-1], clock.t[-1]) - max(stream.t[0], clock.t[0])
        if common < shortest:
            apart[_called(name)] = float(stream.t[0] - clock.t[0])
    if apart:
        listed = ', '.join(f'{name} {way:+.1f} s' for name, way in apart.items())
        raise DataError(f'stamps begin too far from those of {_called(reference)}: {listed}; set '
                        'the clocks of all computers by one (PTP or chrony), or stamp on one '
                        'computer, and record again')


def _called(name: str) -> str:
    topic = ROLES[name].topic
    return name if topic == name else f'{name} ({topic})'


def check_alike(recordings: Sequence[Recording]) -> None:
    """
    Refuse a second recording that lacks a sensor of the first, or has one more.

    Parameters
    ----------
    recordings : sequence of Recording

    Raises
    ------
    DataError
        With the sensors.
    """
    there = [{name for name in SENSORS if _has(r, name)} for r in recordings]
    for other in there[1:]:
        if odd := there[0] ^ other:
            raise DataError(f'only one of the two recordings holds {", ".join(sorted(odd))}; '
                            'record the same topics in both')


def unseen(recording: Recording) -> str:
    """
    Say which stages a recording cannot show because a stream is missing.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    str
        To be put behind a sentence; empty where nothing is missing.
    """
    missing = [f'{stages} (no {name} was recorded)' for name, stages in STAGES.items()
               if not _has(recording, name)]
    return f'; not looked at: {", ".join(missing)}' if missing else ''


def _has(recording: Recording, name: str) -> bool:
    stream = getattr(recording, name)
    return stream is not None and len(stream) > 0


def silences(recording: Recording) -> tuple[str, ...]:
    """
    List when single sensors, or all streams, said nothing for a while.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    tuple of str
    """
    pauses = _pauses(recording)
    own = [(name, *gap) for name in SENSORS if _has(recording, name)
           for gap in _gaps(getattr(recording, name).t)
           if not any(start < gap[1] and gap[0] < end for start, end in pauses)]
    return tuple(f'{who}: nothing was recorded for {end - start:.1f} s from {start:.1f} s on'
                 for who, start, end in (*(('all streams', *p) for p in pauses), *own))


def bridged(recording: Recording) -> Recording:
    """
    Go over pauses of the whole recording, in which it is not known what was commanded.

    The robot is taken from the last command to the next one, and what sensors say until it has
    settled there is left out.

    Parameters
    ----------
    recording : Recording
        With commands.

    Returns
    -------
    Recording

    Raises
    ------
    DataError
        A pause is too long.
    """
    changed: dict[str, Any] = {n: getattr(recording, n) for n in SENSORS if _has(recording, n)}
    target = recording.target
    assert target is not None
    for start, end in _pauses(recording):
        if end - start > LONGEST:
            raise DataError(f'nothing was recorded for {end - start:.0f} s from {start:.1f} s on; '
                            'cut the recording there, and give one part as --heldout')
        target = _with_way(target, start, end)
        changed = {name: _without(s, start, end + SETTLING) for name, s in changed.items()}
    return replace(recording, target=target, **changed)


def _pauses(recording: Recording) -> list[tuple[float, float]]:
    """List when no stream said anything."""
    streams = [getattr(recording, n).t for n in ('target', *SENSORS) if _has(recording, n)]
    return _gaps(np.sort(np.concatenate(streams)))


def _gaps(t: Array) -> list[tuple[float, float]]:
    return [(float(t[i]), float(t[i + 1])) for i in np.flatnonzero(np.diff(t) > PAUSE)]


def _with_way(target: PoseStream, start: float, end: float) -> PoseStream:
    """Fill a pause with commands, in step with those before it, that lead to the next one."""
    i = int(np.searchsorted(target.t, start, side='right')) - 1
    if i < 0 or i + 1 >= len(target):
        return target
    period = float(np.median(np.diff(target.t)))
    t = float(target.t[i]) + period * np.arange(1, np.ceil((end - target.t[i]) / period - 0.5))
    t = t[t > start]
    u = (t - start) / (end - start)
    share = u ** 3 * (10.0 - 15.0 * u + 6.0 * u ** 2)
    way = target.position[i + 1] - target.position[i]
    turned = Slerp([0.0, 1.0], Rotation.from_matrix(target.R_base_sensor[i:i + 2]))(share)
    return replace(
        target, t=np.insert(target.t, i + 1, t),
        position=np.insert(target.position, i + 1,
                           target.position[i] + share[:, np.newaxis] * way, axis=0),
        R_base_sensor=np.insert(target.R_base_sensor, i + 1, turned.as_matrix(), axis=0))


def _without(stream: Stream | PoseStream, start: float, end: float) -> Stream | PoseStream:
    return _chosen(stream, (stream.t <= start) | (stream.t >= end))


def _chosen(stream: Stream | PoseStream, kept: NDArray[np.bool_]) -> Stream | PoseStream:
    if isinstance(stream, PoseStream):
        return replace(stream, t=stream.t[kept], position=stream.position[kept],
                       R_base_sensor=stream.R_base_sensor[kept])
    return replace(stream, t=stream.t[kept], values=stream.values[kept])
