"""Tables and recordings as one chunk: CSV text, an array in a .npy file, or topics of a bag."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from forcecal_ros.checks.signals import ABSURD_RAW, readable, refuse_apart
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.blocks import Chunk
from forcecal_ros.insitu.spec import DEFAULT_RATE, Spec
from forcecal_ros.io.csv_import.specification import Column
import numpy as np

ROWS = 50_000
"""Rows that are read at a time."""


def read_table(spec: Spec, path: Path, raw: Sequence[Column],
               progress: Callable[[int], object] = lambda rows: None) -> tuple[Chunk, list[str]]:
    """
    Read a table, and leave out rows that are not numbers or not later than those before.

    Parameters
    ----------
    raw : sequence of str or int
        Columns of the raw channels.
    progress : callable
        Called with the number of rows read since its last call.

    Returns
    -------
    Chunk
        In SI units.
    list of str
        What the user should look at.

    Raises
    ------
    DataError
        The table cannot be read, lacks a column, or too many rows are no readings.
    """
    gyro, time = spec.gyro, spec.time
    parts = ((time.column,) if time else (), tuple(raw), spec.accelerometer.columns,
             gyro.columns if gyro else ())
    for part, name in zip(parts[1:3], ('sensor', 'accelerometer')):
        if not part:
            raise DataError(f'{spec.path}: {path.name} is a table; set the columns of the {name}')
    pieces = []
    for piece in _rows(spec, path, [column for part in parts for column in part]):
        pieces.append(piece)
        progress(len(piece))
    rows = np.concatenate([np.empty((0, sum(map(len, parts)))), *pieces])
    t, channels, f, turn = np.split(rows, np.cumsum([len(part) for part in parts])[:-1], axis=1)
    stamps = (t[:, 0] * time.scale if time
              else np.arange(len(rows)) / (spec.rate or DEFAULT_RATE))
    names = [f'column {name}' for part in parts[1:] for name in part]
    good, _ = readable(stamps, rows[:, len(parts[0]):], path.name, names, ABSURD_RAW)
    good &= np.isfinite(stamps)
    good[1:] &= stamps[1:] > np.maximum.accumulate(np.where(good, stamps, -np.inf))[:-1]
    notes = []
    if left_out := int((~good).sum()):
        notes.append(f'{path.name}: {left_out} rows that are not numbers or not in order of time '
                     'were left out')
    if time and spec.rows == 'samples' and good.any():
        from forcecal_ros.io.csv_import.table import question_rate

        notes += question_rate(len(rows), float(np.ptp(stamps[good])),
                               f'{path.name}, column {time.column!r}', time.unit)
    return Chunk(stamps[good], channels[good], f[good] * spec.accelerometer.scale,
                 turn[good] * gyro.scale if gyro else None), notes


def _rows(spec: Spec, path: Path, columns: Sequence[Column]) -> Iterator[Array]:
    named = not all(isinstance(column, int) for column in columns)
    if path.suffix != '.npy':
        from forcecal_ros.io.csv_import.table import read_tables

        for table in read_tables(path, spec, named=named, rows=ROWS, text=False):
            yield table.numbers(columns)
        return
    if named:
        raise DataError(f'{path}: columns of an array are numbers from 0, not names')
    try:
        rows = np.load(path, mmap_mode='r')
        least = 1 + max(int(column) for column in columns)
        if rows.ndim != 2 or least > rows.shape[1]:
            raise DataError(f'{path}: an array of shape {rows.shape}; expected rows with '
                            f'{least} columns or more')
        yield np.array(rows[:, columns], dtype=float)
    except (OSError, ValueError) as error:
        raise DataError(f'{path}: cannot be read ({error})') from error


def topics_of(spec: Spec, sensor: str) -> dict[str, Sequence[str]]:
    """
    Return which fields of which topics a sensor's calibration needs.

    Raises
    ------
    DataError
        The SPEC names no topic.
    """
    fields_of: dict[str, Sequence[str]] = {}
    for channels, name in ((spec.sensors[sensor], sensor), (spec.accelerometer, 'accelerometer'),
                           (spec.gyro, 'gyro')):
        if channels is None:
            continue
        if channels.topic is None:
            raise DataError(f'{spec.path}: a data set is a recording; set the topic of the {name}')
        fields_of[channels.topic] = (*fields_of.get(channels.topic, ()), *channels.fields)
    return fields_of


def join(chunks: Iterable[tuple[str, Array, Array]], spec: Spec, sensor: str) -> Chunk:
    """
    Interpolate accelerometer and gyro to the sensor's stamps.

    Parameters
    ----------
    chunks : iterable of (str, ndarray, ndarray)
        Topic, stamps [s] and values.
    sensor : str
        Its name.

    Returns
    -------
    Chunk
        SI units; samples that are no readings, and those before or after another signal's first or
        last, are left out.

    Raises
    ------
    DataError
        Too many samples are no readings, or the clocks of topics are apart.
    """
    topics, accelerometer, gyro = topics_of(spec, sensor), spec.accelerometer, spec.gyro
    parts: dict[str, list[tuple[Array, Array]]] = {topic: [] for topic in topics}
    for topic, t, values in chunks:
        parts[topic].append((t, values))
    signals = {}
    for topic, some in parts.items():
        if not some:
            return Chunk(none := np.empty(0), none, none, None)
        t, values = (np.concatenate(arrays) for arrays in zip(*some))
        good, _ = readable(t, values, topic, topics[topic], ABSURD_RAW)
        signals[topic] = t[good], values[good]
    refuse_apart({topic: (float(t[0]), float(t[-1])) for topic, (t, _) in signals.items()})
    t, raw = signals[str(spec.sensors[sensor].topic)]
    i = np.searchsorted(t, max(stamps[0] for stamps, _ in signals.values()))
    j = np.searchsorted(t, min(stamps[-1] for stamps, _ in signals.values()), side='right')
    return Chunk(
        t[i:j], raw[i:j],
        accelerometer.scale * _at(signals[str(accelerometer.topic)], t[i:j], slice(0, 3)),
        gyro.scale * _at(signals[str(gyro.topic)], t[i:j], slice(-3, None)) if gyro else None)


def _at(signal: tuple[Array, Array], t: Array, columns: slice) -> Array:
    stamps, values = signal
    return np.stack([np.interp(t, stamps, column) for column in values[:, columns].T], axis=1)
