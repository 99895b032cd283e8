"""When single sensors, or all of them, said nothing for a while."""

from collections.abc import Iterator

from forcecal_ros.geometry import Array
from forcecal_ros.recording.checks import limits
from forcecal_ros.recording.stamps import jitter_of
from forcecal_ros.recording.streams import Recording
import numpy as np

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
    return tuple(told for who, gaps in found for told in _pause_lines(who, gaps))


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
                   'record with reliable QoS, or on the computer that sends them')


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
