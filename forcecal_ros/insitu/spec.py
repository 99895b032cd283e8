"""SPEC.yaml of ``forcecal insitu``: data sets, sensors and the accelerometer, checked."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_origin

from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
from forcecal_ros.core.schema import (
    load,
    Matrix3,
    Mismatch,
    path,
    read,
    Row,
    Section,
    TEXT,
    Vector3,
)
from forcecal_ros.insitu.blocks import Mounting
from forcecal_ros.insitu.equations import Load
from forcecal_ros.insitu.moments import PAPER_ORDER, PAPER_WINDOW
from forcecal_ros.insitu.reduce import Options
from forcecal_ros.io.csv_import.specification import (
    Column,
    contradiction,
    NANOSECONDS,
    UNITS,
    Written,
)
import numpy as np

FORMAT = 'forcecal-insitu/1'
DEFAULT_RATE = 100.0
"""Rows a second of a table that has neither a column of time nor a rate [Hz]."""

_MEASURES = {'specific_force': 1.0, 'gravity': -1.0}


class _Columns(Row):
    """Row of one column, or of a list of them: names, or numbers from 0."""

    def take(self, kind: Any, value: Any, where: str) -> Any:
        """Check columns of a table."""
        if get_origin(kind) is tuple:
            if not isinstance(value, list | tuple):
                raise Mismatch(where, value, 'a list of columns')
            return tuple(self.take(Column, one, where) for one in value)
        if (isinstance(value, str) and value) or (type(value) is int and value >= 0):
            return value
        raise Mismatch(where, value, 'a name, or a number from 0 for tables without header')


class _Filter(Row):
    """Row of the filter, which may be ``off``."""

    def take(self, kind: Any, value: Any, where: str) -> 'Filter':
        """Check a filter."""
        if isinstance(value, Filter):
            return value
        if value is True or value is False or value == 'off':
            return Filter(PAPER_WINDOW if value is True else 0.0)
        return read(Filter, value, where)


class _Position(Row):
    """Row of a position: one, or one by sensor."""

    def take(self, kind: Any, value: Any, where: str) -> Any:
        """Check a position."""
        if not isinstance(value, Mapping):
            return super().take(Vector3, value, where)
        return {str(sensor): super(_Position, self).take(Vector3, one, path(where, str(sensor)))
                for sensor, one in value.items()}


@dataclass(frozen=True)
class Channels(Section):
    """Where a device's numbers are: columns of tables, a topic and its fields in recordings."""

    columns: Annotated[tuple[Column, ...], _Columns('In tables')] = ()
    topic: Annotated[str | None, Row('In recordings', pattern=TEXT)] = None
    fields: Annotated[tuple[str, ...], Row("Empty: the default of the topic's type")] = ()

    counts: ClassVar[tuple[int, float, str]] = (3, 3, 'a list of 3')
    quantity: ClassVar[str] = ''

    def __post_init__(self) -> None:
        super().__post_init__()
        least, most, expected = self.counts
        for name in ('columns', 'fields'):
            if getattr(self, name) and not least <= len(getattr(self, name)) <= most:
                raise self.wrong(name, expected)
        unit, names = getattr(self, 'unit', ''), [str(name) for name in self.columns]
        if self.quantity and (other := contradiction(names, unit, UNITS[self.quantity])):
            raise self.wrong('unit', other)

    @property
    def named(self) -> bool:
        """Whether there are columns or a topic."""
        return bool(self.columns) or self.topic is not None


@dataclass(frozen=True)
class Gyro(Channels):
    """The gyro; on the accelerometer's topic where it has none of its own."""

    unit: Annotated[str, Row(words=tuple(UNITS['angular velocity']))] = 'rad/s'

    quantity = 'angular velocity'

    @property
    def scale(self) -> float:
        """Makes SI of the numbers."""
        return UNITS['angular velocity'][self.unit]


@dataclass(frozen=True)
class Accelerometer(Channels):
    """The accelerometer, and what is known of it."""

    unit: Annotated[str, Row(words=tuple(UNITS['acceleration']))] = 'm/s^2'
    measures: Annotated[str, Row(words=tuple(_MEASURES))] = 'specific_force'
    offset: Annotated[str, Row(
        'Whether an offset that |g| shows is removed', words=('estimate', 'ignore'))] = 'estimate'
    gyro: Gyro = Gyro()

    quantity = 'acceleration'

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gyro.topic is None:
            object.__setattr__(self, 'gyro', replace(self.gyro, topic=self.topic))

    @property
    def scale(self) -> float:
        """Makes specific force in SI of the numbers."""
        return _MEASURES[self.measures] * UNITS['acceleration'][self.unit]


@dataclass(frozen=True)
class Sensor(Channels):
    """One force/torque sensor."""

    unit: Annotated[str, Row('Of the raw channels', pattern=TEXT)] = 'raw'
    frame: Annotated[str, Row('frame_id of the calibrated wrench', pattern=TEXT)] = 'ft_sensor'
    manufacturer_matrix: Annotated[Array | None, Row('For comparison', shape=(6, None))] = None
    R_sensor_accelerometer: Annotated[Matrix3, Row(
        "Default: the accelerometer's frame is the sensor's frame", '1')] = (
            (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    accelerometer_position: Annotated[Vector3, Row("In the sensor's frame", 'm')] = (0.0, 0.0, 0.0)

    counts = (6, np.inf, 'a list of 6 or more')

    def __post_init__(self) -> None:
        super().__post_init__()
        R = np.array(self.R_sensor_accelerometer)
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
            raise self.wrong('R_sensor_accelerometer', 'a rotation matrix')

    @property
    def mounting(self) -> Mounting:
        """Of the accelerometer."""
        return Mounting(np.array(self.R_sensor_accelerometer),
                        np.array(self.accelerometer_position))


@dataclass(frozen=True)
class Recorded(Section):
    """One data set; its added mass, if stated, is in place during all of it."""

    file: Annotated[str, Row('Path, relative to the folder of the SPEC', pattern=TEXT)]
    name: Annotated[str, Row('Empty: the name of the file')] = ''
    use: Annotated[str, Row(words=('train', 'validate'))] = 'train'
    added_mass: Annotated[float | None, Row('None: not stated', 'kg', 0.0)] = None
    position: Annotated[Vector3 | Mapping[str, Vector3] | None, _Position(
        "Of the added mass: in the accelerometer's frame, or by sensor in the sensor's", 'm')
        ] = None
    window: Annotated[tuple[float, float] | None, Row('Time interval to use', 's')] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, 'name', self.name or Path(self.file).stem)
        if self.added_mass and self.position is None:
            raise self.wrong('position', 'the position of the added mass')
        # more is not screwed on by hand, and no place on what a sensor carries
        most_kg, most_m = 100.0, 2.0
        if self.added_mass and self.added_mass > most_kg:
            raise self.wrong('added_mass', f'at most {most_kg:g} kg (is it in g?)')
        places = self.position.values() if isinstance(self.position, Mapping) else [
            self.position or (0.0, 0.0, 0.0)]
        if any(max(map(abs, place)) > most_m for place in places):
            raise self.wrong('position', f'at most {most_m:g} m (is it in mm or cm?)')
        if self.window is not None and not self.window[0] < self.window[1]:
            raise self.wrong('window', 'a start before the end')

    @property
    def train(self) -> bool:
        """Whether it is for training, not for validation."""
        return self.use == 'train'

    def load(self, name: str, sensor: Sensor) -> Load | None:
        """Return the added mass and its position in a sensor's frame."""
        if self.added_mass is None:
            return None
        if not self.added_mass:
            return Load(0.0)
        if isinstance(self.position, Mapping):
            return Load(self.added_mass, self.position[name])
        mounting = sensor.mounting
        x, y, z = mounting.R_sensor_accelerometer @ np.array(self.position) + mounting.position
        return Load(self.added_mass, (float(x), float(y), float(z)))


@dataclass(frozen=True)
class Filter(Section):
    """Savitzky-Golay filter; a window of 0: none."""

    window: Annotated[float, Row('Of the filter', 's', 0.0)] = PAPER_WINDOW
    order: Annotated[int, Row('Of its polynomial', low=0, high=9)] = PAPER_ORDER


@dataclass(frozen=True)
class Time(Section):
    """The column of time in tables."""

    column: Annotated[Column, _Columns()]
    unit: Annotated[str, Row(words=tuple(NANOSECONDS))] = 's'

    def __post_init__(self) -> None:
        super().__post_init__()
        if other := contradiction((str(self.column),), self.unit, NANOSECONDS):
            raise self.wrong('unit', other)

    @property
    def scale(self) -> float:
        """Makes seconds of the numbers."""
        return NANOSECONDS[self.unit] / 1e9


@dataclass(frozen=True, kw_only=True)
class Spec(Written, name=''):
    """The content of a SPEC."""

    gravity: Annotated[float, Row('Magnitude at the site', 'm/s^2', above=0.0)] = STANDARD_GRAVITY
    estimate: Annotated[str | None, Row(
        'None: the matrix if added masses are stated', words=('matrix', 'offset'))] = None
    filter: Annotated[Filter, _Filter()] = Filter()
    motion: Annotated[bool, Row('Whether the body moves fast; requires the gyro')] = False
    screening: Annotated[bool, Row(
        'Whether intervals that do not fit a free-hanging rigid body are removed')] = True
    rows: Annotated[str, Row(
        'In tables: samples, or the mean of one static pose each', words=('samples', 'poses'))
        ] = 'samples'
    body: Annotated[str, Row(
        'Load in addition to the added masses', words=('unknown', 'none'))] = 'unknown'
    mass_error: Annotated[float, Row('Relative error of added masses', low=0.0)] = 0.001
    position_error: Annotated[float, Row('Standard error of positions', 'm', low=0.0)] = 0.001
    time: Time | None = None
    rate: Annotated[float | None, Row('Rows per second in tables without time', 'Hz', above=0.0)
                    ] = None
    accelerometer: Accelerometer
    sensors: Mapping[str, Sensor]
    data_sets: tuple[Recorded, ...]
    path: Path = field(init=False, default=Path())

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.time is not None and self.rate is not None:
            raise self.wrong('rate', 'either time or rate, not both')
        if not self.sensors:
            raise Mismatch('sensors', dict(self.sensors), 'one or more sensors by name')
        for where, channels in self._channels():
            if not channels.named:
                raise Mismatch(where, None, 'columns (of tables) or a topic (of recordings)')
        for name in self.sensors:
            if not name.replace('_', '').replace('-', '').isalnum():
                raise Mismatch('sensors', name, 'names of letters, digits, - and _, as in file '
                                                'names')
        if self.motion and self.rows == 'poses':
            raise Mismatch('motion', True, 'off, because rows is poses')
        if self.motion and self.body == 'none':
            raise Mismatch('motion', True, 'off, because body is none')
        self._check_gyro()
        self._check_data_sets()

    def _channels(self) -> Iterator[tuple[str, Channels]]:
        yield 'accelerometer', self.accelerometer
        yield from ((f'sensors.{name}', sensor) for name, sensor in self.sensors.items())
        if self.gyro is not None:
            yield 'accelerometer.gyro', self.gyro

    def _check_gyro(self) -> None:
        one, gyro = self.accelerometer, self.gyro
        if gyro and gyro.topic == one.topic and bool(gyro.fields) != bool(one.fields):
            raise Mismatch('accelerometer.gyro.fields', gyro.fields, 'the fields of both '
                           'accelerometer and gyro, or of neither')

    def _check_data_sets(self) -> None:
        names = [one.name for one in self.data_sets]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise Mismatch('data_sets', twice, 'unique names; set name')
        for one in self.data_sets:
            if one.window is not None and self.rows == 'poses':
                raise Mismatch(f'data_sets[{one.name}].window', one.window,
                               'no window, because rows is poses')
            if self.body == 'none' and one.train and one.added_mass is None:
                raise Mismatch(f'data_sets[{one.name}].added_mass', None,
                               'the added mass, because body is none')
            if isinstance(one.position, Mapping) and set(one.position) != set(self.sensors):
                raise Mismatch(f'data_sets[{one.name}].position', list(one.position),
                               f'one for each sensor: {", ".join(self.sensors)}')

    @property
    def gyro(self) -> Gyro | None:
        """The gyro, where it is used."""
        return self.accelerometer.gyro if self.motion else None

    @property
    def options(self) -> Options:
        """How to calibrate; the unit of the raw channels is the sensor's."""
        stated = any(one.added_mass is not None for one in self.data_sets)
        return Options(
            gravity=self.gravity, filter_window=self.filter.window,
            filter_order=self.filter.order, moving=self.motion, screening=self.screening,
            poses=self.rows == 'poses', body=self.body == 'unknown',
            matrix=(self.estimate or ('matrix' if stated else 'offset')) == 'matrix',
            level_accelerometer=self.accelerometer.offset == 'estimate',
            mass_error=self.mass_error, place_error=self.position_error)


def load_spec(path: Path | str) -> Spec:
    """
    Read and check a SPEC, a YAML file as ``config/examples/insitu_*.yaml``.

    Raises
    ------
    ConfigError
        It cannot be read, or contradicts itself; the key is named.
    """
    path = Path(path)
    spec = load(Spec, path, form=FORMAT, remedy='compare with config/examples')
    spec = replace(spec, data_sets=tuple(
        replace(one, file=str(path.parent / one.file)) for one in spec.data_sets))
    object.__setattr__(spec, 'path', path)
    return spec
