"""Tables of any length as chunks: CSV text, or a two-dimensional array in a .npy file."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from forcecal_ros.checks.signals import ABSURD_RAW, refuse_apart, Unreadable
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.blocks import Chunk
from forcecal_ros.insitu.spec import DEFAULT_RATE, Spec
from forcecal_ros.io.csv_import.specification import Column
import numpy as np

ROWS = 50_000
"""Rows that are read at a time."""


class TableSource:
    """
    Reads one table from its beginning whenever it is called.

    Parameters
    ----------
    raw : sequence of str or int
        Columns of the raw channels.

    Attributes
    ----------
    left_out : int
        Rows of the last reading without finite numbers, or not later than the one before.
    notes : tuple of str
        What the user should look at after the last reading.
    """

    def __init__(self, spec: Spec, path: Path, raw: Sequence[Column]) -> None:
        self._spec = spec
        self._path = path
        gyro = spec.gyro.columns if spec.gyro else ()
        time = (spec.time.column,) if spec.time else ()
        self._parts = (time, tuple(raw), spec.accelerometer.columns, gyro)
        self.left_out = 0
        self.notes: tuple[str, ...] = ()
        for part, name in zip(self._parts[1:3], ('sensor', 'accelerometer')):
            if not part:
                raise DataError(f'{spec.path}: {path.name} is a table; set the columns of the '
                                f'{name}')

    def __call__(self) -> Iterator[Chunk]:
        """Yield the table's rows in SI units, clean."""
        ends = np.cumsum([len(part) for part in self._parts])[:-1]
        names = [f'column {name}' for part in self._parts[1:] for name in part]
        unreadable = Unreadable(self._path.name, names, ABSURD_RAW)
        accelerometer, gyro = self._spec.accelerometer.scale, self._spec.gyro
        self.left_out, row, first, last = 0, 0, np.inf, -np.inf
        for rows in self._rows([column for part in self._parts for column in part]):
            t, raw, f, turn = np.split(rows, ends, axis=1)
            if self._spec.time:
                stamps = t[:, 0].astype(float) * self._spec.time.scale
            else:
                stamps = (row + np.arange(len(rows))) / (self._spec.rate or DEFAULT_RATE)
            row += len(rows)
            good = unreadable.add(stamps, rows[:, len(self._parts[0]):]) & np.isfinite(stamps)
            if not (good.all() and stamps[0] > last and (np.diff(stamps) > 0).all()):
                before = np.maximum.accumulate(np.concatenate(
                    [[last], np.where(good, stamps, -np.inf)]))[:-1]
                good &= stamps > before
                self.left_out += int((~good).sum())
                stamps, raw, f, turn = stamps[good], raw[good], f[good], turn[good]
            if len(stamps):
                first, last = min(first, stamps[0]), stamps[-1]
                yield Chunk(
                    stamps, raw, f if accelerometer == 1.0 else f.astype(float) * accelerometer,
                    turn.astype(float) * gyro.scale if gyro else None)
        unreadable.note()
        self.notes = tuple(self._notes(row, last - first))

    def _notes(self, rows: int, span: float) -> Iterator[str]:
        name, time = self._path.name, self._spec.time
        if self.left_out:
            yield (f'{name}: {self.left_out} rows that are not numbers or not in order of time '
                   'were left out')
        if time and self._spec.rows == 'samples':
            from forcecal_ros.io.csv_import.table import question_rate

            yield from question_rate(rows, span, f'{name}, column {time.column!r}', time.unit)

    def _rows(self, columns: Sequence[Column]) -> Iterator[Array]:
        if self._path.suffix == '.npy':
            yield from self._array_rows(columns)
            return
        from forcecal_ros.io.csv_import.table import read_tables

        named = not all(isinstance(column, int) for column in columns)
        for table in read_tables(self._path, self._spec, named=named, rows=ROWS,
                                 text=False):
            yield table.numbers(columns)

    def _array_rows(self, columns: Sequence[Column]) -> Iterator[Array]:
        if not all(isinstance(column, int) for column in columns):
            raise DataError(f'{self._path}: columns of an array are numbers from 0, not names')
        try:
            shape = np.load(self._path, mmap_mode='r').shape
            if len(shape) != 2 or max(int(column) for column in columns) >= shape[1]:
                raise DataError(f'{self._path}: an array of shape {shape}; expected rows with '
                                f'{1 + max(int(column) for column in columns)} columns or more')
            rows = np.load(self._path, mmap_mode='r')
            for start in range(0, shape[0], ROWS):
                yield np.array(rows[start:start + ROWS, columns], dtype=float)
        except (OSError, ValueError) as error:
            raise DataError(f'{self._path}: cannot be read ({error})') from error


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
        Topic, stamps [s] and values.
    sensor : str
        Its name.

    Yields
    ------
    Chunk
        SI units; samples before or after another signal's first or last are left out.
    """
    topics = topics_of(spec, sensor)
    parts: dict[str, list[tuple[Array, Array]]] = {topic: [] for topic in topics}
    for topic, t, values in chunks:
        parts[topic].append((t, values))
    if not all(parts.values()):
        return
    signals = {topic: (np.concatenate([t for t, _ in some]), np.concatenate([x for _, x in some]))
               for topic, some in parts.items()}
    t, raw = signals[str(spec.sensors[sensor].topic)]
    i = np.searchsorted(t, max(stamps[0] for stamps, _ in signals.values()))
    j = np.searchsorted(t, min(stamps[-1] for stamps, _ in signals.values()), side='right')
    if j > i:
        accelerometer, gyro = spec.accelerometer, spec.gyro
        yield Chunk(
            t[i:j], raw[i:j],
            accelerometer.scale * _at(signals[str(accelerometer.topic)], t[i:j], slice(0, 3)),
            gyro.scale * _at(signals[str(gyro.topic)], t[i:j], slice(-3, None)) if gyro else None)


def _at(signal: tuple[Array, Array], t: Array, columns: slice) -> Array:
    stamps, values = signal
    return np.stack([np.interp(t, stamps, column) for column in values[:, columns].T], axis=1)
