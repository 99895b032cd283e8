"""What recordings must hold to be compared, and pauses that are bridged."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from forcecal_ros.checks.hypotheses import judge, Known
from forcecal_ros.checks.messages import Stated
from forcecal_ros.checks.signals import pauses, SENSORS
from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.core.topics import ROLES
from forcecal_ros.effects.rig import Rig
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

LONGEST = 60.0
"""Pause of a recording, at most, that is bridged [s]."""

SETTLING = 1.0
"""Time after a pause that is left out: the robot went there nobody knows how [s]."""

STAGES = {'wrench': 'wrench_sensor and environment', 'accelerometer': 'accelerometer'}
"""Stages that only one stream shows, by that stream."""


def require_same_sensors(recordings: Sequence[Recording]) -> None:
    """
    Refuse a second recording that lacks a sensor of the first, or has one more.

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


def require_axes_of(rig: Rig, recordings: Iterable[Recording], by: str = 'rig') -> None:
    """
    Refuse wrenches whose frame, axes or units are not those of a rig.

    Parameters
    ----------
    recordings : iterable of Recording
        Checked.
    by : str
        ``rig`` or ``calibration``: where the model is.

    Raises
    ------
    DataError
        Names cause and remedy.
    """
    for recording in recordings:
        gravity = np.array(rig.gravity)
        judge(recording, gravity, Stated(gravity / np.linalg.norm(gravity),
                                         sensor_from_pose=recording.sensor_from_pose, by=by),
              Known(rig.tool.mass, np.array(rig.tool.com)))


def require_overlap(recording: Recording, reference: str, shortest: float) -> None:
    """
    Refuse sensors that were recorded for too short a time together with another stream.

    Parameters
    ----------
    reference : str
        That stream.
    shortest : float
        [s]

    Raises
    ------
    DataError
        With the sensors.
    """
    clock = getattr(recording, reference)
    if clock is None or not len(clock):
        return
    short = {}
    for name in SENSORS:
        if name != reference and _has(recording, name):
            t = getattr(recording, name).t
            common = float(min(t[-1], clock.t[-1]) - max(t[0], clock.t[0]))
            if common < min(shortest, clock.t[-1] - clock.t[0]):
                short[name] = max(0.0, common)
    if short:
        listed = ', '.join(f'{name} {below(common, shortest)} s'
                           for name, common in short.items())
        raise DataError(f'too little was recorded together with {ROLES[reference].topic}: '
                        f'{listed}; {shortest:g} s are needed, record all topics throughout')


def missing_streams(recording: Recording) -> str:
    """
    Say which stages a recording cannot show because a stream is missing.

    Returns
    -------
    str
        To be put behind a sentence; empty where nothing is missing.
    """
    missing = [f'{stages} (no {name} to compare)' for name, stages in STAGES.items()
               if not _has(recording, name)]
    return f'; not looked at: {", ".join(missing)}' if missing else ''


def _has(recording: Recording, name: str) -> bool:
    stream = getattr(recording, name)
    return stream is not None and len(stream) > 0


def bridged(recording: Recording) -> Recording:
    """
    Go over pauses of the whole recording, in which it is not known what was commanded.

    The robot is taken from the last command to the next one, and what sensors say until it has
    settled there is left out.

    Parameters
    ----------
    recording : Recording
        With commands.

    Raises
    ------
    DataError
        A pause is too long.
    """
    changed: dict[str, Any] = {n: getattr(recording, n) for n in SENSORS if _has(recording, n)}
    target = recording.target
    assert target is not None
    for start, end in pauses(recording):
        if end - start > LONGEST:
            raise DataError(f'nothing was recorded for {end - start:.0f} s from {start:.1f} s on; '
                            'cut the recording there, and give one part as --heldout')
        target = _with_way(target, start, end)
        changed = {name: _without(s, start, end + SETTLING) for name, s in changed.items()}
    return replace(recording, target=target, **changed)


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
    return stream.rows((stream.t <= start) | (stream.t >= end))
