"""Calibration: what was identified, how sure we are of it, and where it came from.

The one document that leaves the identification and enters observer, exports and diagnosis.
Everything is in SI units and in ft_sensor (S); wrenches are as on the wire, environment on tool:

    wire force  = F_env - m (a - g)                      + bias     (at rest, unloaded: m g + bias)
    V_i         = offset_i + gain_i (map_i . f)                     f = a - g, specific force
    calibrated  = matrix (raw - matrix_offset)                      six-axis, where identified
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
from forcecal_ros.core.schema import Mismatch, path, plain, Row, Vector3, Vector7
import numpy as np
from numpy.typing import ArrayLike

FORMAT = 'forcecal-calibration/1'


@dataclass(frozen=True)
class Estimate:
    """
    A number, or an array of them, with its standard error.

    Attributes
    ----------
    value : ndarray
        Zero-dimensional for a scalar; ``float(estimate)`` gives it.
    std : ndarray
        One standard error each, same shape; NaN where it is not known.
    """

    value: Array
    std: Array
    unit: str

    def __init__(self, value: ArrayLike, std: ArrayLike, unit: str) -> None:
        value_array = np.array(value, dtype=float)
        std_array = np.array(np.broadcast_to(np.asarray(std, dtype=float), value_array.shape))
        for array in (value_array, std_array):
            array.setflags(write=False)
        object.__setattr__(self, 'value', value_array)
        object.__setattr__(self, 'std', std_array)
        object.__setattr__(self, 'unit', unit)

    def __float__(self) -> float:
        return float(self.value)

    def unit_of(self, index: int) -> str:
        """Return the unit of one element; of ``N, N m`` the first half is in N."""
        units = self.unit.split(', ')
        return units[index * len(units) // max(self.value.size, 1)]


@plain.register
def _plain(estimate: Estimate) -> dict[str, Any]:
    """Return what a file holds of an estimate; a standard error that is not known is None."""
    known = np.isfinite(estimate.std).all()
    return {'value': plain(estimate.value), 'std': plain(estimate.std) if known else None,
            'unit': estimate.unit}


class Entry(Row):
    """
    Row of an estimate, in a file ``{value, std, unit}``; shape and range are those of its value.

    ``unit`` may name several, as ``V or m/s^2``; empty: any.
    """

    def take(self, kind: Any, value: Any, where: str) -> Estimate:
        """Check an estimate, or an entry of a file that is made one."""
        entry = vars(value) if isinstance(value, Estimate) else value
        if not isinstance(entry, Mapping) or not {'value', 'unit'} <= set(entry):
            raise Mismatch(where, value, '{value, std, unit}')
        number = super().take(float if self.shape == () else Array, entry['value'],
                              path(where, 'value'))
        unit, std = str(entry['unit']), entry.get('std')
        if self.unit and unit not in self.unit.split(' or '):
            raise Mismatch(path(where, 'unit'), unit, self.unit)
        if isinstance(value, Estimate):
            return value
        if std is not None:
            shape = np.shape(number) if isinstance(std, list) else ()
            std = Row('', unit, 0.0, shape=shape, finite=False).take(
                Array if shape else float, std, path(where, 'std'))
        return Estimate(number, np.nan if std is None else std, unit)


@dataclass(frozen=True, kw_only=True)
class Accelerometer:
    """
    Accelerometer on the tool: ``V_i = offset_i + gain_i (map_i . f)``, [Gamez2005] Eq. 2.

    The three gains of a sensor in volts share the sign that makes ``map`` right-handed (the
    paper's Kgain is negative); those of a scaled sensor are positive.
    """

    offset: Annotated[Estimate, Entry('Reading at zero specific force', 'V or m/s^2', shape=(3,))]
    gain: Annotated[Estimate, Entry('Gain of each axis', 'V/(m/s^2) or 1', shape=(3,))]
    map: Annotated[Estimate, Entry(
        'Rows are unit vectors, the direction of each axis in ft_sensor', '1', shape=(3, 3))]
    coupling: Annotated[str, Row(
        'ac for a sensor with a first-order high-pass', words=('dc', 'ac'))] = 'dc'
    delay: Annotated[Estimate, Entry(
        'Delay relative to the wrench', 's')]
    cutoff: Annotated[Estimate | None, Entry(
        'Corner frequency of the high-pass; None for dc', 'Hz', omit=True)] = None
    position: Annotated[Estimate | None, Entry(
        'Position in ft_sensor at zero displacement; None: assumed at the CoM', 'm', shape=(3,),
        omit=True)] = None

    @property
    def matrix(self) -> Array:
        """Sensitivity, shape (3, 3): ``V = offset + matrix @ f``."""
        return self.gain.value[:, None] * self.map.value

    @property
    def unit(self) -> str:
        """Unit of its readings, ``V`` or ``m/s^2``."""
        return self.offset.unit


@dataclass(frozen=True)
class Tool:
    """Compliance along x of ft_sensor, [Gamez2005] Eq. 29."""

    stiffness: Annotated[Estimate, Entry('Of the compliant axis', 'N/m')]
    damping: Annotated[Estimate, Entry('Of the compliant axis', 'N s/m')]


@dataclass(frozen=True)
class Noise:
    """
    Covariances at rest, measured.

    Those of [Gamez2005] Eq. 6 are continuous: per-sample covariance times the period.
    """

    Q: Annotated[Estimate, Entry('Of [x, dx/dt] in Eq. 6', '(m, m/s)^2 s', shape=(2, 2))]
    R: Annotated[Estimate, Entry(
        'Of [x, dx/dt, d2x/dt2] in Eq. 6', '(m, m/s, m/s^2)^2 s', shape=(3, 3))]
    wrench: Annotated[Estimate, Entry('Of one sample', '(N, N m)^2', shape=(6, 6))]
    specific_force: Annotated[Estimate | None, Entry(
        'Of one sample of the accelerometer, in ft_sensor', '(m/s^2)^2', shape=(3, 3))] = None
    wrench_rate: Annotated[float, Row(
        'Sampling rate of the wrench covariance; NaN: unknown', 'Hz', finite=False)
        ] = np.nan
    accelerometer_rate: Annotated[float, Row(
        'Sampling rate of the accelerometer covariance', 'Hz', finite=False)] = np.nan
    wrench_density: Annotated[Estimate | None, Entry(
        'Spectral density of the wrench at low frequencies; white noise: covariance over rate',
        '(N, N m)^2 s', shape=(6, 6), omit=True)] = None
    specific_force_density: Annotated[Estimate | None, Entry(
        'Low-frequency density of specific force', '(m/s^2)^2 s', shape=(3, 3), omit=True)] = None


@dataclass(frozen=True, kw_only=True)
class ObserverGain:
    """The paper's observer, [Gamez2005] Eq. 4, 18, 19."""

    mode: Annotated[str, Row(
        'Filter that publishes the contact wrench', words=('kalman', 'newton'))] = 'kalman'
    dt: Annotated[float, Row('Step period of the observer', 's', above=0.0)]
    K: Annotated[Estimate, Entry('Gain with k23 = 1', '1', shape=(2, 3))]
    A: Annotated[Estimate, Entry('Of Eq. 4', '1', shape=(2, 2))]
    C: Annotated[Estimate, Entry('Of Eq. 4', '1', shape=(3, 2))]
    kalman: Annotated[Mapping[str, Estimate], Entry(
        'Stationary gains of the six-axis Kalman observer, by name', shape=None)
        ] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """
    One sensor with one tool, calibrated; what was not identified is None.

    The rows are those of ``calibration.yaml``.
    """

    mass: Annotated[Estimate, Entry('All that hangs on the sensor', 'kg', above=0.0)]
    com: Annotated[Estimate, Entry(
        'Centre of mass in ft_sensor at zero tool displacement', 'm', shape=(3,))]
    inertia: Annotated[Estimate | None, Entry(
        'About the centre of mass, axes of ft_sensor', 'kg m^2', shape=(3, 3))] = None
    wrench_bias: Annotated[Estimate, Entry(
        'Reading without load, in the sign of the driver', 'N, N m', shape=(6,))]
    gravity: Annotated[float, Row(
        'Magnitude of gravity used for the calibration', 'm/s^2')] = STANDARD_GRAVITY
    gravity_direction: Annotated[Vector3 | None, Row(
        'Direction of gravity in base, a unit vector; absent: -z', low=-1.0, high=1.0,
        omit=True)] = None
    sensor_rotation: Annotated[Vector3 | None, Row(
        "Rotation vector of the driver's axes in the frame of the pose, into which readings are "
        'rotated; absent: the same axes', 'rad', key='sensor.rotation', omit=True)] = None
    sensor_frame: Annotated[str, Row('frame_id of the wrench', key='sensor.frame')] = 'ft_sensor'
    wrench_sign: Annotated[int, Row(
        '-1 if the driver reports tool on environment; readings were multiplied by it',
        words=(1, -1), key='sensor.sign')] = 1
    sensor_from_pose: Annotated[Vector7 | None, Row(
        'x y z [m] qx qy qz qw of ft_sensor in the frame of the recorded pose; absent: the pose '
        'is that of ft_sensor', key='sensor.from_pose', omit=True)] = None
    accelerometer: Accelerometer | None = None
    tool: Tool | None = None
    noise: Noise | None = None
    observer: ObserverGain | None = None
    matrix: Annotated[Estimate | None, Entry(
        'Converts n raw channels to a wrench', shape=(6, None), omit=True)] = None
    matrix_offset: Annotated[Estimate | None, Entry(
        'Raw reading without load', shape=(None,), key='matrix.offset', omit=True)] = None
    quality: Annotated[Mapping[str, Any], Row(
        'Residuals, condition numbers and warnings')] = field(default_factory=dict)
    source: Annotated[Mapping[str, Any], Row('Origin and date')] = field(default_factory=dict)
