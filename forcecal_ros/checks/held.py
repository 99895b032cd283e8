"""Messages that hold no new reading: those repeated until the next comes, zeros in between."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Recording
import numpy as np
from numpy.typing import NDArray

OFTEN = 3
"""A reading that is sent so many times is thinned: one that is sent twice does no harm."""

FEWEST = 20
"""So many readings that are repeated tell how often the others are."""

REGULAR = 0.8
"""Share of the repetitions that are as long as the others where a driver repeats: readings that do
not resolve their noise repeat themselves now and then."""

PACKET = 5
"""So many messages of zeros in a row are lost packets; more are a sensor that is off."""

LEAPS = 20.0
"""A lost packet leaps by so many times what readings change by."""

LONG, TAIL = 10, 5
"""A noisy reading that is there so many times is no reading any more; so many changes before tell
that it is noisy."""

ALONE = 0.9
"""Share of readings that are there once, of a sensor that resolves its noise."""

ZEROS = 0.02
"""Share of a channel that is exactly zero from which a dead band is looked for."""

GAP = 10.0
"""Beside a dead band readings keep so many times their usual change away from zero."""

NEAR = 1.5
"""Readings enter a dead band from within so many times its limit."""


class _Runs(NamedTuple):
    """Repetitions: first sample of each, samples, and how long they last [s]."""

    first: NDArray[np.intp]
    samples: NDArray[np.intp]
    seconds: Array


def without_held(recording: Recording) -> Recording:
    """Leave out the repetitions of what comes at a lower rate than its messages."""
    changed: dict[str, Any] = {}
    notes = []
    for name in ('wrench', 'pose'):
        stream = getattr(recording, name)
        if stream is None or len(stream) < FEWEST * OFTEN:
            continue
        rows = stream.values if name == 'wrench' else _rows(stream)
        kept, every = _fresh(stream.t, rows)
        if every:
            changed[name] = stream.rows(kept)
            rate = 1.0 / float(np.median(np.diff(stream.t))) / every
            notes.append(f'{name}: each reading is sent {every} times: it comes at {rate:.3g} Hz; '
                         'repetitions are left out')
        elif name == 'wrench' and (stale := _stale(rows)).any():
            changed[name] = stream.rows(~stale)
            notes.append(f'{name}: {int(stale.sum())} messages repeat all channels of the one '
                         'before, as where the line to the sensor fails; left out')
    return replace(recording, **changed, notes=(*recording.notes, *notes)) if notes else recording


def _rows(pose: PoseStream) -> Array:
    return np.hstack([pose.R_base_sensor.reshape(len(pose), 9), np.nan_to_num(pose.position)])


def _fresh(t: Array, rows: Array) -> tuple[NDArray[np.intp], int]:
    """Return the samples that are no repetition, and how often each is sent; 0: no habit."""
    first = np.flatnonzero(np.append(True, (rows[1:] != rows[:-1]).any(axis=1)))
    samples = np.diff(np.append(first, len(rows)))
    runs = _Runs(first, samples, samples * float(np.median(np.diff(t))))
    usual = runs.samples[runs.seconds < limits.FROZEN]
    if len(usual) < FEWEST:
        return first, 0
    every = int(np.median(usual))
    alike = np.abs(usual - every) <= max(1, every // 4)
    if every < OFTEN or alike.mean() < REGULAR:
        return first, 0
    kept = [np.arange(i, i + n - every // 2, every) for i, n in zip(runs.first, runs.samples)]
    return np.concatenate(kept), every


def _stale(rows: Array) -> NDArray[np.bool_]:
    """Tell which readings repeat one that noise had changed until then, and long."""
    steps = np.abs(np.diff(rows, axis=0))
    changes = steps.any(axis=1)
    first = np.flatnonzero(np.append(True, changes))
    samples = np.diff(np.append(first, len(rows)))
    stale = np.zeros(len(rows), dtype=bool)
    if (samples == 1).mean() < ALONE:
        return stale
    usual = np.median(steps[changes], axis=0)
    for i, n in zip(first[samples >= LONG].tolist(), samples[samples >= LONG].tolist()):
        before = steps[max(0, i - TAIL):i]
        if len(before) and (before.mean(axis=0) > limits.ABRUPT * usual).all():
            stale[i + 1:i + n] = True
    return stale


def dead_bands(values: Array, channels: Sequence[str]) -> Iterator[str]:
    """Name the channels whose small readings are cut off, and where [their unit]."""
    for channel, column in zip(channels, values.T):
        if limit := dead_band(column):
            yield (f'{channel} is never between 0 and {limit:.3g}: a dead band of its driver sets '
                   'small readings to zero; switch it off, as weight and bias are read wrongly')


def dead_band(column: Array) -> float:
    """Return below what size readings are set to zero; 0: nowhere."""
    zero = column == 0.0
    others = column[~zero]
    if len(others) < 0.1 * len(column) or zero.mean() < ZEROS:
        return 0.0
    limit = float(np.abs(others).min())
    step = float(np.median(np.abs(np.diff(others))))
    entered = np.abs(column[:-1][zero[1:] & ~zero[:-1]])
    cut = limit > GAP * step > 0.0 and len(entered) and np.median(entered) < NEAR * limit
    return limit if cut else 0.0


def lost_packets(values: Array) -> NDArray[np.bool_]:
    """Tell which readings are zero in all channels, alone between others that are far from it."""
    zero = ~values.any(axis=1)
    if not zero.any() or zero.mean() > 0.5:
        return np.zeros(len(values), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], zero.astype(int), [0]])))
    short = np.zeros(len(values), dtype=bool)
    for begin, end in edges.reshape(-1, 2):
        short[begin:end] = end - begin <= PACKET
    others = values[~zero]
    step = np.median(np.abs(np.diff(others, axis=0)), axis=0)
    leaps = np.median(np.abs(others), axis=0) > LEAPS * np.maximum(step, limits.TINY)
    return short if leaps.any() else np.zeros(len(values), dtype=bool)
