"""
What a signal can have wrong by itself: values, repetitions, limits, gaps, pace.

Every check refuses with numbers and a remedy, leaves out what is no reading, or notes. Noise is
estimated from third differences, which motion does not reach.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, permutations
from typing import Any, NamedTuple

from forcecal_ros.core.errors import above, DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.noise.white import difference_gain
from forcecal_ros.core.stamps import jitter_of
from forcecal_ros.core.streams import (
    CHANNELS,
    FREE,
    phase_spans,
    PoseStream,
    Recording,
    STILL,
    Stream,
)
from forcecal_ros.core.topics import ROLES
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]

ABSURD, ABSURD_RAW = 1e6, 2.0**32
"""A reading beyond is none, in N, N m, V, m/s^2 or m: no wrist sensor reads a meganewton; counts
of a converter have 32 bits at most."""

FEW = 5
"""So few samples may be missing of any stream: of 24 static poses one would be 4 %."""

PAUSE_S, PAUSE_PERIODS = 0.5, 5.0
"""Silence for so long, and so many periods, is a pause and no lost sample; a stream that repeats
itself for so long has stopped, and its driver is not merely slow."""

STUCK_SAMPLES, DEAD = 50, 100
"""Noise of one resolution repeats itself so often once in 10^20 times; static sets have fewer
samples than the second."""

NOISE_GOES_ON = 0.2
"""Changes just before a channel sticks, over the usual ones: noise goes on until it sticks; the
signal of a simulator without noise comes to rest by ever smaller changes."""

CLIPPED = 5
"""Samples at the very same extreme, half of them in a row: noise reaches it once."""

RESOLVED = 0.17
"""Step of values, in RMS of the noise, from which its rounding is 5 % of the noise."""

MAX_LATE_S = 1.0
"""A robot follows its commands by so much later at most, and streams that are farther apart do not
overlap because their clocks differ."""

MAX_SPEED = 30.0
"""What no hand or wrist exceeds [m/s] and [rad/s]: the fastest arms do 10 m/s and 12 rad/s."""

OPTIONAL = ('optidrive', 'angular_velocity')
"""Signals that messages and simulators hold as zeros where nothing measures them."""

SENSORS = ('wrench', 'accelerometer', 'optidrive', 'pose')
STREAMS = (*SENSORS, 'target')

FARTHEST = 1.0
"""Centre of mass, radius of gyration and displacement beyond this are none of what is attached to
a wrist [m]: 1 kg at this distance already overloads most wrist sensors by its torque."""

REMEDY = 'check the sensor, its cable and its driver, and record again'

_STATE_UNIT = ('set its unit in the specification of forcecal import, or correct the stamps in '
               'the driver')


def present(recording: Recording, names: Sequence[str]) -> dict[str, Any]:
    """Return those of some streams that hold samples, by name."""
    streams = {name: getattr(recording, name) for name in names}
    return {name: stream for name, stream in streams.items()
            if stream is not None and len(stream)}


# Values ----------------------------------------------------------------------------------------


def readable(t: Array, values: Array, name: str, channels: Sequence[str], limit: float = ABSURD
             ) -> tuple[Mask, str]:
    """
    Say which samples are readings, and what has to be left out.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    values : ndarray, shape (n, k)
    name : str
        Of the stream.
    channels : sequence of str
        Their names.
    limit : float
        What a reading never reaches.

    Raises
    ------
    DataError
        Too many are none.
    """
    readings = np.abs(values) < limit
    good: Mask = readings.all(axis=1)
    count = int((~good).sum())
    if not count:
        return good, ''
    i = int(np.argmin(good))
    j = int(np.argmin(readings[i]))
    first = f'{channels[j] if j < len(channels) else f"column {j + 1}"} from {t[i]:.2f} s on'
    if count == len(t) and np.isfinite(values).all():
        raise DataError(f'{name}: all samples are beyond {limit:g} ({first}): these are raw '
                        'counts of a converter; scale them to SI units in the driver')
    what = f'not finite or beyond {limit:g}'
    # from this share of samples on a stream is not to be used: ten a second of 1 kHz
    spoilt = 0.01
    if count == len(t) or count > max(FEW, spoilt * len(t)):
        raise DataError(f'{name}: {100.0 * count / len(t):.1f} % of the samples are {what} '
                        f'({first}); check the driver and record again')
    return good, f'{name}: {count} samples are {what} and left out'


def startup(stream: Stream) -> int:
    """Count the samples before a sensor's first reading: not finite, or zero in all channels."""
    for nothing in (~np.isfinite(stream.values).all(axis=1), ~stream.values.any(axis=1)):
        first = int(np.argmin(nothing))
        # a driver that publishes before its sensor answers sends nothing, or zeros, for so long
        longest_s = 20.0
        if first > FEW and not nothing[first:].any() and 2 * first < len(stream) and (
                stream.t[first] - stream.t[0] < longest_s):
            return first
    return 0


def absence(name: str, stream: Stream | PoseStream | None) -> str:
    """Say why a stream was not measured; empty: it was, or there is none."""
    if stream is None or name == 'wrench':
        return ''
    if not len(stream):
        return 'no message'
    if name not in OPTIONAL or not isinstance(stream, Stream):
        return ''
    if name == 'angular_velocity' and np.isnan(stream.values).all():
        return 'all values are NaN'
    return '' if stream.values.any() else 'all values are zero'


# Repetitions -----------------------------------------------------------------------------------


def runs(rows: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first sample of each run of equal rows (n, k), and how many it has."""
    first = np.flatnonzero(np.append(True, (rows[1:] != rows[:-1]).any(axis=1)))
    return first, np.diff(np.append(first, len(rows)))


def rows_of(stream: Stream | PoseStream) -> Array:
    """Return all columns of a stream; of a pose the orientation may be all that is a number."""
    if isinstance(stream, Stream):
        return stream.values
    return np.hstack([np.nan_to_num(stream.position, posinf=np.inf, neginf=-np.inf),
                      stream.R_base_sensor.reshape(len(stream), 9)])


def without_repetitions(stream: Stream | PoseStream, name: str) -> tuple[Mask, str]:
    """Say which samples are new, where each is sent several times; and a note."""
    rows, keep = rows_of(stream), np.ones(len(stream), dtype=bool)
    if len(stream) < 60:
        return keep, ''
    first, count = runs(rows)
    usual = count[stream.t[first + count - 1] - stream.t[first] < PAUSE_S]
    every = int(np.median(usual)) if len(usual) >= 20 else 0
    if every >= 3 and (np.abs(usual - every) <= max(1, every // 4)).mean() > 0.8:
        keep[:] = False
        for i, n in zip(first.tolist(), count.tolist()):
            keep[i:i + n - every // 2:every] = True
        rate = (len(stream) - 1) / float(stream.t[-1] - stream.t[0]) / every
        return keep, (f'{name}: each reading is sent {every} times, so the sensor runs at '
                      f'{rate:.3g} Hz; repetitions are left out')
    if name == 'wrench' and (count == 1).mean() > 0.9:
        steps = np.abs(np.diff(rows, axis=0))
        usual_step = np.median(steps[steps.any(axis=1)], axis=0)
        for i, n in zip(first[count >= 10].tolist(), count[count >= 10].tolist()):
            before = steps[max(0, i - 5):i]
            if len(before) and (before.mean(axis=0) > NOISE_GOES_ON * usual_step).all():
                keep[i + 1:i + n] = False
    if keep.all():
        return keep, ''
    return keep, (f'{name}: {int((~keep).sum())} messages repeat all channels of the previous '
                  'one, as when the connection to the sensor fails; left out')


def lost_packets(values: Array) -> Mask:
    """Return which readings are zero in all channels, alone between others far from it."""
    zero = ~values.any(axis=1)
    lost: Mask = np.zeros(len(values), dtype=bool)
    if not zero.any() or zero.mean() > 0.5:
        return lost
    first, count = runs(zero[:, None].astype(float))
    for i, n in zip(first.tolist(), count.tolist()):
        lost[i:i + n] = zero[i] and n <= 5
    step = np.median(np.abs(np.diff(values[~zero], axis=0)), axis=0)
    leaps = np.median(np.abs(values[~zero]), axis=0) > 20.0 * np.maximum(step, 1e-300)
    return lost if leaps.any() else np.zeros(len(values), dtype=bool)


def dead_band(column: Array) -> float:
    """Return below what size readings are set to zero; 0: nowhere."""
    zero = column == 0.0
    others = column[~zero]
    if len(others) < 0.1 * len(column) or zero.mean() < 0.02:
        return 0.0
    limit = float(np.abs(others).min())
    step = float(np.median(np.abs(np.diff(others))))
    entered = np.abs(column[:-1][zero[1:] & ~zero[:-1]])
    cut = limit > 10.0 * step > 0.0 and len(entered) and np.median(entered) < 1.5 * limit
    return limit if cut else 0.0


def refuse_dead(stream: Stream, name: str) -> None:
    """
    Refuse a sensor that never changes, or a channel of it while others change all the time.

    Raises
    ------
    DataError
        Names the channels and their values.
    """
    if len(stream) <= DEAD:
        return
    changing = (np.diff(stream.values, axis=0) != 0).mean(axis=0)
    if not changing.any():
        raise DataError(f'{name}: the values never change; {REMEDY}')
    if changing.max() > 0.5 and not changing.all():
        dead = '; '.join(f'{CHANNELS[name][j]} is constant at {stream.values[0, j]:.6g}'
                         for j in np.flatnonzero(changing == 0).tolist())
        raise DataError(f'{dead}; {REMEDY}')


def refuse_stuck(stream: Stream, name: str, channels: Sequence[str],
                 pose: PoseStream | None = None) -> None:
    """
    Refuse a sensor, or a channel of it, that sticks for some time or from some time on.

    A channel that comes with noise never repeats itself for long; one that does not resolve its
    noise may at rest, and so may a simulator's without noise. Both are told from one that sticks
    by how it comes to repeat itself and by what the other channels do meanwhile.

    Parameters
    ----------
    pose : PoseStream, optional
        Measured or commanded: no sensor of forces repeats itself while it turns by 0.1 rad.

    Raises
    ------
    DataError
        Names each channel, its value, and from when to when.
    """
    values, t = stream.values, stream.t
    steps = np.abs(np.diff(values, axis=0))
    every, found = range(values.shape[1]), []
    if hold := _longest(t, values):
        start, end = (float(t[i]) for i in hold)
        R = np.empty((0, 3, 3))
        if pose is not None and name in ('wrench', 'accelerometer'):
            R = pose.between(start, end).R_base_sensor
        if np.abs(R - R[:1]).max(initial=0.0) > 0.1 or any(
                _sticks(stream, steps, j, hold, False) for j in every):
            raise DataError(f'{name}: all channels are constant from {start:.2f} s to {end:.2f} '
                            f's; {REMEDY}')
    for j in every:
        hold = _longest(t, values[:, [j]])
        if hold and steps[slice(*hold)].any(axis=1).sum() >= STUCK_SAMPLES and _sticks(
                stream, steps, j, hold, True):
            start, end = (float(t[i]) for i in hold)
            found.append(f'{channels[j]} is stuck at {values[hold[0], j]:.6g} from {start:.2f} s '
                         f'to {end:.2f} s while other channels change')
    if found:
        raise DataError(f'{"; ".join(found)}; {REMEDY}')


def _longest(t: Array, rows: Array) -> tuple[int, int] | None:
    """Return first and last sample of the longest run, if it is longer than any habit."""
    first, count = runs(rows)
    last = first + count - 1
    spans = t[last] - t[first]
    i = int(np.argmax(spans))
    if spans[i] < PAUSE_S or count[i] < STUCK_SAMPLES or len(spans) < 2:
        return None
    others = np.arange(len(spans)) != i
    order = np.argsort(spans[others])
    share = np.cumsum(count[others][order]) / count[others].sum()
    usual = float(spans[others][order][np.searchsorted(share, 0.95)])
    # stuck is what repeats itself so many times as long as 95 % of the signal does
    habit = 20.0
    return (int(first[i]), int(last[i])) if spans[i] > habit * usual else None


def _sticks(stream: Stream, steps: Array, j: int, hold: tuple[int, int], alone: bool) -> bool:
    """Say whether neither a limit, a dead band nor rest is why channel j repeats itself."""
    (first, last), column, own = hold, stream.values[:, j], steps[:, j]
    outside = np.ones(len(steps), dtype=bool)
    outside[first:last] = False
    usual = own[outside & (own > 0)]
    near = own[:first][own[:first] > 0][-5:] if first else own[last:][own[last:] > 0][:5]
    if not len(near) or near.mean() < NOISE_GOES_ON * np.median(usual):
        return False
    if not column.min() < column[first] < column.max():  # at its limit, and back from it
        elsewhere = int((column == column[first]).sum()) - (last - first + 1)
        if last + 1 < len(column) or elsewhere >= CLIPPED:
            return False
    if column[first] == 0.0 and dead_band(column):
        return False
    # resolution over the usual change from which a channel may stand still at rest
    coarse = 0.1
    if usual.min() < coarse * np.median(usual):
        return True
    others = np.delete(steps, j, axis=1)  # coarse: it may rest, unless the others go on
    inside, all_along = others[first:last].mean(axis=0), others[outside].mean(axis=0)
    return alone and bool((inside > 0.5 * all_along).all() and (all_along > 0).all())


# Limits and steps of values --------------------------------------------------------------------


class Clipping(NamedTuple):
    """Values of one channel that stop at a limit: how many, and when the first of them."""

    channel: str
    limit: float
    samples: int
    start: float = 0.0

    def __str__(self) -> str:
        return (f'{self.channel} is clipped at {self.limit:.4g} ({self.samples} samples, the '
                f'first at {self.start:.2f} s)')


def columns(recording: Recording) -> Iterator[tuple[str, Array, Array]]:
    """Name, stamps and values of each channel of a sensor."""
    for name, stream in present(recording, SENSORS[:3]).items():
        for channel, values in zip(CHANNELS[name], stream.values.T):
            yield channel, stream.t, values


def resolution(values: Array) -> float:
    """Return the step whose multiples values are; 0: they are none, or too few."""
    different = np.unique(values)
    if len(different) > 0.5 * len(values) or len(different) < 3:
        return 0.0
    gaps = np.diff(different)
    step = float(np.percentile(gaps[gaps > 1e-9 * np.abs(different).max()], 10))
    turns = (different - different[0]) / step
    step *= float(turns[-1] / np.rint(turns[-1])) if turns[-1] > 0.5 else 1.0
    off = (different - different[0]) / step
    return step if np.sqrt(np.mean((off - np.rint(off))**2)) < 0.1 else 0.0


def quantisation(recording: Recording, noise: Mapping[str, float]) -> dict[str, float]:
    """Return the steps of channels whose values are multiples of one that matters, by channel."""
    return {name: step for name, _, values in columns(recording)
            if (step := resolution(values)) > RESOLVED * noise[name]
            and np.ptp(values) > 2.0 * step}


def limits_of(values: Array, noise: float | None = None) -> list[float]:
    """
    Return the ends of its range at which a channel stops.

    One that mostly repeats itself, without noise or in coarse steps, rests at its extreme; zeros
    of a dead band are no end of the range.

    Parameters
    ----------
    values : ndarray, shape (n,)
    noise : float or None
        RMS of its white noise; None: by third differences, which motion does not reach.
    """
    if not len(values):
        return []
    ends = []
    for limit in dict.fromkeys((float(values.max()), float(values.min()))):
        at = values == limit
        if CLIPPED <= (count := int(at.sum())) < len(values) and (
                2 * np.sum(at[1:] & at[:-1]) >= count):
            ends.append((limit, count))
    if not ends:
        return []
    if noise is None:
        noise = float(np.median(np.abs(np.diff(values, n=3)))) / (
            0.6745 * np.sqrt(difference_gain(3)))
    step = resolution(values)
    in_steps = step > RESOLVED * noise and np.ptp(values) > 2.0 * step
    if in_steps and step > 2.0 * noise:
        return []
    least = 40 if in_steps else CLIPPED  # rounded noise reaches an extreme now and then
    return [limit for limit, count in ends if count >= least and noise > 1e-9 * abs(limit)
            and (limit or not dead_band(values))]


def clipped(recording: Recording, known: Mapping[str, float] | None = None
            ) -> tuple[Clipping, ...]:
    """Find channels that stop at a limit, by the noise that they show or that is known."""
    found = []
    for name, t, values in columns(recording):
        for limit in limits_of(values, known[name] if known else None):
            at = values == limit
            found.append(Clipping(name, limit, int(at.sum()), float(t[np.argmax(at)])))
    return tuple(found)


def refuse_wrapped(wrench: Stream, pose: PoseStream) -> None:
    """
    Refuse channels that leap from one end of their range to the other, as counts that wrap do.

    Raises
    ------
    DataError
        Names the channels and the ends.
    """
    found = [f'{channel} jumps from one end of its range to the other ({values.min():.4g}, '
             f'{values.max():.4g}) {count} times'
             for channel, values in zip(CHANNELS['wrench'], wrench.values.T)
             if (count := _wraps(wrench.t, values, pose))]
    if found:
        raise DataError(f'{"; ".join(found)}: its counts overflow; increase the range of the '
                        'sensor')


def _wraps(t: Array, values: Array, pose: PoseStream) -> int:
    """Count leaps between the ends of a range at which a smooth channel stays; 0: none."""
    span, steps = float(np.ptp(values)), np.abs(np.diff(values))
    at = np.flatnonzero(steps > 0.8 * span)
    if len(values) <= DEAD or not len(at) or np.median(steps) > 0.02 * span or (
            span < 64 * resolution(values)):
        return 0
    upper, crossed = values > 0.5 * (values.max() + values.min()), 0
    for leaps in np.split(at, np.flatnonzero(np.diff(at) >= 5) + 1):
        start, stop = upper[:leaps[0] + 1][-5:], upper[leaps[-1] + 1:][:5]
        crossed += bool(start.min() == start.max() != stop.min() == stop.max())
    before, after = values[:at[0] + 1][-DEAD:], values[at[0] + 1:][:DEAD]
    once = abs(values.max() + values.min()) < 0.01 * span and abs(
        np.median(after) - np.median(before)) > 0.5 * span
    if crossed < 2 and not once:  # noise leaps to and fro, spikes stay at one end only
        return 0
    ends = np.sort([values[at], values[at + 1]], axis=0)
    off = np.maximum(ends[0] - values.min(), values.max() - ends[1])
    there, then = (pose.R_base_sensor[np.searchsorted(pose.t, t[i]).clip(max=len(pose) - 1)]
                   for i in (at, at + 1))
    still = np.median(np.linalg.norm(then - there, axis=(1, 2))) < 0.05
    return len(at) if np.median(off) < 0.02 * span and still else 0


# Gaps and clocks -------------------------------------------------------------------------------


def refuse_apart(spans: Mapping[str, tuple[float, float]]) -> None:
    """
    Refuse streams, each by its first and last stamp [s], that do not overlap with most others.

    Raises
    ------
    DataError
        Names them, and how far off they begin.
    """
    meets = {name: {other for other in spans if max(
        spans[name][0] - spans[other][1], spans[other][0] - spans[name][1]) < MAX_LATE_S}
        for name in spans}
    most = max(spans, key=lambda name: len(meets[name]), default='')
    apart = [name for name in spans if name not in meets[most]]
    if apart:
        listed = ', '.join(f'{name} {spans[name][0] - spans[most][0]:+.1f} s' for name in apart)
        raise DataError(f'streams do not overlap with {most}; start times relative to it: '
                        f'{listed}; synchronise the clocks of all computers (PTP or chrony), and '
                        'record again')


def refuse_clocks_apart(recording: Recording) -> None:
    """Refuse streams that do not overlap with the others because their clocks differ."""
    spans = {}
    for name, stream in present(recording, (*STREAMS, 'angular_velocity')).items():
        topic = ROLES[name].topic if name in ROLES else name
        spans[name if topic == name else f'{name} ({topic})'] = (
            float(stream.t[0]), float(stream.t[-1]))
    refuse_apart(spans)


Gap = tuple[float, float]
"""Stamps of the last sample before and the first after [s]."""


def _gaps(*stamps: Array) -> list[Gap]:
    """List when none of some streams published anything."""
    period = min((float(np.median(np.diff(t))) for t in stamps if len(t) > 1), default=np.inf)
    t = np.sort(np.concatenate([*stamps, []]))
    least = max(PAUSE_S, PAUSE_PERIODS * period)
    return [(float(t[i]), float(t[i + 1])) for i in np.flatnonzero(np.diff(t) > least)]


def pauses(recording: Recording) -> list[Gap]:
    """List when no stream published anything."""
    return _gaps(*(stream.t for stream in present(recording, STREAMS).values()))


def silences(recording: Recording) -> Iterator[str]:
    """Note when single sensors, or all streams, published nothing for a while."""
    common = pauses(recording)
    found = [('all streams', common)]
    for name, stream in present(recording, SENSORS).items():
        found.append((name, [gap for gap in _gaps(stream.t) if not any(
            start < gap[1] and gap[0] < end for start, end in common)]))
    for who, gaps in found:
        if len(gaps) > 5:
            start, end = max(gaps, key=lambda gap: gap[1] - gap[0])
            yield (f'{who}: {len(gaps)} pauses in which nothing was recorded, the longest of '
                   f'{end - start:.1f} s from {start:.1f} s on')
        else:
            yield from (f'{who}: nothing was recorded for {end - start:.1f} s from {start:.1f} s '
                        'on' for start, end in gaps)


def lost_messages(recording: Recording) -> Iterator[str]:
    """Note which of wrench and pose miss more than 5 % of their messages besides pauses."""
    for name, stream in present(recording, ('wrench', 'pose')).items():
        if len(stream) <= DEAD:
            continue
        jitter = jitter_of(stream.t)
        short = np.diff(stream.t) < max(PAUSE_S, PAUSE_PERIODS * jitter.period)
        missing = int((np.diff(jitter.number) - 1)[short].sum())
        if missing > 0.05 * (missing + len(stream)):
            yield (f'{name}: {missing / (missing + len(stream)):.0%} of its messages are missing; '
                   'record on the computer that publishes them')


# Poses -----------------------------------------------------------------------------------------


def refuse_frozen_pose(recording: Recording) -> None:
    """
    Refuse a pose that repeats itself to the last bit, or ends, while the robot moves.

    A robot that was late to move goes on from where it stood; a pose that had been frozen jumps,
    or repeats itself to the end.

    Raises
    ------
    DataError
        Says when, and what moved.
    """
    pose = recording.pose
    if pose is None or len(pose) < 3:
        return
    first, count = runs(rows_of(pose))
    where = recording.source or 'the recording'
    for i, j in zip(first.tolist(), (first + count - 1).tolist()):
        start, end, goes_on = float(pose.t[i]), float(pose.t[j]), j + 1 < len(pose)
        if end - start < PAUSE_S or (goes_on and not _jumps(pose.rows(slice(j, j + 3)))):
            continue
        if what := _what_moves(recording, start, end - MAX_LATE_S / (2 if goes_on else 1)):
            raise DataError(f'current_pose is constant from {start:.2f} s to {end:.2f} s of '
                            f'{where}, while {what}; check its driver')
    start = float(pose.t[-1])
    others = [stream.t[-1]
              for stream in present(recording, ('wrench', 'accelerometer')).values()]
    if others and (what := _what_moves(recording, start, float(max(others)) - MAX_LATE_S)):
        raise DataError(f'current_pose has no message from {start:.2f} s on of {where}, while '
                        f'{what}; check its driver')


def _ways(pose: PoseStream) -> Array:
    """Ways from the first sample to each, in what has moved for certain, shape (n,)."""
    turned = np.linalg.norm(rotation_vector(pose.R_base_sensor[0].T @ pose.R_base_sensor), axis=1)
    moved = np.linalg.norm(np.nan_to_num(pose.position - pose.position[0]), axis=1)
    # so far a tool has moved for certain: reported poses resolve a tenth or better
    moved_m, turned_rad = 0.002, 0.01
    return np.asarray(np.maximum(turned / turned_rad, moved / moved_m))


def _jumps(pose: PoseStream) -> bool:
    """Say whether a pose (3 samples) goes on from its first as none that had stood there could."""
    there, steps = _ways(pose)[1], np.diff(pose.t)
    then = _ways(pose.rows(slice(1, 3)))[-1] / steps[-1]  # 0 where it ends
    return bool(there > 1.0 and there / steps[0] > 2.0 * then)


def _what_moves(recording: Recording, start: float, end: float) -> str:
    """Say what moves in a stretch of time, by the commands if there are any; empty: nothing."""
    target = recording.target
    if target is not None and len(target) and target.t[0] < end:
        held = max(0, int(np.searchsorted(target.t, start, side='right')) - 1)
        sent = target.between(float(target.t[held]), end)
        return 'the commanded pose moves' if len(sent) and _ways(sent).max() > 1.0 else ''
    for name in ('angular_velocity', 'accelerometer', 'wrench'):
        stream: Stream | None = getattr(recording, name)
        # the tool may ring for a second after the robot has stopped
        if stream is not None and _changes(stream, name, recording, start + 1.0, end):
            return f'the {name.replace("_", " ")} shows that the robot moves'
    return ''


def _changes(stream: Stream, name: str, recording: Recording, start: float, end: float) -> bool:
    """Say whether a sensor shows motion; a wrench does where phases say that nothing touches."""
    spans = [(-np.inf, np.inf)] if name != 'wrench' else phase_spans(
        recording.phases, (*FREE, *STILL))
    means, _ = _quarter_seconds(stream, float(stream.t[0]), float(stream.t[-1]))
    if not len(means):
        return False
    usual = np.ptp(means, axis=0)
    if name == 'accelerometer':  # 3 deg of tilt
        usual = np.maximum(usual, 0.2 * np.linalg.norm(means.mean(axis=0)))
    for begin, stop in spans:
        means, errors = _quarter_seconds(stream, max(start, begin), min(end, stop))
        if len(means) > 1:
            change = np.ptp(means, axis=0)
            if ((change > 20.0 * np.median(errors, axis=0)) & (change > 0.25 * usual)).any():
                return True
    return False


def _quarter_seconds(stream: Stream, start: float, end: float) -> tuple[Array, Array]:
    """Means over a quarter of a second each, with their standard errors for white noise."""
    count = max(0, int((end - start) / 0.25))
    edges = np.searchsorted(stream.t, start + 0.25 * np.arange(count + 1))
    parts = [stream.values[i:j] for i, j in pairwise(edges) if j - i > 3]
    if not parts:
        return np.empty((0, stream.values.shape[1])), np.empty((0, stream.values.shape[1]))
    return (np.array([part.mean(axis=0) for part in parts]),
            np.array([part.std(axis=0) / np.sqrt(len(part)) for part in parts]))


def interpolated(pose: PoseStream) -> str:
    """Note that poses lie on straight lines between few, to the last bit; empty: they do not."""
    if not pose.has_position or len(pose) < 40:
        return ''
    t, place = pose.t, pose.position
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    way = np.linalg.norm(place[2:] - place[:-2], axis=1)
    off = np.linalg.norm(place[1:-1] - place[:-2] - share * (place[2:] - place[:-2]), axis=1)
    bent = (way > 0.0) & (off > 1e-6 * way)
    corners = np.flatnonzero(bent & ~np.roll(bent, 1) & ~np.roll(bent, -1)) + 1
    if len(corners) < 20 or bent.sum() > 0.25 * (way > 0.0).sum():
        return ''
    apart = np.diff(t[corners])
    period = float(np.median(apart))
    even = np.abs(apart / period - 1.0) < 0.2
    R = pose.R_base_sensor[corners]
    turned = rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    # a chord of two intervals' change of speed: h^2 a / 8
    changes = np.linalg.norm(np.diff(turned, axis=0), axis=1)[even[1:] & even[:-1]] / 8.0
    astray = float(np.quantile(changes, 0.9)) if len(changes) else 0.0
    if even.mean() < 0.5 or astray < 0.01:  # 0.1 N for 1 kg
        return ''
    return (f'pose: it is interpolated linearly between poses at {1.0 / period:.3g} Hz, with '
            f'orientation errors of about {astray:.2g} rad. Weight and inertia are removed '
            'wrongly while the robot moves; record every pose')


# Pace ------------------------------------------------------------------------------------------


def refuse_other_pace(recording: Recording) -> None:
    """
    Refuse times and angles in another unit: rates and speeds that no sensor and no arm has.

    Raises
    ------
    DataError
        Names rate or speed, and the unit that they show.
    """
    streams = {name: stream for name, stream in present(recording, SENSORS).items()
               if len(stream) >= DEAD}
    rates = {name: (n := min(50, len(s) - 1)) / max(float(np.median(s.t[n:] - s.t[:-n])), 1e-300)
             for name, s in streams.items()}
    if not rates:
        return
    fastest = max(rates, key=lambda name: rates[name])
    if rates[fastest] > 5e4:  # no sensor is as fast [Hz]
        raise DataError(
            f'{fastest}: a rate of {rates[fastest]:.3g} Hz is higher than that of any sensor or '
            f'robot: its time is in another unit (s read as ms, or ms as us); {_STATE_UNIT}')
    last = {name: float(one.t[-1] - one.t[0]) for name, one in streams.items()}
    for (long, span), (short, less) in permutations(last.items(), 2):
        for factor, unit in ((1e3, 'ms'), (1e6, 'us')):
            if abs(span / less / factor - 1.0) < 0.05:
                raise DataError(
                    f'{long}: its {len(streams[long])} readings last {span:.3g} s, those of '
                    f'{short} {less:.3g} s ({len(streams[short])}): one has its time in {unit}, '
                    f'the other in s; {_STATE_UNIT}')
    if 'pose' in streams:
        _refuse_other_speed(streams['pose'], fastest, rates)


def _refuse_other_speed(pose: PoseStream, fastest: str, rates: Mapping[str, float]) -> None:
    """Refuse poses that creep, whirl or fly."""
    def each(seconds: float) -> int:
        return max(1, min(round(seconds * rates['pose']), len(pose) // DEAD))

    R, t = pose.R_base_sensor[::each(0.02)], pose.t[::each(0.02)]
    turned = np.linalg.norm(rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=1)
    took = np.diff(t).clip(min=0.5 * each(0.02) / rates['pose'])  # of poses in bursts
    speed = turned / took
    if rates[fastest] < 5.0 and turned.sum() > 0.3 and turned.max() < 0.35 and (
            speed.max() < 0.02):
        raise DataError(
            f'{fastest}: its rate is {rates[fastest]:.2g} Hz and the pose rotates at '
            f'{speed.max():.2g} rad/s at most, slower than any robot: time is in ms or us but '
            f'read as s, or counts rows; {_STATE_UNIT} (if rows are evenly spaced, set rate)')
    turning, moving = float(np.quantile(speed, 0.9)), 0.0
    if pose.has_position:
        n = each(0.1)
        place, at = (x[:len(pose) // n * n].reshape(len(pose) // n, n, -1).mean(axis=1)
                     for x in (pose.position, pose.t))
        moving = float(np.quantile(np.linalg.norm(np.diff(place, axis=0), axis=1) / np.diff(
            at[:, 0]).clip(min=0.5 * n / rates['pose']), 0.9))
    if turning > MAX_SPEED and moving > MAX_SPEED:
        why = 'time is in s but read as ms or us'
    elif turning > MAX_SPEED:
        why = 'its angles are in degrees but read as radians, or time is in s but read as ms'
    elif moving > MAX_SPEED:
        raise DataError(f'pose: its position moves at {moving:.3g} m/s for 10 % of the recording, '
                        'faster than any arm: it is in mm; multiply by 0.001 in the driver (for a '
                        'table read by forcecal import, set "unit: mm" in its specification '
                        'instead)')
    else:
        return
    raise DataError(f'pose: it rotates at {turning:.3g} rad/s and moves at {moving:.3g} m/s for '
                    f'10 % of the recording, faster than any arm: {why}; {_STATE_UNIT}')


def refuse_degrees_a_second(recording: Recording) -> None:
    """
    Refuse a gyro that turns 57 times as fast as the pose, or as gravity in the accelerometer.

    Raises
    ------
    DataError
        Says how many times.
    """
    gyro, pose, force = recording.angular_velocity, recording.pose, recording.accelerometer
    by = pose if pose is not None and len(pose) >= DEAD else force
    if gyro is None or by is None or min(len(gyro), len(by)) < DEAD:
        return
    t = np.arange(max(by.t[0], gyro.t[0]), min(by.t[-1], gyro.t[-1]), 0.1)
    if len(t) < DEAD:
        return
    times = 0.0
    if isinstance(by, PoseStream):
        R = by.R_base_sensor[np.searchsorted(by.t, t)]
        turning = np.linalg.norm(rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=1) / 0.1
        read = np.linalg.norm(gyro.at((t[1:] + t[:-1]) / 2.0), axis=1)
        moves = turning > 0.1
        times = float(np.median(read[moves] / turning[moves])) if moves.any() else 0.0
    elif recording.accelerometer_unit != 'V':
        f = by.at(t)
        change, expected = (f[2:] - f[:-2]) / 0.2, -np.cross(gyro.at(t), f)[1:-1]
        both, own, others = ((change * expected).sum(), (change**2).sum(), (expected**2).sum())
        times = float(others / both) if both > 0.7 * np.sqrt(own * others) else 0.0
    if abs(times / np.degrees(1.0) - 1.0) < 0.25:
        raise DataError(f'angular_velocity: it is {times:.3g} times the rotation rate of the '
                        'tool: it is in deg/s; multiply by 0.0174533 in the driver (for a table '
                        'read by forcecal import, set "unit: deg/s" in its specification instead)')


def refuse_far_displacement(optidrive: Stream | None) -> None:
    """
    Refuse a tool that is displaced farther than any is long.

    Raises
    ------
    DataError
        Names the displacement and its likely unit.
    """
    if optidrive is None or not len(optidrive):
        return
    away = float(np.nanmedian(np.abs(optidrive.values)))
    if away > FARTHEST:
        raise DataError(f'optidrive: the displacement is {above(away, FARTHEST)} m, expected at '
                        f'most {FARTHEST:g} m: it is probably in mm; multiply it by 0.001')
