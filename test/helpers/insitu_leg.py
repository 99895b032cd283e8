"""A simulated leg that hangs from a hip: the protocol of [Traversaro2014] IV, for the tests.

Its own forward physics; nothing of ``forcecal_ros.insitu`` is imported. The sensor S sits in the
thigh, the accelerometer below the knee; S has z down along the leg, x forward. Wrenches are as on
the wire: environment on tool.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

G = 9.80665
RATE = 100.0
BODY_MASS = 2.86
BODY_COM = np.array([0.012, -0.008, 0.205])
BODY_INERTIA = np.array([[0.165, 0.002, -0.010], [0.002, 0.160, 0.004], [-0.010, 0.004, 0.012]])
"""About the centre of mass [kg m^2]."""
KNEE = np.array([0.0, 0.0, 0.12])
SHANK_MASS = 1.9
SHANK_COM = np.array([0.018, -0.006, 0.30])
ACCELEROMETER = np.array([0.22, 0.01, 0.40])
HIP_TO_SENSOR = np.array([0.0, 0.0, 0.09])

MAP = np.array([
    [2.25, -0.15, -0.54, 0.35, -0.90, 0.30],
    [0.53, 1.46, -0.56, 0.80, 0.42, -0.25],
    [0.72, 0.48, 1.24, -0.20, 0.50, 0.30],
    [0.012, -0.020, 0.008, 1.12, 0.06, -0.04],
    [-0.015, 0.010, 0.014, -0.05, 0.93, 0.07],
    [0.006, 0.012, -0.010, 0.04, -0.06, 1.08]])
"""True wrench -> wrench by the manufacturer's matrix, of a sensor grown old."""
GAUGES = np.array([
    [41.0, 3.0, -38.0, 210.0, 820.0, -60.0],
    [-4.0, 55.0, -36.0, -860.0, 190.0, 400.0],
    [-40.0, -2.0, -37.0, 650.0, -700.0, 90.0],
    [3.0, -52.0, -39.0, 240.0, -830.0, 420.0],
    [2.0, 1.0, -45.0, -610.0, -720.0, -30.0],
    [-1.0, -53.0, -41.0, 690.0, 640.0, 380.0]])
"""Wrench by the manufacturer's matrix -> counts of the six gauges."""
OFFSET = np.array([1250.0, -840.0, 310.0, 2210.0, -1730.0, 420.0])
FORCE_NOISE, TORQUE_NOISE, ACCELERATION_NOISE, GYRO_NOISE = 0.3, 0.02, 0.05, 0.002


@dataclass(frozen=True)
class Load:
    """What was screwed on: mass [kg] at a place in S [m]."""

    mass: float = 0.0
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    train: bool = True


PROTOCOL = (
    Load(0.0),
    Load(0.51, (0.34, 0.10, 0.39)),
    Load(0.51, (0.02, -0.14, 0.42)),
    Load(0.51, (0.24, -0.12, 0.45)),
    Load(0.51, (0.39, 0.035, 0.39), train=False),
    Load(0.51, (0.20, 0.0, 0.43), train=False),
    Load(0.0, train=False),
    Load(0.51, (0.043, 0.0, 0.43), train=False),
)
"""Four data sets to train, four to validate; the latter as in the paper's Table III, leg."""


@dataclass(frozen=True)
class Leg:
    """What can be turned on a simulated recording; the defaults have the protocol's noise."""

    noise: float = 1.0
    accelerometer_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    hysteresis: float = 0.0
    flex: float = 0.0
    speed: float = 1.0
    inertial: bool = False
    duration: float = 60.0
    channels: Array = field(default_factory=lambda: GAUGES @ MAP)
    offset: Array = field(default_factory=lambda: OFFSET)
    noise_map: Array = field(default_factory=lambda: GAUGES)


REAL = Leg(accelerometer_bias=(0.05, -0.05, 0.05), hysteresis=0.005, flex=np.deg2rad(0.3))
"""The protocol's second arm."""


@dataclass(frozen=True)
class Log:
    """One recording: raw channels [counts], specific force [m/s^2], gyro [rad/s], truth."""

    t: Array
    raw: Array
    accel: Array
    gyro: Array
    wrench: Array


def motion(t: Array, phase: float, speed: float) -> tuple[Array, Array, Array]:
    """Front-back +-40 deg and lateral +-30 deg: R_base_sensor, omega, alpha in S."""
    def swing(amplitude: float, rate: float, shift: float) -> tuple[Array, Array, Array]:
        w = 2 * np.pi * rate * speed
        x = w * t + shift
        return (amplitude * np.sin(x), amplitude * w * np.cos(x), -amplitude * w * w * np.sin(x))

    a, da, dda = swing(np.deg2rad(40), 1 / 30, phase)
    b, db, ddb = swing(np.deg2rad(30), 1 / 23, 1.7 * phase + 0.4)
    cb, sb, down = np.cos(b), np.sin(b), np.diag([1.0, -1.0, -1.0])
    R = Rotation.from_euler('YX', np.stack([a, b], axis=1)).as_matrix() @ down
    omega = np.stack([db, da * cb, -da * sb], axis=1) @ down
    alpha = np.stack([ddb, dda * cb - da * db * sb, -dda * sb - da * db * cb], axis=1) @ down
    return R, omega, alpha


def play(x: Array, width: float) -> Array:
    """Hysteresis of each column by a play of ``width`` times its span between the branches."""
    half = width * np.ptp(x, axis=0) / 2
    y = np.empty_like(x)
    state = x[0].copy()
    for i, row in enumerate(x):
        state = np.clip(state, row - half, row + half)
        y[i] = state
    return y


def record(load: Load, leg: Leg, seed: int) -> Log:
    """Move the leg once with a load on it and write down what the sensors say."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(leg.duration * RATE)) / RATE
    R, omega, alpha = motion(t, rng.uniform(0, 2 * np.pi), leg.speed)
    gravity = R.transpose(0, 2, 1) @ np.array([0, 0, -G])
    turning = cross(omega) @ cross(omega) + cross(alpha)
    rotational = turning if leg.inertial else np.zeros((len(t), 3, 3))
    specific_S = rotational @ HIP_TO_SENSOR - gravity

    load_com = np.array(load.position)
    angle = np.zeros_like(t)
    if leg.flex:
        moment = (SHANK_MASS * np.cross(SHANK_COM - KNEE, gravity)
                  + load.mass * np.cross(load_com - KNEE, gravity))[:, 1]
        angle = leg.flex * moment / np.abs(moment).max()
    bend = Rotation.from_euler('y', angle[:, None]).as_matrix()
    shift = (bend - np.eye(3)) @ (SHANK_COM - KNEE)
    com = BODY_COM + shift * SHANK_MASS / BODY_MASS
    place = KNEE + bend @ (load_com - KNEE)
    inertia = BODY_INERTIA + point_inertia(Load(BODY_MASS, tuple(BODY_COM)))
    w = np.zeros((len(t), 6))
    for m, c, J in ((BODY_MASS, com, inertia), (load.mass, place, point_inertia(load))):
        w[:, :3] -= m * (specific_S + np.einsum('nij,nj->ni', rotational, c))
        w[:, 3:] -= np.cross(c, m * specific_S)
        if leg.inertial:
            w[:, 3:] -= alpha @ J.T + np.cross(omega, omega @ J.T)

    clean = w @ leg.channels.T
    if leg.hysteresis:
        clean = play(clean, leg.hysteresis)
    sigma = leg.noise * np.repeat([FORCE_NOISE, TORQUE_NOISE], 3)
    noise = (rng.standard_normal((len(t), 6)) * sigma) @ leg.noise_map.T
    felt = np.einsum('nji,nj->ni', bend, specific_S + rotational @ ACCELEROMETER)
    accel = felt + np.array(leg.accelerometer_bias) \
        + leg.noise * ACCELERATION_NOISE * rng.standard_normal((len(t), 3))
    gyro = omega + leg.noise * GYRO_NOISE * rng.standard_normal((len(t), 3))
    return Log(t, clean + leg.offset + noise, accel, gyro, w)


def point_inertia(load: Load) -> Array:
    """Inertia of a point mass about the origin of S."""
    p = np.array(load.position)
    return load.mass * (p @ p * np.eye(3) - np.outer(p, p))


def cross(v: Array) -> Array:
    """Matrices of ``v x``."""
    return np.cross(np.eye(3), v[:, None])


def true_matrix(leg: Leg) -> Array:
    """Return the matrix from counts above the offset to the wrench."""
    return np.linalg.pinv(leg.channels)
