"""What the columns of tables mean: a YAML file that names signals, units and frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcecal_ros.errors import ConfigError
from forcecal_ros.recording.csv_import.units import in_si, NANOSECONDS
from forcecal_ros.recording.streams import PHASES
from forcecal_ros.safe_yaml import LARGEST, load_yaml

FORMAT = 'forcecal-import/1'

_WRENCH = {'force': ('force', 3), 'torque': ('torque', 3)}
_POSE = {'position': ('length', 3), 'R_base_sensor': ('number', 9), 'R_sensor_base': ('number', 9),
         'quaternion_xyzw': ('number', 4), 'rpy': ('angle', 3)}
SIGNALS: Mapping[str, Mapping[str, tuple[str, int]]] = {
    'wrench': _WRENCH,
    'contact_truth': _WRENCH,
    'accelerometer': {'voltage': ('voltage', 3)},
    'accel': {'acceleration': ('acceleration', 3)},
    'imu': {'acceleration': ('acceleration', 3), 'angular_velocity': ('angular velocity', 3)},
    'pose': _POSE,
    'target': _POSE,
    'optidrive': {'displacement': ('length', 1)},
}
"""Role -> part -> quantity and number of columns."""

ORIENTATIONS = ('R_base_sensor', 'R_sensor_base', 'quaternion_xyzw', 'rpy')
_OPTIONAL = {'position', 'angular_velocity', *ORIENTATIONS}


@dataclass(frozen=True)
class Part:
    """Columns of one quantity, and what makes SI of each."""

    columns: tuple[str, ...]
    factors: tuple[float, ...]


@dataclass(frozen=True)
class Signal:
    """One signal of a table: its parts by name, the frame and, if not the usual, the topic."""

    parts: Mapping[str, Part]
    frame: str
    topic: str | None


@dataclass(frozen=True)
class TableSpecification:
    """
    One table.

    Attributes
    ----------
    path : Path
    delimiter : str
    time_column : str or None
        None for a table without time, which then has a rate.
    time_unit : int
        Nanoseconds in the unit of the time column.
    rate : float
        Rows a second [Hz].
    start : float
        Time of the first row of a table without time [s].
    phases : mapping of str to str
        ``column``, or ``each_row`` and ``between``, or ``whole``; empty where there are none.
    signals : mapping of str to Signal
        By role.
    """

    path: Path
    delimiter: str
    time_column: str | None
    time_unit: int
    rate: float
    start: float
    phases: Mapping[str, str]
    signals: Mapping[str, Signal]


@dataclass(frozen=True)
class Specification:
    """All tables of one recording."""

    tables: tuple[TableSpecification, ...]
    path: Path


def load_specification(path: Path | str, folder: Path | str | None = None) -> Specification:
    """
    Read and check an import specification.

    Parameters
    ----------
    path : Path or str
        YAML file; see ``config/examples``.
    folder : Path or str, optional
        What the paths of the tables count from; the file's own folder if not given.

    Returns
    -------
    Specification

    Raises
    ------
    ConfigError
        The file cannot be read, or says what makes no sense; the key is named.
    """
    path = Path(path)
    reader = _Reader(path, path.parent if folder is None else Path(folder))
    document = reader.mapping(_parse(path), 'the file', ('format', 'tables'))
    if document.get('format') != FORMAT:
        raise ConfigError(f'{path}: format must be {FORMAT}')
    tables = document.get('tables')
    if not isinstance(tables, list) or not tables:
        raise ConfigError(f'{path}: tables must be a list of tables, each with file and signals')
    return Specification(
        tuple(reader.table(table, number) for number, table in enumerate(tables, 1)), path)


def _parse(path: Path) -> Any:
    try:
        with path.open('rb') as file:
            return load_yaml(file.read(LARGEST + 1), str(path))
    except OSError as error:
        raise ConfigError(f'{path}: cannot be read ({error.strerror})') from error


class _Reader:
    """Checks and converts one document; every complaint names the file and the key."""

    def __init__(self, path: Path, folder: Path) -> None:
        self._path = path
        self._folder = folder

    def wrong(self, where: str, what: str) -> ConfigError:
        return ConfigError(f'{self._path}: {where}: {what}')

    def mapping(self, value: Any, where: str, keys: Sequence[str]) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise self.wrong(where, f'expected keys such as {", ".join(keys)}')
        if unknown := [str(key)[:40] for key in value if key not in keys]:
            raise self.wrong(where, f'unknown {", ".join(unknown)}; the keys are '
                                    f'{", ".join(keys)}')
        return value

    def text(self, value: Any, where: str) -> str:
        if not isinstance(value, str) or not value:
            raise self.wrong(where, 'expected a text')
        return value

    def number(self, value: Any, where: str) -> float:
        if type(value) not in (int, float) or not -1e12 < value < 1e12:
            raise self.wrong(where, 'expected a number')
        return float(value)

    def table(self, value: Any, number: int) -> TableSpecification:
        where = f'table {number}'
        table = self.mapping(value, where, (
            'file', 'delimiter', 'time', 'rate', 'start', 'phases', 'signals'))
        file = self.text(table.get('file'), f'{where} file')
        where = f'table {number} ({file})'
        delimiter = table.get('delimiter', ',')
        if not isinstance(delimiter, str) or len(delimiter) != 1 or delimiter in '"\r\n':
            raise self.wrong(f'{where} delimiter', 'expected one character')
        column, unit = self.time(table, where)
        rate = self.number(table.get('rate', 1.0), f'{where} rate')
        if not rate > 0:
            raise self.wrong(f'{where} rate', 'expected rows a second, above 0')
        signals = self.mapping(table.get('signals'), f'{where} signals', tuple(SIGNALS))
        return TableSpecification(
            self._folder / file, delimiter, column, unit, rate,
            self.number(table.get('start', 0.0), f'{where} start'),
            self.phases(table.get('phases'), f'{where} phases'),
            {role: self.signal(role, signal, f'{where} {role}')
             for role, signal in signals.items()})

    def time(self, table: Mapping[str, Any], where: str) -> tuple[str | None, int]:
        if ('time' in table) == ('rate' in table):
            raise self.wrong(where, 'expected either time (column and unit) or rate (rows a '
                                    'second, for a table without time)')
        if 'rate' in table:
            return None, 1
        if 'start' in table:
            raise self.wrong(where, 'start is for tables without time')
        time = self.mapping(table['time'], f'{where} time', ('column', 'unit'))
        unit = self.text(time.get('unit'), f'{where} time unit')
        if unit not in NANOSECONDS:
            raise self.wrong(f'{where} time', f'{unit!r} is no unit of time here; use '
                                              f'{", ".join(NANOSECONDS)}')
        return self.text(time.get('column'), f'{where} time column'), NANOSECONDS[unit]

    def phases(self, value: Any, where: str) -> Mapping[str, str]:
        if value is None:
            return {}
        phases = self.mapping(value, where, ('column', 'each_row', 'between', 'whole'))
        if set(phases) not in ({'column'}, {'each_row', 'between'}, {'whole'}):
            raise self.wrong(where, 'expected column, or each_row and between, or whole')
        words = {key: self.text(word, f'{where} {key}') for key, word in phases.items()}
        for key, word in words.items():
            if key != 'column' and word not in PHASES:
                raise self.wrong(f'{where} {key}', f'{word!r} is no phase; use '
                                                   f'{", ".join(PHASES)}')
        if 'between' in words and words['between'] == words['each_row']:
            raise self.wrong(where, 'each_row and between must differ, to tell the rows apart')
        return words

    def signal(self, role: str, value: Any, where: str) -> Signal:
        known = SIGNALS[role]
        signal = self.mapping(value, where, ('frame', 'topic', *known))
        missing = [part for part in known if part not in signal and part not in _OPTIONAL]
        if missing:
            raise self.wrong(where, f'{", ".join(missing)} is missing')
        if known is _POSE and sum(part in signal for part in ORIENTATIONS) != 1:
            raise self.wrong(where, f'expected one of {", ".join(ORIENTATIONS)}')
        topic = signal.get('topic')
        return Signal(
            {part: self.part(signal[part], f'{where} {part}', *known[part])
             for part in known if part in signal},
            self.text(signal.get('frame'), f'{where} frame'),
            None if topic is None else self.text(topic, f'{where} topic'))

    def part(self, value: Any, where: str, quantity: str, width: int) -> Part:
        if quantity == 'number':
            value = {'columns': value, 'unit': '1'}
        part = self.mapping(value, where, ('columns', 'unit', 'signs'))
        columns = part.get('columns')
        if not isinstance(columns, list) or len(columns) != width:
            raise self.wrong(where, f'expected a list of {width} columns')
        signs = part.get('signs', [1] * width)
        if not isinstance(signs, list) or len(signs) != width or not set(signs) <= {1, -1}:
            raise self.wrong(f'{where} signs', f'expected {width} times 1 or -1')
        size = in_si(quantity, self.text(part.get('unit'), f'{where} unit'),
                     f'{self._path}: {where}')
        return Part(tuple(self.text(column, f'{where} columns') for column in columns),
                    tuple(size * sign for sign in signs))
