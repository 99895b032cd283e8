"""How a wrench follows gravity as the pose turns it: late, or smoothed by its driver."""

from collections.abc import Iterator
import re
from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.clocks import means_between
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Stream
import numpy as np
from numpy.typing import NDArray

STEP, PERIODS = 0.02, 2.0
"""Means over so long are compared [s], or over so many periods of a slow stream."""

LATE = (0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.4, 2.0)
"""Delays that are looked for [s], so that a clock is not taken for a filter; what is later than a
slow driver is for :func:`forcecal_ros.checks.clocks.refuse_offset` to say."""

TIME_CONSTANTS = (0.06, 0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.3, 2.0)
"""Of low-passes that are looked for [s]: of 2.7 Hz down to 0.08 Hz."""

WINDOWS = (0.2, 0.25, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Lengths of means that are looked for [s]: one that is a third off leaves twice as much."""

EXPLAINS, TIMES = 0.9, 3.0
"""Share of the changes of force that gravity explains once it is late or smoothed, and how many
times as much it leaves unexplained as it is."""

TURNS, AFTER, FEWEST = 0.1, 0.5, 50
"""Gravity turns where it does so faster [rad/s], or has done so before within so long [s]; of
fewer means nothing is said."""

ROUNDS, PUSHED = 4, 9.0
"""Fits without what is pushed: what is off by three times what half of the readings are."""


TOLD_LATE = re.compile('^wrench (follows gravity|shows gravity turn) ')
"""How the notes of :func:`lag_note` begin."""


class Follows(NamedTuple):
    """
    One way to follow gravity.

    Attributes
    ----------
    late : float
        [s]; 0 where it is smoothed.
    said : str
    down : ndarray, shape (n, 3)
        Direction of gravity so.
    """

    late: float
    said: str
    down: Array


def how_it_follows(stream: Stream, pose: PoseStream) -> Follows | None:
    """
    Say how a wrench follows gravity if not at once; None: at once, or nothing tells.

    Whatever matrix takes gravity's direction to the readings: unit, sign and axes do not matter.
    """
    if min(len(stream), len(pose)) < 100:
        return None
    step = max(STEP, *(PERIODS * float(np.median(np.diff(t))) for t in (stream.t, pose.t)))
    edges = np.arange(max(stream.t[0], pose.t[0]), min(stream.t[-1], pose.t[-1]), step)
    if len(edges) < 200:
        return None
    down = means_between(pose.t, pose.R_base_sensor[:, 2], edges)
    read = means_between(stream.t, stream.values[:, :3], edges)
    if np.linalg.norm(down.std(axis=0)) < limits.OFFSET_TURNED:
        return None
    turning = _turning(down, step)
    if turning.sum() < FEWEST:
        return None
    size = float(((read - read.mean(axis=0))**2).sum(axis=1).mean())
    plain, best = _unexplained_power(down, read, turning), min(
        ((_unexplained_power(way.down, read, turning), way) for way in _ways(down, step)),
        key=lambda pair: pair[0])
    sure = best[0] < (1.0 - EXPLAINS) * size and TIMES * best[0] < plain
    return best[1] if sure and best[1].late <= limits.OFFSET else None


def _turning(down: Array, step: float) -> NDArray[np.bool_]:
    """Say when gravity turns in the sensor, and for a while after."""
    speed = np.linalg.norm(np.diff(down, axis=0, append=down[-1:]), axis=1) / step
    count = np.convolve(speed > TURNS, np.ones(max(1, round(AFTER / step))))[:len(down)]
    return np.asarray(count > 0)


def _unexplained_power(down: Array, read: Array, turning: NDArray[np.bool_]) -> float:
    """Squared force [N^2] that half of the readings exceed that gravity does not explain so."""
    design = np.column_stack([down, np.ones(len(down))])
    kept = np.ones(len(down), dtype=bool)
    for _ in range(ROUNDS):
        fit = np.linalg.lstsq(design[kept], read[kept], rcond=1e-6)[0]
        off = ((read - design @ fit)**2).sum(axis=1)
        kept = off <= PUSHED * float(np.median(off))
    return float(np.median(off[turning]))


def _ways(down: Array, step: float) -> Iterator[Follows]:
    for late in LATE:
        if late > step:
            yield Follows(late, f'{1e3 * late:.0f} ms late', _shifted(down, late / step))
    for tau in TIME_CONSTANTS:
        if tau > step:
            yield Follows(0.0, f'as behind a low-pass of {0.5 / np.pi / tau:.2g} Hz',
                          _lowpassed(down, step / tau))
    for window in WINDOWS:
        if window > 3.0 * step:
            yield Follows(0.0, f'as averaged over {window:g} s', _averaged(down, window / step))


def _shifted(values: Array, steps: float) -> Array:
    at = np.arange(len(values))
    return np.stack([np.interp(at - steps, at, column) for column in values.T], axis=1)


def _lowpassed(values: Array, share: float) -> Array:
    from scipy.signal import lfilter  # takes a second, which a node does not start with

    keep = np.exp(-share)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values - values[0], axis=0) + values[0])


def _averaged(values: Array, steps: float) -> Array:
    n = max(1, round(steps))
    padded = np.pad(values, ((n // 2, n - 1 - n // 2), (0, 0)), mode='edge')
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(padded, axis=0)])
    return np.asarray((sums[n:] - sums[:-n]) / n)


def lag_note(stream: Stream, pose: PoseStream) -> str:
    """Say in a note that a wrench is late or smoothed; empty: it is not, or nothing tells."""
    found = how_it_follows(stream, pose)
    if found is None:
        return ''
    if not found.late:
        return (f'wrench follows gravity {found.said}: its driver smooths it; contacts are as '
                'smooth, and while the robot moves its weight is taken off where it is not yet '
                'felt; switch the filter off')
    return (f'wrench shows gravity turn {found.said}, by the stamps of wrench and pose: weight '
            'and inertia are taken off too early while the robot moves; stamp when it is measured')
