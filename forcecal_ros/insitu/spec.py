"""SPEC.yaml of ``forcecal insitu``: data sets, sensors and the accelerometer, checked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array, STANDARD_GRAVITY
from forcecal_ros.insitu.matrix import Load
from forcecal_ros.insitu.prepare import Mounting
from forcecal_ros.insitu.reduce import Options
from forcecal_ros.insitu.smoothing import PAPER_ORDER, PAPER_WINDOW
from forcecal_ros.recording.csv_import.units import in_si, NANOSECONDS
from forcecal_ros.safe_yaml import LARGEST, load_yaml
import numpy as np

FORMAT = 'forcecal-insitu/1'

_TOP = ('format', 'gravity', 'estimate', 'filter', 'motion', 'screening', 'time', 'rate',
        'delimiter', 'accelerometer', 'sensors', 'data_sets')
_ACCELEROMETER = ('columns', 'topic', 'fields', 'unit', 'measures', 'noise', 'offset', 'gyro')
_GYRO = ('columns', 'topic', 'fields', 'unit')
_SENSOR = ('columns', 'topic', 'fields', 'unit', 'frame', 'manufacturer_matrix',
           'R_sensor_accelerometer', 'accelerometer_position')
_DATA_SET = ('file', 'name', 'use', 'added_mass', 'position', 'window')
_MEASURES = {'specific_force': 1.0, 'gravity': -1.0}
_WORDS = {False: 'off', True: 'on'}

Column = str | int


@dataclass(frozen=True)
class Channels:
    """
    Where a device's numbers are: columns of tables, a topic and its fields in recordings.

    Attributes
    ----------
    columns : tuple of str or int
        Names, or numbers from 0 for tables without header.
    topic : str or None
    fields : tuple of str
        Empty: what the topic's type has.
    scale : float
        Makes SI of them.
    """

    columns: tuple[Column, ...]
    topic: str | None
    fields: tuple[str, ...]
    scale: float = 1.0


@dataclass(frozen=True)
class Sensor:
    """
    One force/torque sensor.

    Attributes
    ----------
    name : str
    channels : Channels
        Six or more, in any unit.
    unit : str
        Of the raw channels, for tables.
    frame : str
        frame_id of the calibrated wrench.
    mounting : Mounting
        Of the accelerometer; identity where its frame serves as the sensor's.
    manufacturer_matrix : ndarray or None, shape (6, n)
    """

    name: str
    channels: Channels
    unit: str
    frame: str
    mounting: Mounting
    manufacturer_matrix: Array | None


@dataclass(frozen=True)
class Recorded:
    """
    One data set.

    Attributes
    ----------
    name : str
    path : Path
    train : bool
    added_mass : float or None
        [kg]; None where it is not stated.
    position : tuple or mapping of str to tuple
        Of the added mass: in the accelerometer's frame, or by sensor in the sensor's [m].
    window : (float, float) or None
        To use [s].
    """

    name: str
    path: Path
    train: bool
    added_mass: float | None
    position: tuple[float, ...] | Mapping[str, tuple[float, ...]]
    window: tuple[float, float] | None

    def load(self, sensor: Sensor) -> Load | None:
        """Return the added mass and its position in a sensor's frame."""
        if self.added_mass is None:
            return None
        if isinstance(self.position, Mapping):
            at = np.array(self.position.get(sensor.name, (0.0, 0.0, 0.0)))
        else:
            mounting = sensor.mounting
            at = mounting.R_sensor_accelerometer @ np.array(self.position) + mounting.position
        x, y, z = (float(value) for value in at)
        return Load(self.added_mass, (x, y, z) if self.added_mass else (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Spec:
    """
    Everything a SPEC says.

    Attributes
    ----------
    path : Path
    options : Options
        Its ``raw_unit`` is the sensor's.
    accelerometer, gyro : Channels
        The scale turns what is measured into specific force; gyro None without motion.
    time : (str or int, float) or None
        Column and its unit [s]; None for tables with a rate.
    rate : float
        Rows a second of tables without time [Hz].
    delimiter : str
    sensors : tuple of Sensor
    data_sets : tuple of Recorded
    """

    path: Path
    options: Options
    accelerometer: Channels
    gyro: Channels | None
    time: tuple[Column, float] | None
    rate: float
    delimiter: str
    sensors: tuple[Sensor, ...]
    data_sets: tuple[Recorded, ...]


def load_spec(path: Path | str) -> Spec:
    """
    Read and check a SPEC.

    Parameters
    ----------
    path : Path or str
        YAML; see ``config/examples/insitu_*.yaml``.

    Returns
    -------
    Spec

    Raises
    ------
    ConfigError
        It cannot be read, or says what makes no sense; the key is named.
    """
    path = Path(path)
    try:
        with path.open('rb') as file:
            document = load_yaml(file.read(LARGEST + 1), str(path))
    except OSError as error:
        raise ConfigError(f'{path}: cannot be read ({error.strerror})') from error
    return _Reader(path).spec(document)


class _Reader:
    """Checks and converts one document; every complaint names the file and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def wrong(self, where: str, what: str) -> ConfigError:
        return ConfigError(f'{self.path}: {where}: {what}')

    def mapping(self, value: Any, where: str, keys: Sequence[str]) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise self.wrong(where, f'expected keys such as {", ".join(keys)}')
        if unknown := [str(key)[:40] for key in value if key not in keys]:
            raise self.wrong(where, f'unknown {", ".join(unknown)}; the keys are '
                                    f'{", ".join(keys)}')
        return value

    def number(self, value: Any, where: str) -> float:
        if type(value) not in (int, float) or not -1e9 < value < 1e9:
            raise self.wrong(where, f'expected a number, not {str(value)[:40]!r}')
        return float(value)

    def positive(self, value: Any, where: str) -> float:
        number = self.number(value, where)
        if not number > 0:
            raise self.wrong(where, f'expected a number above 0, not {number:g}')
        return number

    def numbers(self, value: Any, where: str, count: int) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != count:
            raise self.wrong(where, f'expected a list of {count} numbers')
        return tuple(self.number(one, where) for one in value)

    def word(self, value: Any, where: str, words: Sequence[str]) -> str:
        word = _WORDS.get(value, value) if isinstance(value, bool) else value
        if word not in words:
            raise self.wrong(where, f'expected {" or ".join(words)}, not {str(word)[:40]!r}')
        return str(word)

    def spec(self, document: Any) -> Spec:
        top = self.mapping(document, 'the file', _TOP)
        if top.get('format') != FORMAT:
            raise self.wrong('format', f'must be {FORMAT}')
        moving = self.word(top.get('motion', False), 'motion', ('on', 'off')) == 'on'
        if ('time' in top) and ('rate' in top):
            raise self.wrong('time', 'expected either time or rate, not both')
        sensors = self.sensors(top.get('sensors'))
        data_sets = self.data_sets(top.get('data_sets'), [s.name for s in sensors])
        accelerometer, gyro, noise, level = self.accelerometer(top.get('accelerometer'), moving)
        delimiter = top.get('delimiter', ',')
        if not isinstance(delimiter, str) or len(delimiter) != 1:
            raise self.wrong('delimiter', 'expected one character')
        window, order = self.filter(top.get('filter', {}))
        wanted = 'matrix' if any(d.added_mass is not None for d in data_sets) else 'offset'
        options = Options(
            gravity=self.positive(top.get('gravity', STANDARD_GRAVITY), 'gravity'),
            filter_window=window, filter_order=order, moving=moving,
            screening=self.word(top.get('screening', True), 'screening', ('on', 'off')) == 'on',
            matrix=self.word(top.get('estimate', wanted), 'estimate',
                             ('matrix', 'offset')) == 'matrix',
            level_accelerometer=level, accelerometer_noise=noise)
        return Spec(self.path, options, accelerometer, gyro, self.time(top.get('time')),
                    self.positive(top.get('rate', 100.0), 'rate'), delimiter, sensors, data_sets)

    def time(self, value: Any) -> tuple[Column, float] | None:
        if value is None:
            return None
        time = self.mapping(value, 'time', ('column', 'unit'))
        unit = self.word(time.get('unit', 's'), 'time unit', tuple(NANOSECONDS))
        return self.column(time.get('column'), 'time column'), NANOSECONDS[unit] / 1e9

    def filter(self, value: Any) -> tuple[float, int]:
        if value is False or value == 'off':
            return 0.0, PAPER_ORDER
        settings = self.mapping({} if value is True else value, 'filter', ('window', 'order'))
        order = settings.get('order', PAPER_ORDER)
        if type(order) is not int or not 0 <= order <= 9:
            raise self.wrong('filter order', 'expected a whole number from 0 to 9')
        return self.positive(settings.get('window', PAPER_WINDOW), 'filter window'), order

    def accelerometer(self, value: Any, moving: bool
                      ) -> tuple[Channels, Channels | None, float | None, bool]:
        given = self.mapping(value, 'accelerometer', _ACCELEROMETER)
        sign = _MEASURES[self.word(given.get('measures', 'specific_force'),
                                   'accelerometer measures', tuple(_MEASURES))]
        unit = in_si('acceleration', str(given.get('unit', 'm/s^2')),
                     f'{self.path}: accelerometer unit')
        noise = given.get('noise')
        gyro = None
        if moving:
            turn = self.mapping(given.get('gyro', {}), 'accelerometer gyro', _GYRO)
            size = in_si('angular velocity', str(turn.get('unit', 'rad/s')),
                         f'{self.path}: accelerometer gyro unit')
            gyro = self.channels({'topic': given.get('topic'), **turn}, 'accelerometer gyro', 3,
                                 size)
            if gyro.topic == given.get('topic') and bool(gyro.fields) != bool(given.get('fields')):
                raise self.wrong('accelerometer gyro', 'name the fields of both accelerometer and '
                                                       'gyro, or of neither')
        return (self.channels(given, 'accelerometer', 3, sign * unit), gyro,
                None if noise is None else self.positive(noise, 'accelerometer noise'),
                self.word(given.get('offset', 'estimate'), 'accelerometer offset',
                          ('estimate', 'ignore')) == 'estimate')

    def channels(self, given: Mapping[str, Any], where: str, least: int,
                 scale: float = 1.0) -> Channels:
        columns, topic = given.get('columns', []), given.get('topic')
        fields = given.get('fields', [])
        if not columns and topic is None:
            raise self.wrong(where, 'expected columns (of tables) or a topic (of recordings)')
        for key, names in (('columns', columns), ('fields', fields)):
            if not isinstance(names, list) or (names and len(names) < least):
                raise self.wrong(f'{where} {key}', f'expected a list of {least}'
                                 f'{" or more" if least == 6 else ""}')
            if least == 3 and len(names) > 3:
                raise self.wrong(f'{where} {key}', 'expected a list of 3')
        if topic is not None and not isinstance(topic, str):
            raise self.wrong(f'{where} topic', 'expected a name')
        return Channels(tuple(self.column(name, f'{where} columns') for name in columns), topic,
                        tuple(str(field) for field in fields), scale)

    def column(self, value: Any, where: str) -> Column:
        if (type(value) is int and value >= 0) or (isinstance(value, str) and value):
            return value
        raise self.wrong(where, 'expected names, or numbers from 0 for tables without header')

    def sensors(self, value: Any) -> tuple[Sensor, ...]:
        if not isinstance(value, dict) or not value:
            raise self.wrong('sensors', 'expected one or more sensors by name')
        return tuple(self.sensor(str(name), one) for name, one in value.items())

    def sensor(self, name: str, value: Any) -> Sensor:
        where = f'sensors {name}'
        if not name.replace('_', '').replace('-', '').isalnum():
            raise self.wrong(where, 'names have letters, digits, - and _ only: files get them')
        given = self.mapping(value, where, _SENSOR)
        matrix = given.get('manufacturer_matrix')
        if matrix is not None:
            if not isinstance(matrix, list) or len(matrix) != 6 or not isinstance(matrix[0], list):
                raise self.wrong(f'{where} manufacturer_matrix', 'expected six rows')
            matrix = np.array([self.numbers(row, f'{where} manufacturer_matrix', len(matrix[0]))
                               for row in matrix])
        return Sensor(name, self.channels(given, where, 6), str(given.get('unit', 'raw')),
                      str(given.get('frame', 'ft_sensor')),
                      self.mounting(given, where), matrix)

    def mounting(self, given: Mapping[str, Any], where: str) -> Mounting:
        R = np.eye(3)
        if 'R_sensor_accelerometer' in given:
            rows = given['R_sensor_accelerometer']
            if not isinstance(rows, list) or len(rows) != 3:
                raise self.wrong(f'{where} R_sensor_accelerometer', 'expected three rows')
            R = np.array([self.numbers(row, f'{where} R_sensor_accelerometer', 3) for row in rows])
            if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
                raise self.wrong(f'{where} R_sensor_accelerometer', 'is no rotation')
        return Mounting(R, np.array(self.numbers(
            given.get('accelerometer_position', [0, 0, 0]), f'{where} accelerometer_position', 3)))

    def data_sets(self, value: Any, sensors: Sequence[str]) -> tuple[Recorded, ...]:
        if not isinstance(value, list) or not value:
            raise self.wrong('data_sets', 'expected a list, each with file')
        found = tuple(self.data_set(one, n, sensors) for n, one in enumerate(value, 1))
        names = [one.name for one in found]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise self.wrong('data_sets', f'{", ".join(twice)} is there twice; give names')
        return found

    def data_set(self, value: Any, number: int, sensors: Sequence[str]) -> Recorded:
        given = self.mapping(value, f'data set {number}', _DATA_SET)
        file = given.get('file')
        if not isinstance(file, str) or not file:
            raise self.wrong(f'data set {number}', 'file is missing')
        name = str(given.get('name', Path(file).stem))
        where = f'data set {name}'
        mass = given.get('added_mass')
        mass = None if mass is None else self.number(mass, f'{where} added_mass')
        if mass is not None and mass < 0:
            raise self.wrong(f'{where} added_mass', 'expected 0 (none) or more')
        if mass and 'position' not in given:
            raise self.wrong(where, 'position of the added mass is missing')
        window = given.get('window')
        if window is not None:
            start, end = self.numbers(window, f'{where} window', 2)
            if not start < end:
                raise self.wrong(f'{where} window', 'expected start before end')
            window = (start, end)
        return Recorded(
            name, self.path.parent / file,
            self.word(given.get('use', 'train'), f'{where} use', ('train', 'validate')) == 'train',
            mass, self.position(given.get('position', [0, 0, 0]), where, sensors), window)

    def position(self, value: Any, where: str, sensors: Sequence[str]
                 ) -> tuple[float, ...] | Mapping[str, tuple[float, ...]]:
        if not isinstance(value, dict):
            return self.numbers(value, f'{where} position', 3)
        by_sensor = self.mapping(value, f'{where} position', sensors)
        if missing := [name for name in sensors if name not in by_sensor]:
            raise self.wrong(f'{where} position', f'{", ".join(missing)} is missing')
        return {name: self.numbers(at, f'{where} position {name}', 3)
                for name, at in by_sensor.items()}
