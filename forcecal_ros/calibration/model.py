"""Calibration: what was identified, how sure we are of it, and where it came from.

The one document that leaves the identification and enters observer, exports and diagnosis.
Everything is in SI units and in ft_sensor (S); wrenches are as on the wire, environment on tool:

    wire force  = F_env - m (a - g)                      + bias     (at rest, unloaded: m g + bias)
    V_i         = offset_i + gain_i (map_i . f)                     f = a - g, specific force
    calibrated  = matrix (raw - matrix_offset)                      six-axis, where identified
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from forcecal_ros.geometry import Array, STANDARD_GRAVITY
import numpy as np
from numpy.typing import ArrayLike

FORMAT = 'forcecal-calibration/1'
NOT_IDENTIFIED = 'not identified'


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


@dataclass(frozen=True)
class Accelerometer:
    """
    Accelerometer on the tool: ``V_i = offset_i + gain_i (map_i . f)``, [Gamez2005] Eq. 2.

    Attributes
    ----------
    offset : Estimate, shape (3,)
        [V], or [m/s^2] for a sensor that is already scaled.
    gain : Estimate, shape (3,)
        [V/(m/s^2)], or [1]. Volts: the three share the sign that makes ``map`` right-handed
        (the paper's Kgain is negative). Scaled sensors: positive.
    map : Estimate, shape (3, 3)
        Rows are unit vectors: the direction of each accelerometer axis in ft_sensor.
    delay : Estimate
        How much later than the wrench the accelerometer shows the same instant [s].
    coupling : str
        ``dc``, or ``ac`` for a sensor with a first-order high-pass.
    cutoff : Estimate or None
        Corner of that high-pass [Hz]; None for ``dc``.
    position : Estimate or None
        Where it sits in ft_sensor at zero displacement [m]; None: taken to be at the CoM.
    """

    offset: Estimate
    gain: Estimate
    map: Estimate
    delay: Estimate
    coupling: str = 'dc'
    cutoff: Estimate | None = None
    position: Estimate | None = None

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
    """Compliance along x of ft_sensor, [Gamez2005] Eq. 29: stiffness [N/m], damping [N s/m]."""

    stiffness: Estimate
    damping: Estimate


@dataclass(frozen=True)
class Noise:
    """
    Covariances at rest, measured.

    Attributes
    ----------
    Q : Estimate, shape (2, 2)
        Of [x, dx/dt] in [Gamez2005] Eq. 6, continuous: per-sample covariance times the period.
    R : Estimate, shape (3, 3)
        Of [x, dx/dt, d2x/dt2] in Eq. 6, continuous likewise.
    wrench : Estimate, shape (6, 6)
        Per-sample covariance of the wrench [N^2, N^2 m, N^2 m^2].
    specific_force : Estimate or None, shape (3, 3)
        Per-sample covariance of the accelerometer, in ft_sensor [(m/s^2)^2].
    wrench_rate, accelerometer_rate : float
        Rates the per-sample covariances belong to [Hz].
    """

    Q: Estimate
    R: Estimate
    wrench: Estimate
    specific_force: Estimate | None
    wrench_rate: float
    accelerometer_rate: float


@dataclass(frozen=True)
class ObserverGain:
    """
    The paper's observer, [Gamez2005] Eq. 4, 18, 19.

    Attributes
    ----------
    K : Estimate, shape (2, 3)
        Gain with k23 = 1.
    A : Estimate, shape (2, 2)
    C : Estimate, shape (3, 2)
    dt : float
        Period the observer is stepped at [s].
    mode : str
        ``kalman`` or ``newton``: which one publishes the contact wrench.
    kalman : mapping of str to Estimate
        Stationary gains of the six-axis Kalman observer, by name.
    """

    K: Estimate
    A: Estimate
    C: Estimate
    dt: float
    mode: str = 'kalman'
    kalman: Mapping[str, Estimate] = field(default_factory=dict)


@dataclass(frozen=True)
class Calibration:
    """
    One sensor with one tool, calibrated.

    Attributes
    ----------
    mass : Estimate
        Of what hangs on the sensor [kg].
    com : Estimate, shape (3,)
        Centre of mass in ft_sensor at zero tool displacement [m].
    wrench_bias : Estimate, shape (6,)
        Reading without any load, wire sign [N, N m].
    inertia : Estimate or None, shape (3, 3)
        About the centre of mass, axes of ft_sensor [kg m^2]; None: not identified.
    accelerometer, tool, noise, observer : optional parts
        None where the recording did not have them.
    matrix, matrix_offset : Estimate or None, shapes (6, n), (n,)
        Six-axis calibration of n raw channels.
    gravity : float
        Magnitude the calibration was made with [m/s^2].
    sensor_frame : str
        frame_id of the wrench.
    wrench_sign : int
        -1 where the driver reports tool on environment; readings were multiplied by it.
    quality, source : mapping
        Plain numbers, words and lists: residuals, condition numbers, warnings; where from, when.
    """

    mass: Estimate
    com: Estimate
    wrench_bias: Estimate
    inertia: Estimate | None = None
    accelerometer: Accelerometer | None = None
    tool: Tool | None = None
    noise: Noise | None = None
    observer: ObserverGain | None = None
    matrix: Estimate | None = None
    matrix_offset: Estimate | None = None
    gravity: float = STANDARD_GRAVITY
    sensor_frame: str = 'ft_sensor'
    wrench_sign: int = 1
    quality: Mapping[str, Any] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)
