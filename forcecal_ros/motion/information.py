"""What a calibration sequence will tell: Fisher information of its poses and of its moves.

The identification is linear but for delay and place of the accelerometer. At rest

    F = m g + b_F,    n = -[g]x (m c) + b_n,    V = V0 - M g

with gravity g in ft_sensor, and in motion the accelerometer is held against the force sensor,

    V(t + delay) = V0 + M f,    f = (b_F - F) / m + ([alpha]x + [omega]x [omega]x) l

so that each part adds J^T W J of its readings, independent of what comes before or after it.
Errors of pose and step are left out: the first are small, and the second identifies the tool's
spring.
"""

from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_from_vector, skew, STANDARD_GRAVITY
from forcecal_ros.motion.profiles import Move, quintic
import numpy as np

_TOOL, _ACCELEROMETER = 10, 16


class Sensors(NamedTuple):
    """
    What is expected of tool and sensors, and how noisy they are.

    Attributes
    ----------
    mass : float
        [kg]
    com : ndarray, shape (3,)
        In ft_sensor [m].
    force, torque : float
        Noise densities [N/sqrt(Hz)], [N m/sqrt(Hz)]: the standard error of a mean over one
        second.
    volts : float
        Of the accelerometer [V/sqrt(Hz)], or [m/s^2/sqrt(Hz)] of one that is not in volts; NaN
        where there is none.
    gain : float
        Of the accelerometer [V/(m/s^2)], or 1.
    gravity : float
        [m/s^2]
    """

    mass: float
    com: Array
    force: float
    torque: float
    volts: float
    gain: float = 1.0
    gravity: float = STANDARD_GRAVITY

    @property
    def has_accelerometer(self) -> bool:
        """Whether there is one."""
        return not np.isnan(self.volts)


def sensors_of(calibration: Calibration) -> Sensors:
    """
    Return what a calibration states of tool and sensors.

    Raises
    ------
    DataError
        It holds no noise.
    """
    noise, accelerometer = calibration.noise, calibration.accelerometer
    if noise is None:
        raise DataError('the calibration holds no noise, without which no errors can be '
                        'predicted; calibrate from a recording with poses of 1 s')
    wrench = _density(noise.wrench_density, noise.wrench, noise.wrench_rate)
    force, torque = (float(np.sqrt(wrench[part].mean())) for part in (slice(3), slice(3, 6)))
    gain, volts = 1.0, np.nan
    if accelerometer is not None and noise.specific_force is not None:
        gain = float(np.abs(accelerometer.gain.value).mean())
        volts = gain * float(np.sqrt(_density(
            noise.specific_force_density, noise.specific_force, noise.accelerometer_rate).mean()))
    return Sensors(float(calibration.mass), calibration.com.value, force, torque, volts, gain,
                   calibration.gravity)


def _density(density: Estimate | None, covariance: Estimate, rate: float) -> Array:
    """Return the spectral density at low frequencies, by channel; white where not measured."""
    if density is None and not rate > 0:
        raise DataError('the calibration states neither the density of its noise nor the rate of '
                        'the readings; calibrate again')
    return np.diag(covariance.value / rate if density is None else density.value)


class Information(NamedTuple):
    """
    Fisher information, which adds up over stretches of a sequence.

    Attributes
    ----------
    tool : ndarray, shape (10, 10)
        Of mass, force bias, first moment, torque bias.
    accelerometer : ndarray, shape (16, 16)
        Of offset, map (row by row), delay, lever from the centre of mass.
    by_tool : ndarray, shape (16, 10)
        How errors of the tool enter the normal equations of the accelerometer.
    """

    tool: Array
    accelerometer: Array
    by_tool: Array

    def plus(self, other: 'Information', times: float = 1.0) -> 'Information':
        """Return the sum with ``times`` another."""
        return Information(*(a + times * b for a, b in zip(self, other)))

    def covariances(self) -> tuple[Array, Array]:
        """Return those of the tool (10, 10) and of the accelerometer (16, 16)."""
        tool = _inverse(self.tool)
        inverse = _inverse(self.accelerometer)
        carried = inverse @ self.by_tool
        return tool, inverse + carried @ tool @ carried.T


def nothing() -> Information:
    """Return the information of no reading."""
    return Information(np.zeros((_TOOL, _TOOL)), np.zeros((_ACCELEROMETER, _ACCELEROMETER)),
                       np.zeros((_ACCELEROMETER, _TOOL)))


def at_rest(R_base_sensor: Array, sensors: Sensors) -> Information:
    """Return the information of one second in a pose."""
    g = -sensors.gravity * R_base_sensor[2]
    design = np.zeros((6, _TOOL))
    design[:3, 0] = g
    design[:3, 1:4] = design[3:, 7:] = np.eye(3)
    design[3:, 4:7] = -skew(g)
    design /= np.repeat([sensors.force, sensors.torque], 3)[:, None]
    empty = nothing()
    if not sensors.has_accelerometer:
        return empty._replace(tool=design.T @ design)
    J = _accelerometer_rows(-g[None], np.zeros((1, 3)), np.zeros((1, 3, 3)), sensors)[0]
    return empty._replace(tool=design.T @ design, accelerometer=J.T @ J / sensors.volts**2)


def in_motion(move: Move, sensors: Sensors) -> Information:
    """Return the information of a move, or of settling where it has no distance."""
    if not sensors.has_accelerometer:
        return nothing()
    # spacing: moves are sampled that densely [s]: the block length of the identification
    n = max(2, round(move.duration / 0.02))
    s, rate, change = quintic((np.arange(n) + 0.5) / n)
    omega = rate[:, None] * move.turn / move.duration
    alpha = change[:, None] * move.turn / move.duration**2
    R = move.start.R_base_sensor @ rotation_from_vector(s[:, None] * move.turn)
    f = sensors.gravity * R[:, 2]
    J = _accelerometer_rows(f, -np.cross(omega, f), skew(alpha) + skew(omega) @ skew(omega),
                            sensors)
    # f = (b_F - F) / m, by the mass and by the force bias
    by_tool = np.zeros((n, 3, _TOOL))
    by_tool[:, :, 0] = -f * sensors.gain / sensors.mass
    by_tool[:, :, 1:4] = np.eye(3) * sensors.gain / sensors.mass
    weight = move.duration / n / (
        sensors.volts**2 + (sensors.gain * sensors.force / sensors.mass)**2)
    return nothing()._replace(accelerometer=weight * _products(J, J),
                              by_tool=weight * _products(J, by_tool))


def _products(a: Array, b: Array) -> Array:
    """Sum a^T b over n instants and three readings, (n, 3, p) and (n, 3, q) to (p, q)."""
    return a.reshape(-1, a.shape[2]).T @ b.reshape(-1, b.shape[2])


def _accelerometer_rows(f: Array, slope: Array, turning: Array, sensors: Sensors) -> Array:
    """Jacobian of the three readings at each of n instants, shape (n, 3, 16)."""
    J = np.zeros((len(f), 3, _ACCELEROMETER))
    for i in range(3):
        J[:, i, i] = 1.0
        J[:, i, 3 + 3 * i:6 + 3 * i] = f
    J[:, :, 12] = -sensors.gain * slope
    J[:, :, 13:] = sensors.gain * turning
    return J


def _inverse(matrix: Array) -> Array:
    """Invert a positive semidefinite matrix; infinite variances where there is no information."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    scaled = scale[:, None] * vectors
    return np.asarray(scaled / np.maximum(values, 1e-12) @ scaled.T)
