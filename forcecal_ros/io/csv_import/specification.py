"""What the columns of tables mean: a YAML file that names signals, units and frames."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from forcecal_ros.core.schema import columns, load, Mismatch, path, read, Row, Section, TEXT
from forcecal_ros.core.streams import PHASES
from forcecal_ros.io.csv_import.table import (
    contradiction,
    DATE,
    Dialect,
    is_xyzw,
    NANOSECONDS,
    UNITS,
)

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
        for key, right, wanted in (
                ('columns', len(entry.columns) == width > 0, f'a list of {width} columns'),
                ('unit', entry.unit in units, f'a unit of {self.quantity}: {", ".join(units)}'),
                ('signs', not entry.signs or (len(entry.signs) == width
                 and set(entry.signs) <= {1, -1}), f'{width} times 1 or -1')):
            if not right:
                raise Mismatch(where if plain else path(where, key), getattr(entry, key), wanted)
        if said := contradiction(entry.columns, entry.unit, units):
            raise Mismatch(path(where, 'unit'), entry.unit, said)
        if self.width == 4 and not is_xyzw(entry.columns):
            raise Mismatch(where, entry.columns, 'the columns of x, y, z and w in this order')
        return Part(entry.columns, tuple(units[entry.unit] * sign for sign in
                                         entry.signs or (1,) * width), entry.unit)


_FORCE, _TORQUE = _Columns(quantity='force', width=3), _Columns(quantity='torque', width=3)
_ACCELERATION = _Columns(quantity='acceleration', width=3)
_TURN = _Columns(quantity='angular velocity', width=3)
_LENGTHS = _Columns(quantity='length', width=3)
_MATRIX = _Columns(quantity='number', width=9)


@dataclass(frozen=True, kw_only=True)
class Signal(Section):
    """One signal of a table: its parts, the frame and, if not the usual, the topic."""

    frame: Annotated[str, Row('frame_id', pattern=TEXT)]
    topic: Annotated[str | None, Row('None: the usual', pattern=TEXT)] = None

    @property
    def parts(self) -> Mapping[str, Part]:
        """The parts that it has, by name."""
        found = {column.name: getattr(self, column.name) for column in columns(type(self))}
        return {name: part for name, part in found.items() if isinstance(part, Part)}


@dataclass(frozen=True, kw_only=True)
class Wrench(Signal):
    """Force and torque."""

    force: Annotated[Part, _FORCE]
    torque: Annotated[Part, _TORQUE]


@dataclass(frozen=True, kw_only=True)
class Voltage(Signal):
    """Readings of an accelerometer that is not scaled."""

    voltage: Annotated[Part, _Columns(quantity='voltage', width=3)]


@dataclass(frozen=True, kw_only=True)
class Acceleration(Signal):
    """Specific force."""

    acceleration: Annotated[Part, _ACCELERATION]


@dataclass(frozen=True, kw_only=True)
class Imu(Acceleration):
    """Specific force and, where there is one, the gyro."""

    angular_velocity: Annotated[Part | None, _TURN] = None


@dataclass(frozen=True, kw_only=True)
class Pose(Signal):
    """An orientation in one of its forms and, where it is known, a position."""

    position: Annotated[Part | None, _LENGTHS] = None
    R_base_sensor: Annotated[Part | None, _MATRIX] = None
    R_sensor_base: Annotated[Part | None, _MATRIX] = None
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
                'names', f'{len(self.position.columns)} different names, one a column')


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
    nanoseconds: Annotated[str | None, Row('Column that comes on top', pattern=TEXT)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unit == DATE and self.nanoseconds is not None:
            raise self.wrong('nanoseconds', 'none: a date has its own fractions of a second')
        if self.unit != DATE and (
                said := contradiction((self.column,), self.unit, NANOSECONDS)):
            raise self.wrong('unit', said)


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
            raise self.wrong('between', 'another word than each_row, to tell the rows apart')


@dataclass(frozen=True, kw_only=True)
class Written(Section):
    """How tables are written."""

    delimiter: Annotated[str, Row('', pattern='[^"\r\n]', wanted='one character')] = ','
    decimal: Annotated[str, Row('Of numbers', words=('.', ','))] = '.'
    comment: Annotated[str, Row('Lines that begin with it are left out')] = ''
    header: Annotated[int, Row('Line that names the columns; 0: none', low=0)] = 1
    skip: Annotated[int, Row('Lines between that and the numbers, as one of units', low=0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.decimal == self.delimiter:
            raise self.wrong('delimiter', 'another character than decimal')

    @property
    def dialect(self) -> Dialect:
        """How the table is written."""
        return Dialect(self.delimiter, self.decimal, self.comment, self.header, self.skip)


@dataclass(frozen=True, kw_only=True)
class _File(Section):
    """The file of one table, which messages name it by."""

    file: Annotated[str, Row('Path', pattern=TEXT)]


@dataclass(frozen=True, kw_only=True)
class TableSpecification(Written, _File):
    """One table, with a column of time or a rate."""

    time: Time | None = None
    rate: Annotated[float | None, Row('Rows a second', 'Hz', above=0.0)] = None
    start: Annotated[float | None, Row('Time of the first row of a table without time', 's')
                     ] = None
    phases: Phases | None = None
    signals: Signals

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.time is None) == (self.rate is None):
            raise self.wrong('time', 'either time (column and unit) or rate (rows a second, for a '
                                     'table without time)')
        if self.time is not None and self.start is not None:
            raise self.wrong('start', 'none: start is for tables without time')


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
        The file cannot be read, or says what makes no sense; the key is named.
    """
    path = Path(path)
    document = load(_Document, path, form=FORMAT, remedy='compare with config/examples')
    place = path.parent if folder is None else Path(folder)
    return Specification(
        tuple(replace(table, file=str(place / table.file)) for table in document.tables), path)
