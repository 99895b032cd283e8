"""Channels that stick: dead throughout, or repeating one value from some time on.

A channel that comes with noise never repeats itself for long. One that does not resolve its noise
may at rest, and the signals of a simulator without noise do; both are told from a channel that is
stuck by how it comes to repeat itself, and by what the other channels do meanwhile.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.held import dead_band
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Stream
import numpy as np
from numpy.typing import NDArray

REMEDY = 'check the sensor, its cable and its driver, and record again'

TAIL = 5
"""So many changes before a channel repeats itself tell how it comes to."""


class Hold(NamedTuple):
    """
    A stretch in which a channel repeats itself.

    Attributes
    ----------
    channel : int
        -1: all channels of the stream.
    first, last : int
        Samples.
    rows : int
        How often another channel changed meanwhile.
    """

    channel: int
    first: int
    last: int
    rows: int


def refuse_dead(stream: Stream, name: str, channels: Sequence[str]) -> None:
    """
    Refuse a sensor that never changes, or a channel of it while others change all the time.

    Parameters
    ----------
    name : str
        Of the stream.
    channels : sequence of str
        Names of its columns.

    Raises
    ------
    DataError
        Names the channels and their values.
    """
    if len(stream) <= limits.DEAD:
        return
    lively = (np.diff(stream.values, axis=0) != 0).mean(axis=0)
    if not lively.any():
        raise DataError(f'{name}: the values never change; {REMEDY}')
    if lively.max() > 0.5 and not lively.all():
        _refuse(f'{channels[j]} stands at {stream.values[0, j]:.6g} throughout'
                for j in np.flatnonzero(lively == 0).tolist())


def refuse_stuck(stream: Stream, name: str, channels: Sequence[str],
                 pose: PoseStream | None = None) -> None:
    """
    Refuse a sensor, or a channel of it, that sticks for some time or from some time on.

    Parameters
    ----------
    name : str
        Of the stream.
    channels : sequence of str
        Names of its columns.
    pose : PoseStream, optional
        Measured or commanded, which tells of a sensor that ought to feel the robot turn.

    Raises
    ------
    DataError
        Names each channel, its value, and from when to when.
    """
    _refuse(_stuck(stream, name, channels, pose))


def _refuse(found: Iterable[str]) -> None:
    if sentences := '; '.join(found):
        raise DataError(f'{sentences}; {REMEDY}')


def _stuck(stream: Stream, name: str, channels: Sequence[str], pose: PoseStream | None
           ) -> Iterator[str]:
    """Say which channels repeat themselves as they never do else."""
    steps = np.abs(np.diff(stream.values, axis=0))
    rows = np.concatenate([[0], np.cumsum((steps > 0).any(axis=1))])
    whole = _longest(stream.t, (steps > 0).any(axis=1), rows, -1)
    if whole and (_is_stuck(whole, stream, steps) or _insensitive_to_turning(
            whole, stream, name, pose)):
        yield f'{name}: every channel repeats itself {_when(whole, stream)}'
        return
    for j, channel in enumerate(channels):
        hold = _longest(stream.t, steps[:, j] > 0, rows, j)
        if hold and hold.rows >= limits.STUCK_SAMPLES and _is_stuck(hold, stream, steps):
            yield (f'{channel} repeats {stream.values[hold.first, j]:.6g} '
                   f'{_when(hold, stream)} while other channels change')


def _when(hold: Hold, stream: Stream) -> str:
    return f'from {stream.t[hold.first]:.2f} s to {stream.t[hold.last]:.2f} s'


def _longest(t: Array, changes: NDArray[np.bool_], rows: NDArray[np.intp], channel: int
             ) -> Hold | None:
    """Return the longest stretch without change, where it is longer than any habit."""
    cuts = np.flatnonzero(changes) + 1
    firsts, lasts = np.append(0, cuts), np.append(cuts - 1, len(changes))
    spans, samples = t[lasts] - t[firsts], lasts - firsts + 1
    i = int(np.argmax(spans))
    if spans[i] < limits.STUCK or samples[i] < limits.STUCK_SAMPLES or len(spans) < 2:
        return None
    others = np.arange(len(spans)) != i
    order = np.argsort(spans[others])
    share = np.cumsum(samples[others][order]) / samples[others].sum()
    usual = float(spans[others][order][np.searchsorted(share, 0.95)])
    if spans[i] < limits.HABIT * usual:
        return None
    return Hold(channel, int(firsts[i]), int(lasts[i]), int(rows[lasts[i]] - rows[firsts[i]]))


def _is_stuck(hold: Hold, stream: Stream, steps: Array) -> bool:
    """Say whether neither a limit, a dead band nor rest can be why a channel repeats itself."""
    own = range(steps.shape[1]) if hold.channel < 0 else [hold.channel]
    outside = np.ones(len(steps), dtype=bool)
    outside[hold.first:hold.last] = False
    return any(_noise_ends(hold, j, steps[:, j], outside) and not _at_limit(hold, stream, j)
               and not (stream.values[hold.first, j] == 0.0 and dead_band(stream.values[:, j]))
               and (not _coarse(steps[outside, j]) or _others_go_on(hold, steps, outside))
               for j in own)


def _noise_ends(hold: Hold, channel: int, steps: Array, outside: NDArray[np.bool_]) -> bool:
    """Say whether a channel changes as usual up to where it begins to repeat itself."""
    usual = steps[outside & (steps > 0)]
    before, after = steps[:hold.first], steps[hold.last:]
    near = before[before > 0][-TAIL:] if hold.first else after[after > 0][:TAIL]
    return len(near) > 0 and bool(near.mean() > limits.ABRUPT * np.median(usual))


def _at_limit(hold: Hold, stream: Stream, channel: int) -> bool:
    """
    Say whether a channel reaches the end of its range and comes back.

    What sticks holds any of its readings: of noise, the extreme of the recording hardly ever.
    One that stays until the end has to have repeated that extreme before.
    """
    values = stream.values[:, channel]
    value = values[hold.first]
    if values.min() < value < values.max():
        return False
    elsewhere = (values == value).sum() - (hold.last - hold.first + 1)
    return bool(hold.last + 1 < len(values) or elsewhere >= limits.CLIPPED)


def _coarse(steps: Array) -> bool:
    """Say whether a channel may not resolve its noise at rest."""
    nonzero = steps[steps > 0]
    return bool(nonzero.min() > limits.COARSE * np.median(nonzero))


def _others_go_on(hold: Hold, steps: Array, outside: NDArray[np.bool_]) -> bool:
    """Say whether the other channels change about as much as they usually do."""
    if hold.channel < 0:
        return False
    others = np.delete(np.arange(steps.shape[1]), hold.channel)
    inside = steps[hold.first:hold.last][:, others].mean(axis=0)
    usual = steps[outside][:, others].mean(axis=0)
    return bool((inside > limits.ALIKE * usual).all() and (usual > 0).all())


def _insensitive_to_turning(hold: Hold, stream: Stream, name: str,
                            pose: PoseStream | None) -> bool:
    """Say whether a sensor of forces says the same while the robot turns."""
    if pose is None or name not in ('wrench', 'accelerometer'):
        return False
    R = pose.between(float(stream.t[hold.first]), float(stream.t[hold.last])).R_base_sensor
    return len(R) > 0 and bool(np.abs(R - R[0]).max() > limits.TURNED)
