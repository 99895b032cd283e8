"""The control law [Gamez2005] Eq. 31: its design, known to be stable, and one run of it.

The cost of the linear-quadratic regulator is the impedance relation that the user states,

    e = M d2x/dt2 + D dx/dt + K (x - x_r) - f

of the tool's position x and the contact force f: driven to zero, the tool gives way as target.
Steady force and reference are exact by the choice of c and l_r. The step never raises.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Annotated, NamedTuple

from forcecal_ros.core.errors import ConfigError, UnobservableError
from forcecal_ros.core.estimation import stationary_gain
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import Row, Section
from forcecal_ros.impedance.plant import Plant, Process, process, Wall
import numpy as np
from scipy.linalg import solve, solve_discrete_are


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


class Reference(NamedTuple):
    """Where the reference is [m], [m/s], from the start of the program, and in which phase."""

    position: float
    velocity: float = 0.0
    phase: str = ''


class Regulator:
    """
    One run of the law [Gamez2005] Eq. 31, u = -L X + c F + l_r x_r.

    Along x of ft_sensor, from rest at the start and not in contact.

    Attributes
    ----------
    estimate : ndarray, shape (n,)
        Of the process at the last step.
    command, force, goal : float
        Those of the last step [m], [N], [m].
    """

    def __init__(self, law: Law) -> None:
        self._law = law
        self.estimate = np.zeros(len(law.B))
        self.command = self.force = self.goal = 0.0

    def __call__(self, reference: Reference, measured: Measurement) -> float:
        """
        Take one control step.

        X comes from the Kalman estimator. What is not finite is replaced: a measurement by the
        estimator's prediction, a force or a reference by the last one.

        Returns
        -------
        float
            Command of S [m].
        """
        law = self._law
        estimate = law.A @ self.estimate + law.B * self.command + law.F * self.force
        goal = reference.position + law.lead * reference.velocity
        self.force = measured.force if isfinite(measured.force) else self.force
        self.goal = goal if isfinite(goal) else self.goal
        error = np.array(measured[:2]) - law.C @ estimate
        self.estimate = estimate + law.K @ np.where(np.isfinite(error), error, 0.0)
        self.command = float(-law.L @ self.estimate + law.force_gain * self.force
                             + law.position_gain * self.goal)
        return self.command

    def sent(self, command: float) -> None:
        """Let the estimator predict with the command that was sent, which limits changed [m]."""
        self.command = command


@dataclass(frozen=True)
class TargetImpedance(Section, name='impedance'):
    """How the tool shall give way to a force, about its reference."""

    mass: Annotated[float, Row(
        'Mass of the target impedance, about the reference', 'kg', 0.1, 1e4)] = 13.0
    damping: Annotated[float, Row('Damping of the target impedance', 'N s/m', 0.1, 1e6)] = 250.0
    stiffness: Annotated[float, Row(
        'Stiffness of the target impedance', 'N/m', 0.1, 1e6)] = 1000.0


@dataclass(frozen=True)
class DesignSettings(Section, name='design'):
    """
    How the law is designed.

    Walls do not damp, which makes stiff ones the hardest to bear. Without a wall the loop always
    has to be stable.
    """

    effort: Annotated[float, Row(
        'Cost of a command that differs from its steady value; small against the stiffness',
        'N/m', 1e-3, 1e6)] = 100.0
    latency: Annotated[int, Row(
        "Control periods of delay beyond the robot's own, sensors included", low=0, high=50)] = 0
    force_lag: Annotated[float, Row(
        'Time constant of the contact force that is fed back', 's', above=0.0)] = 0.004
    wall_stiffness: Annotated[tuple[float, float], Row(
        'Softest and stiffest wall against which the loop must be stable', 'N/m', above=0.0)
        ] = (100.0, 20_000.0)
    state_gain: Annotated[tuple[float, ...] | None, Row('L, in place of the optimal one')] = None
    force_gain: Annotated[float | None, Row(
        'c of the control law; 0: that of a correct steady state', 'm/N', -1.0, 1.0)] = None
    position_gain: Annotated[float | None, Row(
        'l_r of the control law; 0: that of a correct steady state', '', -1e3, 1e3)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.wall_stiffness[0] > self.wall_stiffness[1]:
            raise self.wrong('wall_stiffness', 'the smaller number first')


class Loop(NamedTuple):
    """The loop opened at the command: x_(k+1) = A x_k + B u_k; C x_k would be commanded."""

    A: Array
    B: Array
    C: Array

    @property
    def radius(self) -> float:
        """Magnitude of the slowest eigenvalue of the closed loop; stable below 1."""
        return float(np.abs(np.linalg.eigvals(self.A + np.outer(self.B, self.C))).max())


def loop(law: Law, plant: Process, force_lag: float) -> Loop:
    """
    Connect law and plant, all but the command.

    Parameters
    ----------
    plant : Process
        With the wall that it touches, of the same states as the law's process.
    force_lag : float
        Time constant of the force fed back [s].

    Returns
    -------
    Loop
        States: of the plant, the force fed back, the estimator's prediction.
    """
    n = len(law.B)
    keep = np.exp(-law.period / force_lag)
    # the estimate is K C X + (1 - K C) Z, Z the prediction; c acts on the force fed back
    seen = law.K @ law.C
    estimate = np.hstack([seen, np.zeros((n, 1)), np.eye(n) - seen])
    force = np.eye(2 * n + 1)[n]
    commanded = -law.L @ estimate + law.force_gain * force
    plant_rows = np.hstack([plant.A, np.zeros((n, n + 1))])
    A = np.vstack([
        plant_rows,
        keep * force + (1.0 - keep) * (plant.wall @ plant_rows),
        law.A @ estimate + np.outer(law.B, commanded) + np.outer(law.F, force)])
    B = np.concatenate([plant.B, [(1.0 - keep) * (plant.wall @ plant.B)], np.zeros(n)])
    return Loop(A, B, commanded)


class Relation(NamedTuple):
    """The impedance relation as a row: e = X . C + D u + F f - K x_r, in N."""

    C: Array
    D: float
    F: float
    K: float


class Design(NamedTuple):
    """
    A law that is stable.

    Attributes
    ----------
    unstable_from : float
        Softest wall that makes it unstable; inf: none up to 1 MN/m does [N/m].
    """

    law: Law
    unstable_from: float


def design(plant: Plant, target: TargetImpedance = TargetImpedance(),
           settings: DesignSettings = DesignSettings()) -> Design:
    """
    Design the law [Gamez2005] Eq. 31 and check that it is stable.

    Raises
    ------
    ConfigError
        There is no optimal gain, or the loop is unstable without contact or against a wall of the
        stated range.
    """
    free = process(plant, settings.latency)
    law = _law(plant, free, target, settings)
    without = loop(law, free, settings.force_lag)
    if without.radius >= 1.0:
        raise ConfigError(
            f'the impedance loop is unstable without contact (eigenvalue of magnitude '
            f'{without.radius:.4f}, must be below 1); {_remedy(settings)}')
    unstable_from = _unstable_from(law, plant, settings)
    low, high = settings.wall_stiffness
    if unstable_from <= high:
        raise ConfigError(
            f'the impedance loop is unstable against a wall of {unstable_from:.0f} N/m, within '
            f'the stated range of {low:.0f} to {high:.0f} N/m; {_remedy(settings)}')
    return Design(law, unstable_from)


def _remedy(settings: DesignSettings) -> str:
    given = [f'design.{name}' for name in ('state_gain', 'force_gain')
             if getattr(settings, name) is not None]
    if given:
        return f'leave out {", ".join(given)}'
    return ('increase impedance.damping or impedance.mass, or decrease design.latency or the '
            'range of walls')


def _unstable_from(law: Law, plant: Plant, settings: DesignSettings) -> float:
    low, high = settings.wall_stiffness
    # stiffest wall for which stability is checked beyond the stated range [N/m]
    walls = {*np.geomspace(low, high, 60).tolist(), high,
             *np.geomspace(high, max(high, 1e6), 60).tolist()}

    def is_unstable(stiffness: float) -> bool:
        against = process(plant, settings.latency, Wall(stiffness))
        return loop(law, against, settings.force_lag).radius >= 1.0

    return next(filter(is_unstable, sorted(walls)), np.inf)


def relation(free: Process, target: TargetImpedance, period: float) -> Relation:
    """
    Write the impedance relation as a row of the process.

    The acceleration is the change of velocity over the period that follows, so that it needs no
    derivative of the position of S.

    Parameters
    ----------
    free : Process
        Without a wall.
    period : float
        [s]
    """
    inertia, v = target.mass / period, free.velocity
    return Relation(
        inertia * (v @ free.A - v) + target.damping * v + target.stiffness * free.tool,
        float(inertia * (v @ free.B)), float(inertia * (v @ free.F)) - 1.0, target.stiffness)


def _law(plant: Plant, free: Process, target: TargetImpedance, settings: DesignSettings) -> Law:
    e = relation(free, target, plant.robot.period)
    C = np.array([free.robot, free.tool - free.robot])
    try:
        L = _optimal_gain(free.A, free.B[:, np.newaxis], np.outer(e.C, e.C),
                          np.array([[e.D**2 + settings.effort**2]]), e.D * e.C[:, np.newaxis])
        K = _kalman_gain(free, C)
    except (ValueError, UnobservableError) as error:  # LinAlgError is a ValueError
        raise ConfigError(f'no optimal gain for this impedance: {error}; change '
                          'design.effort') from error
    L = np.ravel(L)
    if settings.state_gain is not None:
        if len(settings.state_gain) != len(L):
            raise ConfigError(f'design.state_gain has {len(settings.state_gain)} numbers; this '
                              f'plant has {len(L)} states')
        L = np.array(settings.state_gain)
    c, l_r = _steady_gains(free, e, L)
    return Law(plant.robot.period, free.A, free.B, free.F, C, K, L,
               c if settings.force_gain is None else settings.force_gain,
               l_r if settings.position_gain is None else settings.position_gain,
               target.damping / target.stiffness)


def _optimal_gain(A: Array, B: Array, Q: Array, R: Array, S: Array) -> Array:
    """Return the gain K of u = -K x with the least sum of x'Qx + u'Ru + 2 x'Su."""
    X = solve_discrete_are(A, B, Q, R, s=S)
    return np.asarray(solve(B.T @ X @ B + R, B.T @ X @ A + S.T))


def _kalman_gain(free: Process, C: Array) -> Array:
    """Return the gain of the steady-state Kalman filter by which a Regulator corrects."""
    # errors: of the contact force, white [N]; of the robot model, as white noise on its command,
    # and of the measured positions [m]
    force, command, position = 0.3, 1e-5, 2e-5
    G = np.column_stack([free.F * force, free.B * command]) / position
    return stationary_gain(free.A, C, G @ G.T, np.eye(2))


def _steady_gains(free: Process, e: Relation, L: Array) -> tuple[float, float]:
    """Return c and l_r that make e vanish at rest, for any force and reference."""
    n = len(L)
    rest = np.block([[free.A - np.eye(n), free.B[:, np.newaxis]], [e.C, e.D]])
    steady = np.linalg.solve(rest, -np.column_stack(
        [np.append(free.F, e.F), np.append(np.zeros(n), -e.K)]))
    c, l_r = steady[-1] + L @ steady[:-1]
    return float(c), float(l_r)
