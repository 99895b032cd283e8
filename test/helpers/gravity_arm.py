"""A simulated arm that swings a hand without touching anything: the experiment of [Ukf2025].

Its own forward physics; nothing of ``forcecal_ros.observe`` is imported. Wrenches are as on the
wire: environment on tool, so m g at rest.
"""

from typing import NamedTuple

from forcecal_ros.core.calibration import Accelerometer, Calibration, Estimate, Noise
from forcecal_ros.core.streams import PoseStream, Recording, Stream
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

G = np.array([0.0, 0.0, -9.80665])
RATE, POSE_EVERY = 1000.0, 4
FORCE_NOISE, TORQUE_NOISE = 0.05, 0.003
ACCELERATION_NOISE, ACCELERATION_BIAS, GYRO_NOISE, GYRO_OFFSET = 0.05, 0.01, 0.003, 0.002
POSITION_NOISE, ROTATION_NOISE = 20e-6, 20e-6

MASS = 0.6
COM = np.array([0.006, -0.004, 0.0895])
INERTIA = np.diag([9e-4, 8e-4, 4e-4])
"""About the centre of mass [kg m^2]."""
IMU = np.array([0.02, 0.01, 0.05])
"""Place of the accelerometer in S [m]."""
BIAS = np.array([0.4, -0.3, 0.5, 0.02, -0.03, 0.01])

TABLE = np.array([0.162, 0.160, 0.227, 0.010, 0.010, 0.039])
"""Maximum errors that [Ukf2025] reports [N, N m]."""


class Motion(NamedTuple):
    """Exact motion of S over time: all the sensors will be computed from."""

    t: Array
    position: Array
    R_base_sensor: Array
    acceleration: Array
    """Of the origin of S, in base [m/s^2]."""
    omega: Array
    alpha: Array
    """In S [rad/s], [rad/s^2]."""


def _from_rest(t: Array) -> tuple[Array, Array, Array]:
    """Time that begins to run within the first second: value, first and second derivative."""
    x = np.minimum(t, 1.0)
    return (np.maximum(t - 1.0, 0.0) + x ** 3 - x ** 4 / 2, 3 * x ** 2 - 2 * x ** 3,
            6 * x - 6 * x ** 2)


def _sum_of_sines(rng: np.random.Generator, t: Array, low: float, high: float,
                  ) -> tuple[Array, Array, Array]:
    """Value, first and second derivative of four sines, of largest value 1, from rest."""
    f = 2 * np.pi * np.linspace(low, high, 4) * rng.uniform(0.9, 1.1, 4)
    phase, size = rng.uniform(0, 2 * np.pi, 4), rng.uniform(0.5, 1.0, 4) / np.arange(1, 5)
    tau, rate, growth = _from_rest(t)
    angle = tau[:, None] * f + phase
    s, c = np.sin(angle), np.cos(angle)
    value, first, second = s @ size, c @ (size * f), -s @ (size * f * f)
    scale = 1 / np.abs(value).max()
    return (scale * value, scale * first * rate,
            scale * (second * rate ** 2 + first * growth))


def free_motion(rng: np.random.Generator, duration: float = 20.0) -> Motion:
    """
    Wave about: tilt up to 26 and 19 deg, turn, 0.6 m/s^2 in each direction.

    The tilts bring the raw force to about 3, 2 and 6 N, as in the paper's table.
    """
    t = np.arange(round(duration * RATE)) / RATE
    yaw, pitch, roll = ((size * np.array(_sum_of_sines(rng, t, 0.08, 0.35))) for size in
                        np.radians([60.0, 26.0, 19.0]))
    lines = [np.array(_sum_of_sines(rng, t, 0.15, 0.6)) for _ in range(3)]
    lines = [line * (0.6 / np.abs(line[2]).max()) for line in lines]
    a, b, c = yaw, pitch, roll
    sb, cb, sc, cc = np.sin(b[0]), np.cos(b[0]), np.sin(c[0]), np.cos(c[0])
    # body rates of Rz(a) Ry(b) Rx(c), and their derivatives
    omega = np.stack([c[1] - a[1] * sb, b[1] * cc + a[1] * cb * sc, -b[1] * sc + a[1] * cb * cc])
    alpha = np.stack([
        c[2] - a[2] * sb - a[1] * b[1] * cb,
        b[2] * cc - b[1] * c[1] * sc + a[2] * cb * sc
        + a[1] * (-b[1] * sb * sc + c[1] * cb * cc),
        -b[2] * sc - b[1] * c[1] * cc + a[2] * cb * cc
        - a[1] * (b[1] * sb * cc + c[1] * cb * sc)])
    # S hangs from the flange with z down
    down = Rotation.from_euler('x', np.pi)
    R = (Rotation.from_euler('ZYX', np.stack([a[0], b[0], c[0]], axis=1)) * down).as_matrix()
    flip = np.array([1.0, -1.0, -1.0])
    return Motion(t, np.stack([line[0] for line in lines], axis=1), R,
                  np.stack([line[2] for line in lines], axis=1),
                  omega.T * flip, alpha.T * flip)


def resting(directions: Array, seconds: float) -> Motion:
    """Stand still with g along each direction of S in turn, shape (k, 3)."""
    n = round(seconds * RATE)
    R = [Rotation.align_vectors([[0, 0, -1.0]], [d])[0].as_matrix() for d in directions]
    R_all = np.repeat(np.array(R), n, axis=0)
    zero = np.zeros((len(R_all), 3))
    return Motion(np.arange(len(R_all)) / RATE, zero, R_all, zero, zero, zero)


def specific_force(motion: Motion, place: Array) -> Array:
    """Acceleration less gravity at a place of the hand, in S."""
    in_sensor = np.einsum('nji,nj->ni', motion.R_base_sensor, motion.acceleration - G)
    return in_sensor + np.cross(motion.alpha, place) + np.cross(
        motion.omega, np.cross(motion.omega, place))


def true_load(motion: Motion) -> Array:
    """Wrench of weight and inertia of the hand on the wire."""
    force = -MASS * specific_force(motion, COM)
    spin = motion.alpha @ INERTIA + np.cross(motion.omega, motion.omega @ INERTIA)
    return np.concatenate([force, np.cross(COM, force) - spin], axis=1)


def record(motion: Motion, rng: np.random.Generator, contact: Array | float = 0.0,
           noise: tuple[float, float] = (FORCE_NOISE, TORQUE_NOISE),
           accelerometer_bias: Array | float = 0.0) -> Recording:
    """
    Let the sensors look at a motion.

    Parameters
    ----------
    motion : Motion
    rng : numpy Generator
    contact : ndarray, shape (n, 6), or 0
        Wrench of the environment on the hand.
    noise : tuple of 2 float
        Of the force sensor [N], [N m].
    accelerometer_bias : ndarray, shape (3,), or 0
        Beyond the calibration [m/s^2].
    """
    n = len(motion.t)
    wrench = true_load(motion) + BIAS + contact + rng.normal(
        0.0, np.repeat(noise, 3), (n, 6))
    f = specific_force(motion, IMU) + accelerometer_bias + rng.normal(
        0, ACCELERATION_NOISE, (n, 3))
    seen = slice(None, None, POSE_EVERY)
    k = len(motion.t[seen])
    wobble = Rotation.from_rotvec(rng.normal(0, ROTATION_NOISE, (k, 3)))
    R = (Rotation.from_matrix(motion.R_base_sensor[seen]) * wobble).as_matrix()
    return Recording(
        wrench=Stream(motion.t, wrench, 'ft_sensor'),
        accelerometer=Stream(motion.t, f, 'ft_sensor'), accelerometer_unit='m/s^2',
        pose=PoseStream(motion.t[seen],
                        motion.position[seen] + rng.normal(0, POSITION_NOISE, (k, 3)), R),
        angular_velocity=Stream(motion.t, motion.omega + rng.normal(0, GYRO_OFFSET, 3)
                                + rng.normal(0, GYRO_NOISE, (n, 3))),
        contact_truth=Stream(motion.t, np.broadcast_to(contact, (n, 6))),
        start_ns=1_700_000_000_000_000_000, source='simulated arm')


def calibrate(rng: np.random.Generator, noise: tuple[float, float] = (FORCE_NOISE, TORQUE_NOISE),
              seconds: float = 1.0) -> tuple[Calibration, Array]:
    """
    Calibrate the arm from twelve poses at rest by plain least squares; the inertia is 5 % off.

    Returns
    -------
    Calibration
    accelerometer_bias : ndarray, shape (3,)
        That of this accelerometer from then on: it moved by ACCELERATION_BIAS.
    """
    directions = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(6, 3))])
    motion = resting(directions, seconds)
    recording = record(motion, rng, noise=noise)
    assert recording.wrench is not None and recording.accelerometer is not None
    wrench, f = recording.wrench.values, recording.accelerometer.values
    g = motion.R_base_sensor.transpose(0, 2, 1) @ G
    n = len(g)
    design = np.zeros((n, 6, 10))
    design[:, :3, 0] = g
    # c x m g = -[g]x (m c)
    design[:, 3:, 1:4] = -np.cross(g[:, None, :], np.eye(3)[None]).transpose(0, 2, 1)
    design[:, :, 4:] = np.eye(6)
    sigma = np.repeat(noise, 3)
    A, y = (design / sigma[:, None]).reshape(-1, 10), (wrench / sigma).reshape(-1)
    solution, *_ = np.linalg.lstsq(A, y)
    cov = np.linalg.inv(A.T @ A)
    residual = y.reshape(-1, 6) - (A @ solution).reshape(-1, 6)
    mass, com = solution[0], solution[1:4] / solution[0]
    offset = (f + g).mean(axis=0)
    calibration = Calibration(
        mass=Estimate(mass, np.sqrt(cov[0, 0]), 'kg'),
        com=Estimate(com, np.sqrt(cov.diagonal()[1:4]) / mass, 'm'),
        wrench_bias=Estimate(solution[4:], np.sqrt(cov.diagonal()[4:]), 'N, N m'),
        inertia=Estimate(INERTIA * rng.normal(1, 0.05), 0.05 * INERTIA, 'kg m^2'),
        accelerometer=Accelerometer(
            offset=Estimate(offset, ACCELERATION_NOISE / np.sqrt(n), 'm/s^2'),
            gain=Estimate(np.ones(3), 0.0, '1'), map=Estimate(np.eye(3), 0.0, '1'),
            delay=Estimate(0.0, 0.0, 's'), position=Estimate(IMU, 0.0, 'm')),
        noise=Noise(
            Q=Estimate(np.zeros((2, 2)), 0.0, '(m, m/s)^2 s'),
            R=Estimate(np.zeros((3, 3)), 0.0, '(m, m/s, m/s^2)^2 s'),
            wrench=Estimate(np.cov((residual * sigma).T), 0.0, '(N, N m)^2'),
            specific_force=Estimate(np.cov((f + g).T), 0.0, '(m/s^2)^2'),
            wrench_rate=RATE, accelerometer_rate=RATE))
    return calibration, rng.normal(0, ACCELERATION_BIAS, 3)
