"""Stability of the closed loop and its margins, without contact and against walls."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.impedance.law import Law
from forcecal_ros.impedance.plant.process import Process
import numpy as np

_FREQUENCIES = 600
"""Points of the frequency response that the margins are read from."""


class Loop(NamedTuple):
    """The loop opened at the command: x_(k+1) = A x_k + B u_k; C x_k would be commanded."""

    A: Array
    B: Array
    C: Array

    @property
    def radius(self) -> float:
        """Magnitude of the slowest eigenvalue of the closed loop; stable below 1."""
        return float(np.abs(np.linalg.eigvals(self.A + np.outer(self.B, self.C))).max())


class Margins(NamedTuple):
    """
    Margins of the loop, opened at the command.

    Attributes
    ----------
    wall_stiffness : float
        Of the wall in contact; 0: none [N/m].
    gain : float
        Factor on the command that makes it unstable; inf: none does.
    phase : float
        Lag or lead of the command that makes it unstable [rad]; inf: none does.
    modulus : float
        Least distance of the Nyquist curve from -1.
    radius : float
        Magnitude of the slowest eigenvalue of the closed loop.
    """

    wall_stiffness: float
    gain: float
    phase: float
    modulus: float
    radius: float


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


def margins(open_loop: Loop, period: float, wall_stiffness: float = 0.0) -> Margins:
    """
    Return the margins of a loop that is stable when closed.

    Parameters
    ----------
    period : float
        [s]
    wall_stiffness : float
        Of the wall in contact, for the record [N/m].
    """
    import control  # loads matplotlib too: seconds, which a node does not start with

    frequency = np.geomspace(0.1, 0.999 * np.pi / period, _FREQUENCIES)
    z = np.exp(1j * frequency * period)[:, np.newaxis, np.newaxis]
    states = np.linalg.solve(z * np.eye(len(open_loop.B)) - open_loop.A,
                             open_loop.B[:, np.newaxis].astype(complex))
    response = -(open_loop.C @ states)[:, 0]
    gains, phases, *_ = control.stability_margins(
        control.FrequencyResponseData(response, frequency, smooth=True), returnall=True)
    return Margins(wall_stiffness, float(min((g for g in gains if g > 1.0), default=np.inf)),
                   float(np.deg2rad(np.abs(phases)).min(initial=np.inf)),
                   float(np.abs(1.0 + response).min()), open_loop.radius)
