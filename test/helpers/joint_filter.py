"""The yardstick of the contact filter: one Kalman filter of place, offset and force together."""

from typing import NamedTuple

from forcecal_ros.observe.settings import CONTACT_WALK, POSE_RATE_HZ
import numpy as np
from scipy.linalg import solve_discrete_are


class StationaryFilter(NamedTuple):
    """Gain (n, m) of the update, and error covariance (n, n) before and after it."""

    gain: np.ndarray
    predicted: np.ndarray
    updated: np.ndarray


def stationary_filter(A, C, Q, R, S=None):
    """Return the filter of x' = A x + w, y = C x + v; S is the covariance of w with v."""
    P = solve_discrete_are(A.T, C.T, Q, R, s=S)
    innovation = C @ P @ C.T + R
    gain = np.linalg.solve(innovation, C @ P).T
    return StationaryFilter(gain, P, P - gain @ innovation @ gain.T)


def joint_model(levels, mass, settings, dt):
    """
    Write one axis of the whole problem as A, C, Q, R, S.

    x = [p, v, o, F], the accelerometer as input: dv/dt = f - o + g. Measured are p and
    u - m a = F + m o, whose noise (m times the accelerometer's) is also the noise that drives v.
    """
    A = np.eye(4)
    A[0, 1], A[0, 2], A[1, 2] = dt, -dt * dt / 2, -dt
    f = levels.specific_force / dt
    drive = np.array([dt * dt / 2, dt, 0.0, 0.0])
    Q = f * np.outer(drive, drive)
    walk = CONTACT_WALK if settings.contact_walk is None else settings.contact_walk
    Q[2, 2] += 5e-4 ** 2 * dt
    Q[3, 3] += walk ** 2 * dt
    C = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, mass, 1.0]])
    p_variance = settings.pose_position_std ** 2 / POSE_RATE_HZ / dt
    R = np.diag([p_variance, levels.force / dt + mass ** 2 * f])
    return A, C, Q, R, np.stack([np.zeros(4), mass * f * drive], axis=1)


def design_joint(levels, mass, settings, dt):
    """Design the unconstrained filter for all four states."""
    A, C, Q, R, S = joint_model(levels, mass, settings, dt)
    return stationary_filter(A, C, Q, R, S)
