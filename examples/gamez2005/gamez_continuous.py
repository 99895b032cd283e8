"""The continuous form of robot and tool that [Gamez2005] Eq. 30 prints, two signs corrected."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.impedance.plant import Plant
import numpy as np
from scipy.linalg import logm


class StateSpace(NamedTuple):
    """
    dX/dt = A X + B x_r, and C X are the positions of S and of the tool.

    Attributes
    ----------
    A : ndarray, shape (n, n)
    B : ndarray, shape (n,)
    C : ndarray, shape (2, n)
        States: n - 2 of the robot, position [m] and velocity [m/s] of the tool.
    """

    A: Array
    B: Array
    C: Array


def state_space(plant: Plant) -> StateSpace | None:
    """
    Give the continuous form that has the robot's samples, [Gamez2005] Eq. 30.

    The command holds for a period. Position and velocity of S, which drive the tool, are no
    states as in print but C x and C (A x + B x_r).

    Returns
    -------
    StateSpace or None
        None where the robot's difference equation has no continuous form: more delay than one
        period, or poles that are not positive.
    """
    robot, slide = plant.robot, plant.slide
    a, b = robot.feedback.value, robot.feedforward.value
    n = len(a)
    if robot.delay != 1 or len(b) > n:
        return None
    # controller form: the states are the last n values of command / denominator
    discrete = np.zeros((n + 1, n + 1))
    discrete[0, :n], discrete[1:n, :n - 1], discrete[0, n], discrete[n, n] = a, np.eye(n - 1), 1, 1
    if np.linalg.matrix_rank(discrete) <= n:
        return None
    continuous = np.asarray(logm(discrete)) / robot.period
    if np.abs(np.imag(continuous)).max() > 1e-6 * np.abs(continuous).max():
        return None
    A_r, B_r = np.real(continuous)[:n, :n], np.real(continuous)[:n, n]
    C_r = np.append(b, np.zeros(n - len(b)))
    m, k, d = float(slide.mass), float(slide.stiffness), float(slide.damping)
    A = np.zeros((n + 2, n + 2))
    A[:n, :n], A[n, n + 1] = A_r, 1.0
    A[n + 1] = np.concatenate([(k * C_r + d * (C_r @ A_r)) / m, [-k / m, -d / m]])
    B = np.concatenate([B_r, [0.0, d / m * (C_r @ B_r)]])
    C = np.zeros((2, n + 2))
    C[0, :n], C[1, n] = C_r, 1.0
    return StateSpace(A, B, C)
