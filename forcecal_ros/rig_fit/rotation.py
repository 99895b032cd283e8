"""How orientation follows commands: whole periods of delay, bandwidth and damping on SO(3)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.schema import Matrix3
from forcecal_ros.effects.rig import Rig, Servo
from forcecal_ros.rig_fit.grid import Followed
from forcecal_ros.rig_fit.translation import at_ends, COARSE, MOST_DELAY
import numpy as np
from scipy.optimize import least_squares, OptimizeResult

TURNED = 0.01
"""Turn of the commands from which orientation counts as moved [rad]: ten times a pose's noise."""

LIMITS = ((2.0, 0.3), (300.0, 3.0))
"""Bandwidth [rad/s] and damping that are tried: the integration is right within them."""

PATIENCE = 2
"""Longer delays, each worse than the best, that end the search for it."""


class RotationFit(NamedTuple):
    """
    Orientation.

    Attributes
    ----------
    servo : Servo
    told : bool
        Whether it turned.
    lag : float
        From the stamp of a slow command to the orientation [s].
    """

    servo: Servo
    told: bool
    lag: float


def fit_rotation(rig: Rig, followed: Sequence[Followed], lag: float) -> RotationFit:
    """
    Fit the orientation, output error on SO(3).

    Parameters
    ----------
    rig : Rig
        Its period counts.
    lag : float
        Of the position, taken where nothing turned [s].
    """
    turn = max(float(np.linalg.norm(_away(one), axis=1).max()) for one in followed)
    if turn < TURNED:
        rest = max(lag - rig.robot.period, 2.0 * COARSE)
        servo = replace(rig.servo, orientation_bandwidth=2.0 / rest)
        return RotationFit(servo, False, lag)
    late = _shift(followed, round(MOST_DELAY / rig.robot.period)) * rig.robot.period
    late = max(late, rig.robot.period)
    delay, best = _best(rig, followed, late)
    servo = replace(_servo(rig, best.x, delay), orientation_tolerance=_directions(best))
    w, damping = best.x
    return RotationFit(servo, True, float(rig.robot.period + delay + 2.0 * damping / w))


def _best(rig: Rig, followed: Sequence[Followed], late: float) -> tuple[float, OptimizeResult]:
    """Search bandwidth and damping for each delay, in whole periods, as long as it gets better."""
    period, found = rig.robot.period, []
    start = [2.0 / late, 1.0]
    for k in range(1 + round(MOST_DELAY / period)):
        found.append((k * period, _searched(rig, followed, k * period, start)))
        start = found[-1][1].x.tolist()
        costs = [float(one.cost) for _, one in found]
        if len(costs) - 1 - int(np.argmin(costs)) >= PATIENCE:
            break
    return min(found, key=lambda one: float(one[1].cost))


def _directions(best: OptimizeResult) -> Matrix3:
    """Return independent changes of bandwidth and damping, each 1 sigma; the delay's are 0."""
    scale = np.maximum(np.linalg.norm(best.jac, axis=0), 1e-12)
    variance = 2.0 * float(best.cost) / max(1, len(best.fun) - 2)
    inverse = np.linalg.pinv(best.jac / scale) / scale[:, np.newaxis]
    values, vectors = np.linalg.eigh(inverse @ inverse.T * variance)
    (a, b), (c, d) = ((vectors * np.sqrt(np.maximum(values, 0.0))).T).tolist()
    return (a, b, 0.0), (c, d, 0.0), (0.0, 0.0, 0.0)


def _searched(rig: Rig, followed: Sequence[Followed], delay: float, start: list[float]
              ) -> OptimizeResult:
    used = [one for one in followed if one.used.any()]

    def residual(x: Array) -> Array:
        changed = replace(rig, servo=_servo(rig, x, delay))
        return np.concatenate([_centred(turned_apart(changed, one)[one.used]).ravel()
                               for one in used])

    low, high = np.array(LIMITS)
    inside = np.clip(start, low + 0.01 * (high - low), high - 0.01 * (high - low))
    return least_squares(residual, inside, bounds=(low, high), x_scale=0.1 * inside,
                         diff_step=1e-3, ftol=1e-6, xtol=1e-5, max_nfev=20)


def _servo(rig: Rig, x: Array, delay: float) -> Servo:
    w, damping = x.tolist()
    servo: Servo = replace(rig.servo, orientation_bandwidth=w, orientation_damping=damping,
                           orientation_delay=delay)
    return servo


def turned_apart(rig: Rig, one: Followed) -> Array:
    """Return the rotation from simulated to measured at each period's end, in S, shape (m, 3)."""
    R = at_ends(rig, one).R_base_sensor
    return rotation_vector(np.swapaxes(R, 1, 2) @ one.R_reached)


def _centred(rows: Array) -> Array:
    return np.asarray(rows - rows.mean(axis=0))


def _away(one: Followed) -> Array:
    return rotation_vector(one.R_command[0].T @ one.R_command)


def _shift(followed: Sequence[Followed], most: int) -> int:
    def apart(k: int) -> float:
        return sum(float(np.square(rotation_vector(
            np.swapaxes(one.R_command[:len(one.R_command) - k:8], 1, 2) @ one.R_reached[k::8])
            ).sum()) for one in followed)
    return min(range(most + 1), key=apart)
