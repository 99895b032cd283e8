"""Output-error models whose poles a sampled continuous system can have.

A pole on the negative real axis, or one that hardly decays, fits noisy poses as well as another
where commands are smooth. But what it adds alternates from period to period, and micrometres of
that are newtons at the tool.
"""

from typing import Any, NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.impedance.plant.output_error import delayed, OutputError, with_covariance
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter


class _Number(NamedTuple):
    """What of the poles is searched for, by its logarithm."""

    low: float
    high: float
    starts: tuple[float, ...]


_FREQUENCY = _Number(1e-3, 2.0 * np.pi / 3.0, (0.3, 0.3, 0.8))
"""
Of a pair [rad/period]: from a thousand periods to a third of the commands' rate, near half of
which sampling hides it.
"""

_DAMPING = _Number(0.05, 30.0, (1.0, 4.0, 0.5))
"""Of a pair: an arm's structure has 0.05 and more, and 30 is two poles far from each other."""

_DECAY = _Number(1e-3, 8.0, (0.5, 3.0, 0.1))
"""Of a real pole [1/period]: from a thousand periods to one that is over within the period."""

_NUMBERS = {1: (_DECAY,), 2: (_FREQUENCY, _DAMPING), 3: (_FREQUENCY, _DAMPING, _DECAY)}
"""By order."""


def fit_damped(command: Array, position: Array, order: int, delay: int, used: Any) -> OutputError:
    """
    Fit a model that comes to rest at the command.

    The numerator follows from the poles by least squares, [Golub1973], so that only these are
    searched for, from three starts.

    Parameters
    ----------
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    order : int
        1 to 3.
    delay : int
        Periods from a command to the first position that it changes.
    used : slice, or ndarray of bool, shape (n,)
        Samples whose errors count.
    """
    numbers = _NUMBERS[order]
    unit = max(float(np.std(position[used])), np.finfo(float).tiny)

    def residual(x: Array) -> Array:
        return np.asarray(_numerator(_feedback(x), command, position, delay, used)[1][used] / unit)

    bounds = tuple(np.log([getattr(one, end) for one in numbers]) for end in ('low', 'high'))
    found = min((least_squares(residual, start, bounds=bounds)
                 for start in np.log([one.starts for one in numbers]).T), key=lambda one: one.cost)
    feedback = _feedback(found.x)
    rest, _ = _numerator(feedback, command, position, delay, used)
    return with_covariance(np.append(feedback, rest), command, position, delay, used,
                           unit_gain=True)


def _feedback(x: Array) -> Array:
    """Return the coefficients of y at k-1, k-2, ... of the logarithms of ``_NUMBERS``."""
    numbers = np.exp(x)
    poles = [-numbers[-1]] if len(x) != 2 else []
    if len(x) > 1:
        frequency, damping = numbers[:2]
        apart = np.sqrt(complex(damping ** 2 - 1.0))
        poles += [-frequency * (damping + apart), -frequency * (damping - apart)]
    return np.asarray(-np.real(np.poly(np.exp(poles)))[1:])


def _numerator(feedback: Array, command: Array, position: Array, delay: int, used: Any
               ) -> tuple[Array, Array]:
    """Return feedforward with the offset, and what they leave of the position."""
    order, gain = len(feedback), 1.0 - feedback.sum()
    columns = delayed(lfilter([1.0], np.append(1.0, -feedback), command), delay, order)
    # the last number makes the static gain 1
    free = np.column_stack([columns[:, :-1] - columns[:, -1:], np.ones(len(command))])
    wanted = position - gain * columns[:, -1]
    solution = np.linalg.lstsq(free[used], wanted[used], rcond=None)[0]
    rest = np.concatenate([solution[:-1], [gain - solution[:-1].sum()], solution[-1:]])
    return rest, np.asarray(wanted - free @ solution)
