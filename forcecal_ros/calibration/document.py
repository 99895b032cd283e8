"""A calibration as plain dicts, lists, numbers and words, and back, every key checked."""

from collections.abc import Mapping
from datetime import date, datetime
import math
from typing import Any

from forcecal_ros.calibration.model import (
    Accelerometer,
    Calibration,
    Estimate,
    FORMAT,
    Noise,
    NOT_IDENTIFIED,
    ObserverGain,
    Tool,
)
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array
import numpy as np

_Shape = tuple[int, ...]
_Schema = dict[str, tuple[_Shape, tuple[str, ...]]]

_TOP: _Schema = {
    'mass': ((), ('kg',)),
    'com': ((3,), ('m',)),
    'inertia': ((3, 3), ('kg m^2',)),
    'wrench_bias': ((6,), ('N, N m',)),
}
_ACCELEROMETER: _Schema = {
    'offset': ((3,), ('V', 'm/s^2')),
    'gain': ((3,), ('V/(m/s^2)', '1')),
    'map': ((3, 3), ('1',)),
    'delay': ((), ('s',)),
    'cutoff': ((), ('Hz',)),
    'position': ((3,), ('m',)),
}
_TOOL: _Schema = {'stiffness': ((), ('N/m',)), 'damping': ((), ('N s/m',))}
_NOISE: _Schema = {
    'Q': ((2, 2), ('(m, m/s)^2 s',)),
    'R': ((3, 3), ('(m, m/s, m/s^2)^2 s',)),
    'wrench': ((6, 6), ('(N, N m)^2',)),
    'specific_force': ((3, 3), ('(m/s^2)^2',)),
}
_OBSERVER: _Schema = {'K': ((2, 3), ('1',)), 'A': ((2, 2), ('1',)), 'C': ((3, 2), ('1',))}


def to_document(calibration: Calibration) -> dict[str, Any]:
    """
    Turn a calibration into plain dicts, lists, numbers and words, in the order of the file.

    Parameters
    ----------
    calibration : Calibration

    Returns
    -------
    dict
        What ``calibration.yaml`` holds and ``--json`` prints.
    """
    c = calibration
    document: dict[str, Any] = {
        'format': FORMAT,
        'mass': _entry(c.mass),
        'com': _entry(c.com),
        'inertia': _entry(c.inertia),
        'wrench_bias': _entry(c.wrench_bias),
        'gravity': c.gravity,
        'sensor': {'frame': c.sensor_frame, 'sign': c.wrench_sign},
        'accelerometer': NOT_IDENTIFIED,
        'tool': NOT_IDENTIFIED,
        'noise': NOT_IDENTIFIED,
        'observer': NOT_IDENTIFIED,
    }
    if c.accelerometer:
        a = c.accelerometer
        document['accelerometer'] = {
            'offset': _entry(a.offset), 'gain': _entry(a.gain), 'map': _entry(a.map),
            'coupling': a.coupling, 'delay': _entry(a.delay),
            **({'cutoff': _entry(a.cutoff)} if a.cutoff else {}),
            **({'position': _entry(a.position)} if a.position else {}),
        }
    if c.tool:
        document['tool'] = {
            'stiffness': _entry(c.tool.stiffness), 'damping': _entry(c.tool.damping)}
    if c.noise:
        document['noise'] = {
            'Q': _entry(c.noise.Q), 'R': _entry(c.noise.R), 'wrench': _entry(c.noise.wrench),
            'specific_force': _entry(c.noise.specific_force),
            'wrench_rate': c.noise.wrench_rate, 'accelerometer_rate': c.noise.accelerometer_rate,
        }
    if c.observer:
        document['observer'] = {
            'mode': c.observer.mode, 'dt': c.observer.dt, 'K': _entry(c.observer.K),
            'A': _entry(c.observer.A), 'C': _entry(c.observer.C),
            'kalman': {name: _entry(gain) for name, gain in c.observer.kalman.items()},
        }
    if c.matrix:
        document['matrix'] = {**_entry_of(c.matrix), 'offset': _entry(c.matrix_offset)}
    document['quality'] = plain(c.quality)
    document['source'] = plain(c.source)
    return document


def from_document(document: dict[str, Any], name: str) -> Calibration:
    """
    Turn what :func:`to_document` returns into a calibration again.

    Parameters
    ----------
    document : dict
    name : str
        Where it is from, for messages.

    Returns
    -------
    Calibration

    Raises
    ------
    ConfigError
        A key is missing, has the wrong shape or unit, or is not finite.
    """
    return _Reader(name).calibration(document)


def _entry_of(estimate: Estimate) -> dict[str, Any]:
    std = estimate.std
    return {'value': plain(estimate.value),
            'std': plain(std) if np.isfinite(std).all() else None,
            'unit': estimate.unit}


def _entry(estimate: Estimate | None) -> Any:
    return NOT_IDENTIFIED if estimate is None else _entry_of(estimate)


def plain(value: Any) -> Any:
    """Return numbers, words, lists and dicts only, which any YAML or JSON reader takes."""
    if isinstance(value, Estimate):
        return _entry_of(value)
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (date, datetime)):
        return value.isoformat()
    raise TypeError(f'cannot write a {type(value).__name__} into a calibration')


class _Reader:
    """Checks and converts one document; every complaint names the file and the key."""

    def __init__(self, name: str) -> None:
        self.name = name

    def calibration(self, document: dict[str, Any]) -> Calibration:
        sensor = self.section(document, 'sensor') or {}
        gravity = self.number(document, 'gravity', default=None)
        sign = sensor.get('sign', 1)
        if sign not in (1, -1):
            raise self.wrong('sensor.sign', sign, '1 or -1')
        matrix = self.section(document, 'matrix')
        calibration = Calibration(
            mass=self.required(document, 'mass', _TOP),
            com=self.required(document, 'com', _TOP),
            wrench_bias=self.required(document, 'wrench_bias', _TOP),
            inertia=self.estimate(document, 'inertia', _TOP),
            accelerometer=self.accelerometer(self.section(document, 'accelerometer')),
            tool=self.tool(self.section(document, 'tool')),
            noise=self.noise(self.section(document, 'noise')),
            observer=self.observer(self.section(document, 'observer')),
            matrix=self.read(matrix, 'matrix') if matrix else None,
            matrix_offset=self.read(matrix.get('offset'), 'matrix.offset') if matrix else None,
            sensor_frame=str(sensor.get('frame', 'ft_sensor')),
            wrench_sign=sign,
            quality=self.section(document, 'quality') or {},
            source=self.section(document, 'source') or {},
            **({} if gravity is None else {'gravity': gravity}),
        )
        self.check(calibration)
        return calibration

    def check(self, c: Calibration) -> None:
        if not float(c.mass) > 0:
            raise self.wrong('mass.value', float(c.mass), 'a positive mass [kg]')
        if c.accelerometer and np.linalg.matrix_rank(c.accelerometer.matrix) < 3:
            raise self.wrong('accelerometer.gain, accelerometer.map', 'a singular product',
                             'three independent axes of non-zero gain')
        if c.matrix is not None:
            shape = c.matrix.value.shape
            if len(shape) != 2 or shape[0] != 6 or c.matrix_offset is None \
                    or c.matrix_offset.value.shape != shape[1:]:
                raise self.wrong('matrix', f'shape {shape}', '6 x n with an offset of n numbers')

    def accelerometer(self, d: dict[str, Any] | None) -> Accelerometer | None:
        if d is None:
            return None
        coupling = d.get('coupling', 'dc')
        if coupling not in ('dc', 'ac'):
            raise self.wrong('accelerometer.coupling', coupling, 'dc or ac')
        cutoff, position = (self.estimate(d, key, _ACCELEROMETER, 'accelerometer.')
                            for key in ('cutoff', 'position'))
        need = {key: self.required(d, key, _ACCELEROMETER, 'accelerometer.')
                for key in ('offset', 'gain', 'map', 'delay')}
        if coupling == 'ac' and cutoff is None:
            raise self.wrong('accelerometer.cutoff', None, 'the corner [Hz] of an ac sensor')
        return Accelerometer(**need, coupling=coupling, cutoff=cutoff, position=position)

    def tool(self, d: dict[str, Any] | None) -> Tool | None:
        if d is None:
            return None
        return Tool(**{key: self.required(d, key, _TOOL, 'tool.') for key in _TOOL})

    def noise(self, d: dict[str, Any] | None) -> Noise | None:
        if d is None:
            return None
        return Noise(
            Q=self.required(d, 'Q', _NOISE, 'noise.'), R=self.required(d, 'R', _NOISE, 'noise.'),
            wrench=self.required(d, 'wrench', _NOISE, 'noise.'),
            specific_force=self.estimate(d, 'specific_force', _NOISE, 'noise.'),
            wrench_rate=self.number(d, 'wrench_rate', 'noise.') or math.nan,
            accelerometer_rate=self.number(d, 'accelerometer_rate', 'noise.') or math.nan)

    def observer(self, d: dict[str, Any] | None) -> ObserverGain | None:
        if d is None:
            return None
        mode = d.get('mode', 'kalman')
        if mode not in ('kalman', 'newton'):
            raise self.wrong('observer.mode', mode, 'kalman or newton')
        gains = self.section(d, 'kalman', 'observer.') or {}
        need = {key: self.required(d, key, _OBSERVER, 'observer.') for key in _OBSERVER}
        dt = self.number(d, 'dt', 'observer.')
        if dt is None or not dt > 0:
            raise self.wrong('observer.dt', dt, 'a positive period [s]')
        return ObserverGain(**need, dt=dt, mode=mode, kalman={
            name: self.read(gain, f'observer.kalman.{name}') for name, gain in gains.items()})

    def section(self, d: Mapping[str, Any], key: str, prefix: str = '') -> dict[str, Any] | None:
        value = d.get(key)
        if value is None or value == NOT_IDENTIFIED:
            return None
        if not isinstance(value, dict):
            raise self.wrong(prefix + key, value, 'a group of keys')
        return value

    def number(self, d: Mapping[str, Any], key: str, prefix: str = '',
               default: float | None = None) -> float | None:
        value = d.get(key, default)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.wrong(prefix + key, value, 'a number')
        return float(value)

    def required(self, d: Mapping[str, Any], key: str, schema: _Schema,
                 prefix: str = '') -> Estimate:
        estimate = self.estimate(d, key, schema, prefix)
        if estimate is None:
            raise self.wrong(prefix + key, d.get(key), '{value, std, unit}')
        return estimate

    def estimate(self, d: Mapping[str, Any], key: str, schema: _Schema,
                 prefix: str = '') -> Estimate | None:
        if d.get(key) is None or d[key] == NOT_IDENTIFIED:
            return None
        estimate = self.read(d[key], prefix + key)
        shape, units = schema[key]
        if estimate.value.shape != shape:
            raise self.wrong(f'{prefix}{key}.value', f'shape {estimate.value.shape}',
                             f'shape {shape}')
        if estimate.unit not in units:
            raise self.wrong(f'{prefix}{key}.unit', estimate.unit, ' or '.join(units))
        return estimate

    def read(self, entry: Any, key: str) -> Estimate:
        if not isinstance(entry, dict) or 'value' not in entry or 'unit' not in entry:
            raise self.wrong(key, entry, '{value, std, unit}')
        value = self.array(entry['value'], f'{key}.value')
        if not np.isfinite(value).all():
            raise self.wrong(f'{key}.value', entry['value'], 'finite numbers')
        std = entry.get('std')
        std_array = np.full(value.shape, np.nan) if std is None else self.array(std, f'{key}.std')
        if std_array.shape not in (value.shape, ()):
            raise self.wrong(f'{key}.std', f'shape {std_array.shape}', f'shape {value.shape}')
        return Estimate(value, std_array, str(entry['unit']))

    def array(self, value: Any, key: str) -> Array:
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            raise self.wrong(key, value, 'numbers') from None
        if array.ndim > 2 or array.size > 4096:
            raise self.wrong(key, f'shape {array.shape}', 'at most a 64 x 64 matrix')
        return array

    def wrong(self, key: str, found: object, expected: str) -> ConfigError:
        text = repr(found) if not isinstance(found, str) else found
        return ConfigError(f'{self.name}: {key} is {text[:80]}, expected {expected}; '
                           'correct the file or calibrate again')
