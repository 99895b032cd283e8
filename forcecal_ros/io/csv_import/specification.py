"""What the columns of tables mean: a YAML file that names signals, units and frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
import re
from typing import Annotated, Any, NamedTuple

from forcecal_ros.core.geometry import STANDARD_GRAVITY
from forcecal_ros.core.schema import columns, load, Mismatch, path, read, Row, Section, TEXT
from forcecal_ros.core.streams import PHASES

UNITS: Mapping[str, Mapping[str, float]] = {
    'force': {'N': 1.0, 'mN': 1e-3, 'kN': 1e3, 'kgf': STANDARD_GRAVITY, 'lbf': 4.4482216152605},
    'torque': {'N m': 1.0, 'Nm': 1.0, 'mN m': 1e-3, 'N mm': 1e-3, 'kN m': 1e3,
               'lbf in': 0.1129848290276167},
    'acceleration': {'m/s^2': 1.0, 'mm/s^2': 1e-3, 'g': STANDARD_GRAVITY,
                     'mg': 1e-3 * STANDARD_GRAVITY},
    'voltage': {'V': 1.0, 'mV': 1e-3},
    'angular velocity': {'rad/s': 1.0, 'deg/s': pi / 180},
    'length': {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6},
    'angle': {'rad': 1.0, 'deg': pi / 180},
    'number': {'1': 1.0},
}
"""Quantity -> unit -> its size in SI."""

NANOSECONDS: Mapping[str, int] = {'s': 10**9, 'ms': 10**6, 'us': 10**3, 'ns': 1}
"""Nanoseconds in a unit of time."""

DATE = 'date'
"""In place of a unit of time: year, month, day, hour, minute and second, as ISO 8601 has them."""


_IN_BRACKETS = re.compile(r'[\[(]([^\])]*)[\])]\s*$')
_SUFFIX = re.compile(r'_([A-Za-z]{2,})$')
"""One letter is no unit: ``accel_g`` may as well be gravity."""
_LETTER = re.compile(r'([wxyz])\s*$', re.IGNORECASE)


def named_unit(column: str, units: Mapping[str, float]) -> str | None:
    """Return which of the units a name ends with, as ``x [mm]``, ``x (mm)`` or ``x_mm``."""
    found = _IN_BRACKETS.search(column) or _SUFFIX.search(column)
    word = found.group(1).replace(' ', '') if found else ''
    return next((unit for unit in units if unit.replace(' ', '') == word), None)


def contradiction(columns: Sequence[str], unit: str, units: Mapping[str, float]) -> str:
    """Return which column names another unit, as words; empty where none does."""
    for column in columns:
        named = named_unit(column, units)
        if named is not None and units[named] != units[unit]:
            return f'{named}, as in the name of column {column!r}'
    return ''


def is_xyzw(columns: Sequence[str]) -> bool:
    """Whether names that end with the letters w, x, y and z have them in the order xyzw."""
    found = [_LETTER.search(column) for column in columns]
    letters = ''.join(one.group(1).lower() for one in found if one)
    return sorted(letters) != list('wxyz') or letters == 'xyzw'


Column = str | int
"""Name of a column, or its number from 0 in tables without names."""

FORMAT = 'forcecal-import/1'
ANGLES = ('rpy', 'euler_xyz', 'rotation_vector')
ORIENTATIONS = ('R_base_sensor', 'R_sensor_base', 'quaternion_xyzw', *ANGLES)


@dataclass(frozen=True)
class Part:
    """Columns of one quantity, and what makes SI of each."""

    columns: tuple[str, ...]
    factors: tuple[float, ...]
    unit: str = '1'


@dataclass(frozen=True)
class _Entry:
    """A part as a file writes it."""

    columns: tuple[str, ...]
    unit: str
    signs: tuple[int, ...] = ()


@dataclass(frozen=True)
class _Columns(Row):
    """Row of a part: so many columns of one quantity; 0: any number of them."""

    quantity: str = ''
    width: int = 0

    def take(self, kind: Any, value: Any, where: str) -> Part:
        """Check a part."""
        if isinstance(value, Part):
            return value
        plain = self.quantity == 'number'
        entry = read(_Entry, {'columns': value, 'unit': '1'} if plain else value, where)
        units, width = UNITS[self.quantity], self.width or len(entry.columns)
        for key, right, expected in (
                ('columns', len(entry.columns) == width > 0, f'a list of {width} columns'),
                ('unit', entry.unit in units, f'a unit of {self.quantity}: {", ".join(units)}'),
                ('signs', not entry.signs or (len(entry.signs) == width
                 and set(entry.signs) <= {1, -1}), f'{width} numbers, each 1 or -1')):
            if not right:
                raise Mismatch(where if plain else path(where, key), getattr(entry, key), expected)
        if other := contradiction(entry.columns, entry.unit, units):
            raise Mismatch(path(where, 'unit'), entry.unit, other)
        if self.width == 4 and not is_xyzw(entry.columns):
            raise Mismatch(where, entry.columns, 'the columns x, y, z and w in this order')
        return Part(entry.columns, tuple(units[entry.unit] * sign for sign in
                                         entry.signs or (1,) * width), entry.unit)


@dataclass(frozen=True, kw_only=True)
class Signal(Section):
    """One signal of a table: its parts, the frame and, if not the usual, the topic."""

    frame: Annotated[str, Row('frame_id', pattern=TEXT)]
    topic: Annotated[str | None, Row('None: the default topic', pattern=TEXT)] = None

    @property
    def parts(self) -> Mapping[str, Part]:
        """The parts that it has, by name."""
        found = {column.name: getattr(self, column.name) for column in columns(type(self))}
        return {name: part for name, part in found.items() if isinstance(part, Part)}


@dataclass(frozen=True, kw_only=True)
class Wrench(Signal):
    """Force and torque."""

    force: Annotated[Part, _Columns(quantity='force', width=3)]
    torque: Annotated[Part, _Columns(quantity='torque', width=3)]


@dataclass(frozen=True, kw_only=True)
class Voltage(Signal):
    """Readings of an accelerometer that is not scaled."""

    voltage: Annotated[Part, _Columns(quantity='voltage', width=3)]


@dataclass(frozen=True, kw_only=True)
class Acceleration(Signal):
    """Specific force."""

    acceleration: Annotated[Part, _Columns(quantity='acceleration', width=3)]


@dataclass(frozen=True, kw_only=True)
class Imu(Acceleration):
    """Specific force and, where there is one, the gyro."""

    angular_velocity: Annotated[Part | None, _Columns(quantity='angular velocity', width=3)] = None


@dataclass(frozen=True, kw_only=True)
class Pose(Signal):
    """An orientation in one of its forms and, where it is known, a position."""

    position: Annotated[Part | None, _Columns(quantity='length', width=3)] = None
    R_base_sensor: Annotated[Part | None, _Columns(quantity='number', width=9)] = None
    R_sensor_base: Annotated[Part | None, _Columns(quantity='number', width=9)] = None
    quaternion_xyzw: Annotated[Part | None, _Columns(quantity='number', width=4)] = None
    rpy: Annotated[Part | None, _Columns(quantity='angle', width=3)] = None
    euler_xyz: Annotated[Part | None, _Columns(quantity='angle', width=3)] = None
    rotation_vector: Annotated[Part | None, _Columns(quantity='angle', width=3)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        found = [name for name in ORIENTATIONS if name in self.parts]
        if len(found) != 1:
            raise self.wrong('', f'one of {", ".join(ORIENTATIONS)}', found)


@dataclass(frozen=True, kw_only=True)
class Displacement(Signal):
    """Of the compliant tool."""

    displacement: Annotated[Part, _Columns(quantity='length', width=1)]


@dataclass(frozen=True, kw_only=True)
class Joints(Signal):
    """Positions of joints, of which a URDF makes poses."""

    frame: Annotated[str, Row('Not used')] = ''
    names: Annotated[tuple[str, ...], Row('Joints, in the order of the columns')]
    position: Annotated[Part, _Columns(quantity='angle')]

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.names)) != len(self.position.columns):
            raise self.wrong(
                'names', f'{len(self.position.columns)} different names, one per column')


@dataclass(frozen=True)
class Signals:
    """The signals of a table, by role."""

    wrench: Wrench | None = None
    contact_truth: Wrench | None = None
    accelerometer: Voltage | None = None
    accel: Acceleration | None = None
    imu: Imu | None = None
    pose: Pose | None = None
    target: Pose | None = None
    optidrive: Displacement | None = None
    joint_states: Joints | None = None

    @property
    def given(self) -> Mapping[str, Signal]:
        """Those that there are."""
        return {role: signal for role, signal in vars(self).items() if signal is not None}


@dataclass(frozen=True)
class Time(Section):
    """The column of time, and of nanoseconds on top of it, as ROS writes stamps."""

    column: Annotated[str, Row(pattern=TEXT)]
    unit: Annotated[str, Row(words=(*NANOSECONDS, DATE))]
    nanoseconds: Annotated[str | None, Row('Column of nanoseconds to add', pattern=TEXT)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unit == DATE and self.nanoseconds is not None:
            raise self.wrong('nanoseconds', 'no value: a date has fractions of a second itself')
        if self.unit != DATE and (other := contradiction((self.column,), self.unit, NANOSECONDS)):
            raise self.wrong('unit', other)


@dataclass(frozen=True)
class Phases(Section):
    """The word of each row: in a column, of rows and between them, or of all."""

    column: Annotated[str | None, Row(pattern=TEXT)] = None
    each_row: Annotated[str | None, Row(words=PHASES)] = None
    between: Annotated[str | None, Row(words=PHASES)] = None
    whole: Annotated[str | None, Row(words=PHASES)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        given = {name for name, word in vars(self).items() if word is not None}
        if given not in ({'column'}, {'each_row', 'between'}, {'whole'}):
            raise self.wrong('', 'column, or each_row and between, or whole', sorted(given))
        if self.between is not None and self.between == self.each_row:
            raise self.wrong('between', 'a phase other than each_row')


@dataclass(frozen=True)
class Long(Section):
    """The columns of a table with one row a signal: its name and its value."""

    name: Annotated[str, Row(pattern=TEXT)]
    value: Annotated[str, Row(pattern=TEXT)]


@dataclass(frozen=True, kw_only=True)
class Written(Section):
    """How a table is written; without a header its columns are called 0, 1, 2 ..."""

    delimiter: Annotated[str, Row('', pattern='[^"\r\n]', wording='one character')] = ','
    decimal: Annotated[str, Row('Decimal separator', words=('.', ','))] = '.'
    comment: Annotated[str, Row('Starts a comment', pattern='.?',
                                wording='one character')] = ''
    header: Annotated[int, Row('Line with the names of the columns; 0: none', low=0)] = 1
    skip: Annotated[int, Row('Lines to skip after the header, such as a line of units', low=0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.decimal == self.delimiter:
            raise self.wrong('delimiter', 'a character other than decimal')


@dataclass(frozen=True, kw_only=True)
class _File(Section):
    """The file of one table, which messages name it by."""

    file: Annotated[str, Row('Path', pattern=TEXT)]


@dataclass(frozen=True, kw_only=True)
class TableSpecification(Written, _File):
    """One table, with a column of time or a rate."""

    time: Time | None = None
    rate: Annotated[float | None, Row('Rows per second', 'Hz', above=0.0)] = None
    start: Annotated[float | None, Row('Time of the first row of a table without time', 's')
                     ] = None
    long: Long | None = None
    phases: Phases | None = None
    signals: Signals

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.time is None) == (self.rate is None):
            raise self.wrong('time', 'either time (column and unit) or rate (rows per second, for '
                                     'a table without time)')
        if self.time is not None and self.start is not None:
            raise self.wrong('start', 'no value: start is for tables without time')
        if self.long is not None and (self.time is None or self.time.nanoseconds is not None):
            raise self.wrong('long', 'a time in one column')


@dataclass(frozen=True)
class _Document:
    """The file."""

    tables: tuple[TableSpecification, ...]


class Specification(NamedTuple):
    """All tables of one recording, and the file that describes them."""

    tables: tuple[TableSpecification, ...]
    path: Path


def load_specification(path: Path | str, folder: Path | str | None = None) -> Specification:
    """
    Read and check an import specification, a YAML file as ``config/examples/kuka_*.yaml``.

    The paths of the tables count from ``folder``, by default the file's own.

    Raises
    ------
    ConfigError
        The file cannot be read, or contradicts itself; the key is named.
    """
    path = Path(path)
    document = load(_Document, path, form=FORMAT, remedy='compare with config/examples')
    place = path.parent if folder is None else Path(folder)
    return Specification(
        tuple(replace(table, file=str(place / table.file)) for table in document.tables), path)
