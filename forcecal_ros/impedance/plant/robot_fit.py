"""The robot's model from commands and positions, its order chosen on held-out data."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.impedance.plant.model import Robot
from forcecal_ros.impedance.plant.output_error import fit_output_error, OutputError
import numpy as np

ORDERS = (1, 2, 3, 4, 5, 6)
"""Orders of the difference equation that are tried."""

DELAYS = (1, 2, 3)
"""Delays from command to position that are tried [periods]."""

SETTLING = 0.25
"""Start of a recording in which errors do not count, since the robot may have moved before [s]."""

HELD_OUT = 1.0 / 3.0
"""Last share of a recording, not fitted: it chooses the order and judges the model."""

FEWEST = 500
"""Fewest samples that a robot is identified from: 2 s at 250 Hz."""

CANCELLING = 0.05
"""A pole and a zero nearly cancel where they change the frequency response by less, relatively."""

_ROUNDING = 1e-12
"""Relative rounding error by which two exact models may differ."""


class Pair(NamedTuple):
    """
    A pole and a zero that nearly cancel.

    Attributes
    ----------
    pole, zero : complex
        In z.
    effect : float
        Most that the pair changes the frequency response, relative.
    """

    pole: complex
    zero: complex
    effect: float


class Order(NamedTuple):
    """One order that was tried: its best delay, and the RMS error on what was held out [m]."""

    order: int
    delay: int
    error: float


class RobotFit(NamedTuple):
    """
    An identified robot.

    Attributes
    ----------
    offset : float
        Of the measured against the commanded position [m].
    fit : float
        1 - RMS error / RMS of the position about its mean, held out; 1 is perfect.
    error : float
        RMS error held out [m].
    pairs : tuple of Pair
        Poles and zeros of the model that nearly cancel.
    """

    robot: Robot
    offset: float
    fit: float
    error: float
    orders: tuple[Order, ...]
    pairs: tuple[Pair, ...]


class Candidate(NamedTuple):
    """The best model of one order, and its squared errors on what was held out [m^2]."""

    order: int
    model: OutputError
    squares: Array

    @property
    def error(self) -> float:
        """RMS on what was held out [m]."""
        return float(np.sqrt(self.squares.mean()))


def identify_robot(command: Array, position: Array, period: float, *,
                   orders: Sequence[int] = ORDERS, delays: Sequence[int] = DELAYS) -> RobotFit:
    """
    Identify the robot as output-error model, [Gamez2005] Eq. 28.

    Of each order the best delay is taken; of the orders the smallest one whose error on the
    data held out is no greater than the least one, as far as its standard error tells.

    Parameters
    ----------
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    period : float
        [s]
    orders, delays : sequence of int
        To choose from.

    Raises
    ------
    DataError
        Too few samples, no motion, or no model that fits.
    """
    n = len(command)
    if n < FEWEST or not np.ptp(command) > 0.0 or not np.ptp(position) > 0.0:
        raise DataError(f'{n} commands over {1e3 * np.ptp(command) if n else 0.0:.3g} mm do not '
                        f"tell the robot's model; record {FEWEST} or more that move it")
    held_out = slice(round(n * (1.0 - HELD_OUT)), n)
    used = slice(round(SETTLING / period), held_out.start)
    candidates = [min((judged(
        fit_output_error(command, position, order, delay, used), order, command, position,
        held_out) for delay in delays), key=lambda one: one.error) for order in orders]
    chosen = _smallest_of_the_best(candidates, float(np.mean(position**2)))
    model, order = chosen.model, chosen.order
    std = np.sqrt(np.diag(model.covariance))
    robot = Robot(period, model.delay, Estimate(model.feedback, std[:order], '1'),
                  Estimate(model.feedforward, std[order:], '1'))
    error = chosen.error
    return RobotFit(
        robot, model.offset, 1.0 - error / float(np.std(position[held_out])), error,
        tuple(Order(c.order, c.model.delay, c.error) for c in candidates),
        cancelling_pairs(robot))


def judged(model: OutputError, order: int, command: Array, position: Array, held_out: Any
           ) -> Candidate:
    """Judge a model on what was held out, a slice or an ndarray of bool."""
    return Candidate(order, model, (position - model.predict(command))[held_out]**2)


def _smallest_of_the_best(candidates: Sequence[Candidate], power: float) -> Candidate:
    """
    Return the smallest order that is no worse than the best as far as standard errors tell.

    Parameters
    ----------
    power : float
        Mean square of the position [m^2], whose rounding does not count.
    """
    best = min(candidates, key=lambda one: one.error)
    for candidate in candidates:
        worse = candidate.squares - best.squares
        chance = float(np.std(worse)) / np.sqrt(len(worse)) + _ROUNDING**2 * power
        if float(worse.mean()) <= chance:
            return candidate
    return best


def cancelling_pairs(robot: Robot) -> tuple[Pair, ...]:
    """
    Return the poles and zeros that nearly cancel.

    A pair changes the frequency response by |pole - zero| / |z - pole|, which on the unit
    circle is at most |pole - zero| / (1 - |pole|).
    """
    pairs = []
    for pole in robot.poles:
        if len(robot.zeros):
            zero = min(robot.zeros, key=lambda z: abs(z - pole))
            effect = float(abs(pole - zero) / (1.0 - abs(pole)))
            if effect < CANCELLING:
                pairs.append(Pair(complex(pole), complex(zero), effect))
    return tuple(pairs)
