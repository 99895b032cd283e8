"""What the stamps of a stream say of its clock: rate, losses, jitter, pauses; clocks apart."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.stamps import jitter_of
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.core.topics import ROLES
import numpy as np
from numpy.typing import NDArray

STREAMS = ('wrench', 'accelerometer', 'optidrive', 'pose', 'target')


class Clock(NamedTuple):
    """
    What the stamps of one stream say.

    Attributes
    ----------
    stream : str
    rate : float
        [Hz] that the stream should have: the one known or a whole part of it, else the nearest
        whole number.
    skew : float
        Relative excess of the stamped period.
    lost : float
        Fraction of samples missing.
    jitter : float
        RMS about a straight line [s].
    std : float
        Of the skew.
    """

    stream: str
    rate: float
    skew: float
    lost: float
    jitter: float
    std: float


def clocks(recording: Recording, rates: Mapping[str, float] = MappingProxyType({})
           ) -> tuple[Clock, ...]:
    """
    Judge the stamps of every stream.

    Parameters
    ----------
    rates : mapping of str to float
        Of each stream, where they are known [Hz].
    """
    found = []
    for name in STREAMS:
        stream = getattr(recording, name)
        if stream is not None and len(stream) > 100:
            found.append(_clock(name, np.asarray(stream.t), rates.get(name)))
    return tuple(found)


def _clock(name: str, t: Array, nominal: float | None) -> Clock:
    steps = np.diff(t)
    period = float(np.median(steps))
    index = np.concatenate([[0.0], np.cumsum(np.maximum(1.0, np.rint(steps / period)))])
    # after a pause the samples may be on another line of the same slope
    part = np.concatenate([[0], np.cumsum(steps > max(limits.PAUSE, 2.0 * period))])
    slope, offset = _line(index, t, part)
    index = np.rint((t - offset) / slope)
    slope, offset = _line(index, t, part)
    rate = max(1.0, round(1.0 / slope))
    if nominal:
        part_of = nominal / max(1, round(nominal * slope))  # every k-th sample, as drivers thin
        near, whole = abs(part_of * slope - 1.0), abs(rate * slope - 1.0)
        if near < (limits.FARTHEST if part_of == nominal else whole):
            rate = part_of
    missing = float(np.sum((np.diff(index) - 1.0)[np.diff(part) == 0]))
    scatter = float(np.std(t - offset - slope * index))
    std = scatter * rate / float(np.std(index) * np.sqrt(len(index)))
    return Clock(name, rate, float(slope * rate - 1.0),
                 float(max(0.0, missing / (missing + len(t)))), scatter, std)


def _line(x: Array, y: Array, part: NDArray[np.intp]) -> tuple[float, Array]:
    """Fit lines of one slope; return it, and the offset of every sample's part."""
    count = np.bincount(part)
    x0, y0 = (np.bincount(part, v) / count for v in (x, y))
    dx = x - x0[part]
    slope = float(dx @ (y - y0[part]) / (dx @ dx))
    return slope, np.asarray((y0 - slope * x0)[part])


def skew_between(found: tuple[Clock, ...]) -> dict[str, float]:
    """Return the skew of each sensor's clock against that of the commands, where it counts."""
    reference = next((c.skew for c in found if c.stream == 'target'), 0.0)
    return {c.stream: c.skew - reference for c in found
            if c.stream != 'target' and abs(c.skew - reference) < limits.FARTHEST
            and abs(c.skew - reference) > limits.SKEW + 5.0 * c.std
            and c.jitter * c.rate < limits.JITTER}


def dropouts(found: tuple[Clock, ...]) -> dict[str, float]:
    """Return the fraction of lost samples of each sensor, where it counts."""
    return {c.stream: c.lost for c in found if c.lost > limits.LOST}


def refuse_clocks_apart(recording: Recording) -> None:
    """
    Refuse streams that do not overlap with the others because their clocks differ.

    Raises
    ------
    DataError
        Names the streams that most others do not overlap with, and how far off they begin.
    """
    refuse_apart({_called(name): (float(stream.t[0]), float(stream.t[-1]))
                  for name in (*STREAMS, 'angular_velocity')
                  if (stream := getattr(recording, name)) is not None and len(stream)})


def refuse_offset(recording: Recording, smoothed: bool = False) -> None:
    """
    Refuse a sensor whose readings follow gravity as the pose turns it at another time.

    Parameters
    ----------
    smoothed : bool
        The wrench is known to be late because its driver smooths it.

    Raises
    ------
    DataError
        Names the sensor and how far its stamps are off those of the pose.
    """
    for name in ('accelerometer',) if smoothed else ('wrench', 'accelerometer'):
        stream = getattr(recording, name)
        if stream is not None and recording.pose is not None:
            late = offset_from_gravity(stream, recording.pose)
            if abs(late) > limits.OFFSET:
                raise DataError(
                    f'{_called(name)} shows gravity turn {abs(late):.2f} s '
                    f'{"later" if late > 0 else "earlier"} than the pose, by their stamps: set '
                    'the clocks of all computers by one (PTP or chrony) and record again; '
                    f'{-late:+.2f} s on all stamps of {name} would mend this recording')


def offset_from_gravity(stream: Stream, pose: PoseStream) -> float:
    """
    Find how much later than a pose a sensor shows gravity turn.

    Whatever matrix takes gravity's direction to the readings: unit, sign and axes do not matter.

    Parameters
    ----------
    stream : Stream
        Of forces or accelerations, in the first three columns.

    Returns
    -------
    float
        [s]; 0 where the stamps explain the readings as well, or nothing does.
    """
    step = limits.OFFSET_STEP
    start, end = max(stream.t[0], pose.t[0]), min(stream.t[-1], pose.t[-1])
    if min(len(stream), len(pose)) < 100 or end - start < 100 * step:
        return 0.0
    edges = np.arange(start, end, step)
    down, read = (means_between(t, values, edges) for t, values in (
        (pose.t, pose.R_base_sensor[:, 2]), (stream.t, stream.values[:, :3])))
    half = len(down) // 2
    halves = [(down[part], read[part]) for part in (slice(None, half), slice(half, None))]
    if min(np.linalg.norm(g.std(axis=0)) for g, _ in halves) < limits.OFFSET_TURNED:
        return 0.0
    lags = np.arange(-(most := min(round(limits.OFFSET_SPAN / step), half // 2)), most + 1)
    best = int(lags[np.argmin(_unexplained(down, read, lags))])
    # one event may look like another of a later time, in one half and not in both
    return best * step if all(_belongs(g, f, best) for g, f in halves) else 0.0


def _belongs(down: Array, read: Array, lag: int) -> bool:
    """Say whether gravity explains readings so many steps later, and not at their own time."""
    near = round(limits.OFFSET / limits.OFFSET_STEP)
    at_stamps = float(_unexplained(down, read, np.arange(-near, near + 1)).min())
    there = float(_unexplained(down, read, np.array([lag]))[0])
    return bool(there < 1.0 - limits.OFFSET_EXPLAINS and at_stamps > limits.OFFSET_TIMES * there)


def means_between(t: Array, values: Array, edges: Array) -> Array:
    """Means between edges, of what is interpolated where nothing was sampled."""
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    at = np.searchsorted(t, edges)
    count = np.diff(at)
    means = np.diff(sums[at], axis=0) / np.maximum(count, 1)[:, None]
    have, middle = count > 0, (edges[1:] + edges[:-1]) / 2.0
    return np.stack([np.interp(middle, middle[have], column[have]) for column in means.T], axis=1)


def _unexplained(down: Array, read: Array, lags: NDArray[np.intp]) -> Array:
    """
    Share of the changes of readings, so many steps later, that gravity does not explain.

    Products of all lags come of one transform, so that hours take no longer than seconds do.
    """
    from scipy.signal import correlate  # takes a second, which a node does not start with

    g, f = down - down.mean(axis=0), read - read.mean(axis=0)
    n = len(g) - np.abs(lags)
    of_g, of_f = np.maximum(0, -lags), np.maximum(0, lags)
    gg, (sum_g, sum_f) = _sums(g[:, :, None] * g[:, None], of_g, n), (
        _sums(g, of_g, n), _sums(f, of_f, n))
    cross = np.array([[correlate(y, x, method='fft')[len(g) - 1 + lags] for y in f.T]
                      for x in g.T]).transpose(2, 0, 1)
    gg -= sum_g[:, :, None] * sum_g[:, None] / n[:, None, None]
    cross -= sum_g[:, :, None] * sum_f[:, None] / n[:, None, None]
    total = (_sums(f**2, of_f, n) - sum_f**2 / n[:, None]).sum(axis=1)
    explained = (cross * (np.linalg.pinv(gg, rcond=1e-6, hermitian=True) @ cross)).sum(axis=(1, 2))
    return np.where(total > 0.0, 1.0 - explained / np.where(total > 0.0, total, 1.0), 1.0)


def _sums(values: Array, start: NDArray[np.intp], count: NDArray[np.intp]) -> Array:
    """Return sums over so many rows from each of some rows on."""
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return np.asarray(sums[start + count] - sums[start])


def refuse_apart(spans: Mapping[str, tuple[float, float]]) -> None:
    """
    Refuse streams, each by its first and last stamp [s], as :func:`refuse_clocks_apart`.

    Raises
    ------
    DataError
        Names them.
    """
    meets = {name: {other for other in spans if _gap(spans[name], spans[other]) < limits.APART}
             for name in spans}
    most = max(spans, key=lambda name: len(meets[name]), default='')
    apart = [name for name in spans if name not in meets[most]]
    if apart:
        listed = ', '.join(f'{name} {spans[name][0] - spans[most][0]:+.1f} s' for name in apart)
        raise DataError(f'stamps begin too far from those of {most}: {listed}; set the clocks of '
                        'all computers by one (PTP or chrony), and record again')


def _gap(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Time between the end of one span and the beginning of the other [s]; below 0: overlap."""
    return max(one[0] - other[1], other[0] - one[1])


def _called(name: str) -> str:
    topic = ROLES[name].topic if name in ROLES else name
    return name if topic == name else f'{name} ({topic})'


SENSORS = ('wrench', 'accelerometer', 'optidrive', 'pose')

Gap = tuple[float, float]
"""Stamps of the last sample before and the first after [s]."""


def silences(recording: Recording) -> tuple[str, ...]:
    """Tell when single sensors, or all streams, said nothing for a while."""
    common = pauses(recording)
    found = [('all streams', common)]
    for name in SENSORS:
        stream = getattr(recording, name)
        own = _gaps(stream.t, _period(stream.t)) if stream is not None else []
        found.append((name, [gap for gap in own if not any(
            start < gap[1] and gap[0] < end for start, end in common)]))
    return tuple(line for who, gaps in found for line in _pause_lines(who, gaps))


def lost_messages(recording: Recording) -> Iterator[str]:
    """Tell which of wrench and pose miss many messages besides pauses."""
    for name in ('wrench', 'pose'):
        stream = getattr(recording, name)
        if stream is None or len(stream) <= limits.DEAD:
            continue
        jitter = jitter_of(stream.t)
        short = np.diff(stream.t) < max(limits.PAUSE, limits.PAUSE_PERIODS * jitter.period)
        missing = int((np.diff(jitter.number) - 1)[short].sum())
        if missing > limits.LOST_TOLD * (missing + len(stream)):
            yield (f'{name}: {missing / (missing + len(stream)):.0%} of its messages are missing: '
                   'record on the computer that sends them')


def _pause_lines(who: str, gaps: list[Gap]) -> list[str]:
    if len(gaps) > limits.PAUSES_TOLD:
        longest = max(gaps, key=lambda gap: gap[1] - gap[0])
        return [(f'{who}: {len(gaps)} pauses in which nothing was recorded, the longest of '
                 f'{longest[1] - longest[0]:.1f} s from {longest[0]:.1f} s on')]
    return [f'{who}: nothing was recorded for {end - start:.1f} s from {start:.1f} s on'
            for start, end in gaps]


def pauses(recording: Recording) -> list[Gap]:
    """List when no stream said anything."""
    streams = [stream.t for name in ('target', *SENSORS)
               if (stream := getattr(recording, name)) is not None and len(stream)]
    if not streams:
        return []
    return _gaps(np.sort(np.concatenate(streams)), min(_period(t) for t in streams))


def _period(t: Array) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else np.inf


def _gaps(t: Array, period: float) -> list[Gap]:
    """List the steps between stamps that are no lost samples, but pauses."""
    least = max(limits.PAUSE, limits.PAUSE_PERIODS * period)
    return [(float(t[i]), float(t[i + 1])) for i in np.flatnonzero(np.diff(t) > least)]
