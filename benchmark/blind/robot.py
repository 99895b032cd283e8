"""Commanded poses to the motion of the sensor frame S.

The position servo is linear and its input runs straight between corners, so each step is exact
(a matrix exponential); the orientation servo is integrated by Runge-Kutta on quaternions.
"""

import math
from typing import NamedTuple

from numba import njit
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]

PERIOD = 0.004
"""Of commands [s]."""
STEP = 0.000125
"""Grid of the motion [s]."""
PER_PERIOD = 32


class Robot(NamedTuple):
    """
    How S follows its commands.

    Attributes
    ----------
    servo, turn_servo : float
        Of position and of orientation [rad/s].
    delay : float
        From a command to its motion, beyond nominal [s].
    mode_hz, mode_damping, mode_share : float
        A structural mode that the acceleration of S excites; its share of the motion.
    ripple, ripple_pitch : float
        Error of position that repeats along each axis: amplitude and pitch [m].
    """

    servo: float = 300.0
    turn_servo: float = 60.0
    delay: float = 0.0
    mode_hz: float = 10.0
    mode_damping: float = 0.05
    mode_share: float = 0.0
    ripple: float = 0.0
    ripple_pitch: float = 0.02


class Motion(NamedTuple):
    """
    Motion of S on a grid of :data:`STEP`, from t = 0 on.

    Attributes
    ----------
    position, velocity, acceleration : ndarray, shape (n, 3)
        In base.
    R : ndarray, shape (n, 3, 3)
        Sensor to base.
    omega, alpha : ndarray, shape (n, 3)
        In S.
    """

    position: Array
    velocity: Array
    acceleration: Array
    R: Array
    omega: Array
    alpha: Array


def move(robot: Robot, position: Array, quaternion: Array) -> Motion:
    """
    Return the motion of S.

    Parameters
    ----------
    robot : Robot
    position : ndarray, shape (m, 3)
        Commands, one every 4 ms from t = 0 on, in base [m].
    quaternion : ndarray, shape (m, 4)
        Commands, w first, neighbours in one hemisphere.

    Returns
    -------
    Motion
        Up to 4 m ms.
    """
    late = round(robot.delay / STEP)
    corners = _corners(position)
    x, v, a = _servo(corners, robot.servo)
    q, omega, alpha = _turn(quaternion, robot.turn_servo)
    x, v, a, q, omega, alpha = (_held(one, late) for one in (x, v, a, q, omega, alpha))
    if robot.mode_share:
        x, v, a = _with_mode(robot, x, v, a)
    if robot.ripple:
        x, v, a = _with_ripple(robot, x, v, a)
    return Motion(x, v, a, matrices(q), omega, alpha)


def _held(values: Array, late: int) -> Array:
    if not late:
        return values
    return np.concatenate([np.repeat(values[:1], late, axis=0), values[:-late]])


def _corners(r: Array) -> Array:
    """Return the controller's output at 4k ms, and before."""
    y = np.empty((len(r) + 1, 3))
    y[0] = r[0]  # y_(-1), and y_0 too: command 0 is where all is at rest
    y[1] = r[0]
    for k in range(1, len(r)):
        y1, y2, y3 = (y[max(k - i, 0) + (1 if k - i >= 0 else 0)] for i in (1, 2, 3))
        r1, r2, r3 = (r[max(k - i, 0)] for i in (1, 2, 3))
        y[k + 1] = (1.0494 * y1 - 0.0775 * y2 + 0.0006 * y3
                    + 1.2348 * r1 - 1.5084 * r2 + 0.3011 * r3)
    return y


def _servo(corners: Array, w: float) -> tuple[Array, Array, Array]:
    """Follow the corners: (p + w)^3 x = w^3 u with u straight between them."""
    chain = np.zeros((5, 5))
    chain[0, 1] = chain[1, 2] = 1.0
    chain[2] = [-w**3, -3 * w**2, -3 * w, w**3, 0.0]
    chain[3, 4] = 1.0
    states = _linear(corners, expm(chain * STEP)[:3])
    return states[..., 0], states[..., 1], states[..., 2]


@njit(cache=True)
def _linear(corners, advance):  # type: ignore[no-untyped-def]
    periods, axes = corners.shape[0] - 1, corners.shape[1]
    out = np.zeros((periods * PER_PERIOD, axes, 3))
    for j in range(axes):
        z = np.zeros(5)
        z[0] = corners[0, j]
        n = 0
        for k in range(periods):
            z[4] = (corners[k + 1, j] - corners[k, j]) / PERIOD
            for i in range(PER_PERIOD):
                out[n, j] = z[:3]
                n += 1
                z[3] = corners[k, j] + z[4] * (i * STEP)
                z[:3] = advance @ z
    return out


@njit(cache=True)
def _quaternion_product(a, b):  # type: ignore[no-untyped-def]
    return np.array([
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]])


@njit(cache=True)
def _rotation_vector(q):  # type: ignore[no-untyped-def]
    v = q[1:]
    norm = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if norm < 1e-12:
        return 2.0 * v * (1.0 if q[0] >= 0 else -1.0)
    angle = 2.0 * math.atan2(norm, abs(q[0]))
    return v * (angle / norm * (1.0 if q[0] >= 0 else -1.0))


@njit(cache=True)
def _along(start, turn, share):  # type: ignore[no-untyped-def]
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2) * share
    part = np.empty(4)
    part[0] = math.cos(0.5 * angle)
    scale = 0.5 * share if angle < 1e-12 else math.sin(0.5 * angle) / angle * share
    part[1:] = turn * scale
    return _quaternion_product(start, part)


@njit(cache=True)
def _rates(q, omega, goal, w):  # type: ignore[no-untyped-def]
    inverse = np.array([q[0], -q[1], -q[2], -q[3]])
    alpha = w * w * _rotation_vector(_quaternion_product(inverse, goal)) - 2.0 * w * omega
    spin = np.empty(4)
    spin[0] = 0.0
    spin[1:] = omega
    return 0.5 * _quaternion_product(q, spin), alpha


@njit(cache=True)
def _turn(commands, w):  # type: ignore[no-untyped-def]
    periods, h = len(commands), STEP
    qs = np.empty((periods * PER_PERIOD, 4))
    omegas = np.empty((periods * PER_PERIOD, 3))
    alphas = np.empty((periods * PER_PERIOD, 3))
    q, omega = commands[0].copy(), np.zeros(3)
    n = 0
    for k in range(periods):
        start = commands[max(k - 1, 0)]
        inverse = np.array([start[0], -start[1], -start[2], -start[3]])
        turn = _rotation_vector(_quaternion_product(inverse, commands[k]))
        for i in range(PER_PERIOD):
            goal0 = _along(start, turn, i / PER_PERIOD)
            goal1 = _along(start, turn, (i + 0.5) / PER_PERIOD)
            goal2 = _along(start, turn, (i + 1.0) / PER_PERIOD)
            q1, w1 = _rates(q, omega, goal0, w)
            qs[n], omegas[n], alphas[n] = q, omega, w1
            n += 1
            q2, w2 = _rates(q + 0.5 * h * q1, omega + 0.5 * h * w1, goal1, w)
            q3, w3 = _rates(q + 0.5 * h * q2, omega + 0.5 * h * w2, goal1, w)
            q4, w4 = _rates(q + h * q3, omega + h * w3, goal2, w)
            q = q + h / 6.0 * (q1 + 2 * q2 + 2 * q3 + q4)
            q = q / np.sqrt(np.sum(q * q))
            omega = omega + h / 6.0 * (w1 + 2 * w2 + 2 * w3 + w4)
    return qs, omegas, alphas


def _with_mode(robot: Robot, x: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Add a deflection e: e'' + 2 zeta w e' + w^2 e = -share * a_S, exact for held a_S."""
    w = 2 * math.pi * robot.mode_hz
    chain = np.zeros((3, 3))
    chain[0, 1] = 1.0
    chain[1] = [-w**2, -2 * robot.mode_damping * w, -robot.mode_share]
    e = _held_input(a, expm(chain * STEP)[:2])
    bend = -w**2 * e[..., 0] - 2 * robot.mode_damping * w * e[..., 1] - robot.mode_share * a
    return x + e[..., 0], v + e[..., 1], a + bend


@njit(cache=True)
def _held_input(u, advance):  # type: ignore[no-untyped-def]
    out = np.zeros((u.shape[0], u.shape[1], 2))
    for j in range(u.shape[1]):
        z = np.zeros(3)
        for n in range(len(u) - 1):
            z[2] = 0.5 * (u[n, j] + u[n + 1, j])
            z[:2] = advance @ z
            out[n + 1, j] = z[:2]
    return out


def _with_ripple(robot: Robot, x: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Add ripple * sin(2 pi x / pitch) to each axis, counted from where it starts."""
    k = 2 * math.pi / robot.ripple_pitch
    phase = k * (x - x[0])
    sine, cosine = np.sin(phase), np.cos(phase)
    return (x + robot.ripple * sine, v * (1 + robot.ripple * k * cosine),
            a * (1 + robot.ripple * k * cosine) - robot.ripple * k**2 * sine * v**2)


def matrices(q: Array) -> Array:
    """Return rotation matrices (n, 3, 3) of quaternions (n, 4), w first."""
    w, x, y, z = q.T
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


def quaternions(R: Array) -> Array:
    """Return quaternions (n, 4), w first, of rotation matrices, without jumps of sign."""
    from scipy.spatial.transform import Rotation
    q = Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]]
    turned = np.sum(q[1:] * q[:-1], axis=1) < 0
    sign = np.where(np.concatenate([[0], np.cumsum(turned)]) % 2, -1.0, 1.0)
    return np.ascontiguousarray(q * sign[:, None])
