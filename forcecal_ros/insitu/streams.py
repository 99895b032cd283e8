"""Signals that arrive on topics of their own, joined on the stamps of the sensor."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from forcecal_ros.checks.signals import ABSURD_RAW, refuse_apart, Unreadable
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.prepare import Chunk
from forcecal_ros.insitu.spec import Spec
import numpy as np


def topics_of(spec: Spec, sensor: str) -> dict[str, Sequence[str]]:
    """
    Return which fields of which topics a sensor's calibration needs.

    Raises
    ------
    DataError
        The SPEC names no topic.
    """
    wanted: dict[str, Sequence[str]] = {}
    for channels, name in ((spec.sensors[sensor], sensor), (spec.accelerometer, 'accelerometer'),
                           (spec.gyro, 'gyro')):
        if channels is None:
            continue
        if channels.topic is None:
            raise DataError(f'{spec.path}: a data set is a recording; name the topic of the '
                            f'{name}')
        wanted[channels.topic] = (*wanted.get(channels.topic, ()), *channels.fields)
    return wanted


def readable_chunks(chunks: Iterable[tuple[str, Array, Array]],
                    topics: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, Array, Array]]:
    """
    Leave out samples that are no readings.

    Raises
    ------
    DataError
        After the last piece: too many were left out, or the clocks of topics are apart.
    """
    counted = {topic: Unreadable(topic, fields, ABSURD_RAW)
               for topic, fields in topics.items()}
    spans: dict[str, tuple[float, float]] = {}
    for topic, t, values in chunks:
        good = counted[topic].add(t, values)
        if good.any():
            yield topic, t[good], values[good]
            begin, _ = spans.get(topic, (float(t[0]), 0.0))
            spans[topic] = begin, float(t[-1])
    for one in counted.values():
        one.note()
    refuse_apart(spans)


def join(chunks: Iterable[tuple[str, Array, Array]], spec: Spec, sensor: str
         ) -> Iterator[Chunk]:
    """
    Interpolate accelerometer and gyro to the sensor's stamps.

    Parameters
    ----------
    chunks : iterable of (str, ndarray, ndarray)
        Topic, stamps [s] and values, roughly in the order of time.
    sensor : str
        Its name.

    Yields
    ------
    Chunk
        SI units; samples before or after another signal's first or last are left out.
    """
    raw_topic, other = spec.sensors[sensor].topic, spec.accelerometer
    assert raw_topic is not None and other.topic is not None
    signals = len(topics_of(spec, sensor))
    held: dict[str, tuple[Array, Array]] = {}
    for topic, t, values in chunks:
        old = held.get(topic)
        held[topic] = (t, values) if old is None else (
            np.concatenate([old[0], t]), np.concatenate([old[1], values]))
        if len(held) < signals or not all(len(stamps) for stamps, _ in held.values()):
            continue
        start = max(stamps[0] for stamps, _ in held.values())
        end = min(stamps[-1] for stamps, _ in held.values())
        t, raw = held[raw_topic]
        i, j = np.searchsorted(t, start), np.searchsorted(t, end, side='right')
        if j <= i:
            continue
        yield _chunk(held, t[i:j], raw[i:j], spec)
        held = {topic: _from(stamps, values, float(t[j - 1]), topic == raw_topic)
                for topic, (stamps, values) in held.items()}


def _chunk(held: Mapping[str, tuple[Array, Array]], t: Array, raw: Array, spec: Spec) -> Chunk:
    accelerometer, gyro = spec.accelerometer, spec.gyro
    assert accelerometer.topic is not None
    force = _at(held[accelerometer.topic], t, slice(0, 3)) * accelerometer.scale
    turn = None
    if gyro is not None:
        assert gyro.topic is not None
        turn = _at(held[gyro.topic], t, slice(-3, None)) * gyro.scale
    return Chunk(t, raw, force, turn)


def _at(signal: tuple[Array, Array], t: Array, columns: slice) -> Array:
    stamps, values = signal
    return np.stack([np.interp(t, stamps, column) for column in values[:, columns].T], axis=1)


def _from(stamps: Array, values: Array, last: float, used: bool) -> tuple[Array, Array]:
    """Forget what is past: all used samples, or all but one that interpolation still needs."""
    keep = int(np.searchsorted(stamps, last, side='right'))
    keep = keep if used else max(keep - 1, 0)
    return stamps[keep:], values[keep:]
