"""The control law [Gamez2005] Eq. 31 with its estimator: one pure step, which never raises."""

from math import isfinite
from typing import NamedTuple, Protocol

from forcecal_ros.core.geometry import Array
import numpy as np


class Law(NamedTuple):
    """
    Everything the step needs in addition to its state; along x of ft_sensor, from the start.

    Attributes
    ----------
    period : float
        [s]
    A : ndarray, shape (n, n)
    B, F : ndarray, shape (n,)
        Of the process: what a command [m] and a force on the tool [N] do to the state.
    C : ndarray, shape (2, n)
        Rows that give the position of S and the tool's displacement against it [m].
    K : ndarray, shape (n, 2)
        Steady-state Kalman gain of the two measurements.
    L : ndarray, shape (n,)
        State gain.
    force_gain : float
        c of Eq. 31 [m/N].
    position_gain : float
        l_r of Eq. 31 [1].
    lead : float
        Target damping over stiffness: how far ahead the reference counts [s].
    """

    period: float
    A: Array
    B: Array
    F: Array
    C: Array
    K: Array
    L: Array
    force_gain: float
    position_gain: float
    lead: float


class State(NamedTuple):
    """
    State of the law; replace ``command`` where limits changed what was sent.

    Attributes
    ----------
    estimate : ndarray, shape (n,)
        Of the process at the last step.
    command, force, goal : float
        Those of the last step [m], [N], [m].
    """

    estimate: Array
    command: float = 0.0
    force: float = 0.0
    goal: float = 0.0


class Measurement(NamedTuple):
    """
    What one step is given, relative to the start, where everything rested at 0.

    Attributes
    ----------
    position : float
        Of S [m].
    slide : float
        The tool's displacement against S [m].
    force : float
        Contact force on the tool: a wall ahead pushes back, which is negative [N].
    """

    position: float
    slide: float
    force: float


def at_rest(law: Law) -> State:
    """Return the state of a law whose plant rests at 0, not in contact."""
    return State(np.zeros(len(law.B)))


def step(law: Law, state: State, measured: Measurement, position: float, velocity: float = 0.0
         ) -> State:
    """
    Take one control step, [Gamez2005] Eq. 31: u = -L X + c F + l_r x_r.

    X comes from the Kalman estimator. What is not finite is replaced: a measurement by the
    estimator's prediction, a force or a reference by the last one.

    Parameters
    ----------
    position, velocity : float
        Of the reference [m], [m/s].

    Returns
    -------
    State
        With the new command.
    """
    estimate = law.A @ state.estimate + law.B * state.command + law.F * state.force
    force = measured.force if isfinite(measured.force) else state.force
    goal = position + law.lead * velocity
    if not isfinite(goal):
        goal = state.goal
    error = np.array(measured[:2]) - law.C @ estimate
    estimate = estimate + law.K @ np.where(np.isfinite(error), error, 0.0)
    command = float(-law.L @ estimate + law.force_gain * force + law.position_gain * goal)
    return State(estimate, command, force, goal)


class Reference(NamedTuple):
    """Where the reference is [m], [m/s], from the start of the program, and in which phase."""

    position: float
    velocity: float
    phase: str


class Controller(Protocol):
    """One control step a period, along x of ft_sensor from the start."""

    def __call__(self, reference: Reference, measured: Measurement) -> float:
        """Return the command of S [m]."""

    def sent(self, command: float) -> None:
        """Take note of the command that was sent, which limits may have changed [m]."""


class Regulator:
    """The law as a controller, at rest at the start."""

    def __init__(self, law: Law) -> None:
        self._law, self._state = law, at_rest(law)

    def __call__(self, reference: Reference, measured: Measurement) -> float:
        """Return the command of S along x of ft_sensor, from the start [m]."""
        self._state = step(self._law, self._state, measured, reference.position,
                           reference.velocity)
        return self._state.command

    def sent(self, command: float) -> None:
        """Let the estimator predict with the command that was sent [m]."""
        self._state = self._state._replace(command=command)
