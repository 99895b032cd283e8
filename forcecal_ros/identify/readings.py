"""What can be used of a recording: numbers only, sensors within their range."""

from dataclasses import replace

from forcecal_ros.errors import DataError
from forcecal_ros.identify.poses import StaticPose
from forcecal_ros.recording.streams import Recording, Stream
import numpy as np

CHANNELS = ('force.x', 'force.y', 'force.z', 'torque.x', 'torque.y', 'torque.z')
_STREAMS = ('wrench', 'accelerometer', 'optidrive')

_LONG, _OFTEN = 10, 0.05
_NOISY = 1e-4
_DEAD = 100
_ABSURD = 1e9


def clean(recording: Recording) -> tuple[Recording, dict[str, int]]:
    """
    Leave out samples that are not finite, or as good as.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    recording : Recording
        A stream without a single usable sample becomes None.
    removed : dict of str to int
        How many samples each stream lost.
    """
    removed: dict[str, int] = {}
    changes: dict[str, object] = {}
    for name in _STREAMS:
        stream: Stream | None = getattr(recording, name)
        if stream is None:
            continue
        whole = (np.abs(stream.values) < _ABSURD).all(axis=1)
        if not whole.all():
            removed[name] = int((~whole).sum())
            changes[name] = replace(stream, t=stream.t[whole], values=stream.values[whole])
        if not whole.any():
            changes[name] = None
    pose = recording.pose
    if pose is not None:
        whole = np.isfinite(pose.R_base_sensor).all(axis=(1, 2))
        whole &= ~(np.abs(pose.position) >= _ABSURD).any(axis=1)
        if not whole.all():
            removed['pose'] = int((~whole).sum())
            changes['pose'] = replace(pose, t=pose.t[whole], position=pose.position[whole],
                                      R_base_sensor=pose.R_base_sensor[whole])
    return (replace(recording, **changes) if changes else recording), removed  # type: ignore[arg-type]


def require_wrench(recording: Recording) -> Stream:
    """
    Return the wrench.

    Raises
    ------
    DataError
        There is none.
    """
    if recording.wrench is None or not len(recording.wrench):
        raise DataError(f'{recording.source or "the recording"} has no wrench; record it, or name '
                        'its topic with --topic wrench=NAME')
    return recording.wrench


def refuse_stuck(wrench: Stream, accelerometer: Stream | None, poses: list[StaticPose],
                 optidrive: Stream | None = None) -> None:
    """
    Refuse channels that stand at one value in a pose while they are noisy in another.

    Parameters
    ----------
    wrench : Stream
    accelerometer : Stream or None
    poses : list of StaticPose
    optidrive : Stream, optional

    Raises
    ------
    DataError
        Names the channels, their values and the poses.
    """
    stuck = []
    for stream, names in ((wrench, CHANNELS), (accelerometer, ('x', 'y', 'z'))):
        if stream is None:
            continue
        prefix = '' if stream is wrench else 'accelerometer.'
        if len(stream) > _DEAD:
            for j in np.flatnonzero(np.ptp(stream.values, axis=0) == 0):
                stuck.append(f'{prefix}{names[j]} stands at {stream.values[0, j]:.6g} throughout')
        cuts = [stream.between(p.start, p.end).values for p in poses]
        cuts = [cut for cut in cuts if len(cut) >= 20]
        if len(cuts) < 2:
            continue
        ranges = np.array([np.ptp(cut, axis=0) for cut in cuts])
        noisy = (ranges > _NOISY * np.ptp(stream.values, axis=0)).any(axis=0)
        for i, j in zip(*np.nonzero((ranges == 0) & noisy)):
            stuck.append(f'{prefix}{names[j]} stands at {cuts[i][0, j]:.6g} in pose {i + 1}')
    if optidrive is not None:
        cuts = [optidrive.between(p.start, p.end).values for p in poses]
        if cuts and all(len(cut) >= 20 and not np.ptp(cut) and cut[0, 0] for cut in cuts):
            stuck.append(f'optidrive stands at {cuts[0][0, 0]:.6g} in every pose')
    if stuck:
        raise DataError(f'saturated or stuck: {"; ".join(stuck)}; lower the load, or raise the '
                        'range of the sensor')


def clipped(stream: Stream, names: tuple[str, ...]) -> list[str]:
    """
    Name channels that stand at one value for ten samples or more though they never do else.

    Parameters
    ----------
    stream : Stream
    names : tuple of str
        Of the channels.

    Returns
    -------
    list of str
        With the value and the time of the longest such stretch.
    """
    found = []
    for name, column in zip(names, stream.values.T):
        same = np.diff(column) == 0
        if not same.any():
            continue
        edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
        runs = edges[1::2] - edges[::2]
        i = int(np.argmax(runs))
        elsewhere = (same.sum() - runs[i]) / max(len(same) - runs[i], 1)
        if runs[i] >= _LONG and elsewhere <= _OFTEN:
            found.append(f'{name} at {column[edges[2 * i]]:.6g} for {runs[i] + 1} samples from '
                         f'{stream.t[edges[2 * i]]:.3f} s on')
    return found
