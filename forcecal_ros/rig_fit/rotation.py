"""How orientation follows commands: a delay, a bandwidth and a damping on SO(3)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.effects.rig import Rig, Servo
from forcecal_ros.geometry import Array, rotation_vector
from forcecal_ros.rig_fit.grid import Followed
from forcecal_ros.rig_fit.translation import MOST_DELAY
from forcecal_ros.simulators.rig.plant import common_samples, Plant
import numpy as np
from scipy.optimize import least_squares

TURNED = 0.01
"""Turn of the commands from which orientation counts as moved [rad]: ten times a pose's noise."""

LIMITS = ((2.0, 0.3), (500.0, 3.0))
"""Bandwidth [rad/s] and damping that are tried: the integration is right within them."""

SHARES = (0.1, 0.5)
"""Of the lag that the search begins with as delay."""

COARSE = 0.001
"""Longest integration step while fitting [s]: half the fastest bandwidth times it is exact."""


class RotationFit(NamedTuple):
    """
    Orientation.

    Attributes
    ----------
    servo : Servo
    told : bool
        Whether it turned.
    lag : float
        From a slow command to the orientation [s].
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
        servo = replace(rig.servo, orientation_bandwidth=2.0 / max(lag, 2.0 * COARSE))
        return RotationFit(servo, False, lag)
    late = _shift(followed, round(MOST_DELAY / rig.robot.period)) * rig.robot.period
    late = max(late, rig.robot.period)
    best = min((_searched(rig, followed, share * late, (1.0 - share) * late)
                for share in SHARES), key=lambda one: float(one.cost))
    servo = _servo(rig, best.x)
    w, damping, delay = best.x
    return RotationFit(servo, True, float(delay + 2.0 * damping / w))


def _searched(rig: Rig, followed: Sequence[Followed], delay: float, rest: float) -> 'any':
    used = [one for one in followed if one.used.any()]

    def residual(x: Array) -> Array:
        changed = replace(rig, servo=_servo(rig, x))
        return np.concatenate([_centred(turned_apart(changed, one)[one.used]).ravel()
                               for one in used])

    (low_w, low_d), (high_w, high_d) = LIMITS
    start = [float(np.clip(2.0 / rest, low_w, high_w)), 1.0, delay]
    return least_squares(residual, start, bounds=([low_w, low_d, 0.0],
                                                  [high_w, high_d, MOST_DELAY]),
                         x_scale=[max(1.0, 0.1 * start[0]), 0.1, 0.002], diff_step=1e-3,
                         ftol=1e-7, xtol=1e-6, max_nfev=25)


def _servo(rig: Rig, x: Array) -> Servo:
    w, damping, delay = x.tolist()
    servo: Servo = replace(rig.servo, orientation_bandwidth=w, orientation_damping=damping,
                           orientation_delay=delay)
    return servo


def turned_apart(rig: Rig, one: Followed) -> Array:
    """Return the rotation from simulated to measured at each period's end, in S, shape (m, 3)."""
    common = common_samples(rig)
    plant = Plant(rig, steps=common * -(-int(np.ceil(rig.robot.period / COARSE)) // common))
    plant.rest(one.position[0], one.xyzw[0])
    every = 2 * plant.steps
    R = plant.move(one.position, one.xyzw).R_base_sensor[every::every]
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
