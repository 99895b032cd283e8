"""Output-error models of one order: the position as a response to the command alone."""

from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.signal import lfilter

_WEIGHTED_ROUNDS = 20
"""Most rounds of weighted least squares, which give the Gauss-Newton search its start."""

_NEWTON_ROUNDS = 30
"""Most Gauss-Newton steps."""

_STEPS = tuple(0.5**i for i in range(7))
"""Shares of a Gauss-Newton step that are tried in turn until one lowers the squared error."""

_CONVERGED = 1e-9
"""Relative change of the squared error below which a search ends."""

_NEGLIGIBLE = 1e-13
"""Relative singular value below which a direction of the parameters is not excited."""


class OutputError(NamedTuple):
    """
    y_k = sum_i feedback_i y_(k-i) + sum_i feedforward_i r_(k-delay-i+1), plus an offset.

    Attributes
    ----------
    delay : int
        [periods]
    feedback, feedforward : ndarray, shape (n,)
    offset : float
        Of the measured position [m].
    covariance : ndarray, shape (2 n, 2 n)
        Of feedback and feedforward, in this order.
    """

    delay: int
    feedback: Array
    feedforward: Array
    offset: float
    covariance: Array

    def predict(self, command: Array) -> Array:
        """
        Return the position that a command gives, from rest at 0.

        Parameters
        ----------
        command : ndarray, shape (n,)
            [m]

        Returns
        -------
        ndarray, shape (n,)
            [m]
        """
        return _respond(self.feedback, self.feedforward, self.delay, command) + self.offset


def fit_output_error(command: Array, position: Array, order: int, delay: int, used: Any
                     ) -> OutputError:
    """
    Fit a model whose error is that of the measured position, [Gamez2005] Eq. 28.

    Parameters
    ----------
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    order : int
        Number of poles, and of numbers in the numerator.
    delay : int
        Periods from a command to the first position that it changes.
    used : slice, or ndarray of bool, shape (n,)
        Samples whose errors count.

    Raises
    ------
    DataError
        No stable model of this order fits.
    """
    theta = _weighted_least_squares(command, position, order, delay, used)
    theta = _gauss_newton(theta, command, position, order, delay, used)
    return with_covariance(theta, command, position, delay, used)


def with_covariance(theta: Array, command: Array, position: Array, delay: int, used: Any,
                    unit_gain: bool = False) -> OutputError:
    """
    Return a model of given numbers, with the covariance that its error gives them.

    Parameters
    ----------
    theta : ndarray, shape (2 n + 1,)
        Feedback, feedforward, offset.
    command, position : ndarray, shape (n,)
        One sample a period, from rest at 0 [m].
    delay : int
        [periods]
    used : slice, or ndarray of bool, shape (n,)
        Samples whose errors count.
    unit_gain : bool
        Whether every model comes to rest at the command.
    """
    order = len(theta) // 2
    free = np.eye(len(theta))
    if unit_gain:  # the last number of the numerator makes up for the others
        free[2 * order - 1, :-1] = -1.0
        free = np.delete(free, 2 * order - 1, axis=1)
    residual = _residual(theta, command, position, order, delay)[used]
    jacobian = _jacobian(theta, command, order, delay)[used] @ free
    degrees = max(1, len(residual) - free.shape[1])
    scale = np.linalg.norm(jacobian, axis=0)
    inverse = free @ (np.linalg.pinv(jacobian / scale) / scale[:, np.newaxis])
    covariance = inverse @ inverse.T * (residual @ residual / degrees)
    return OutputError(delay, theta[:order], theta[order:-1], float(theta[-1]),
                       covariance[:-1, :-1])


def _respond(feedback: Array, feedforward: Array, delay: int, command: Array) -> Array:
    above = np.append(np.zeros(delay), feedforward)
    return np.asarray(lfilter(above, np.append(1.0, -feedback), command))


def delayed(signal: Array, first: int, count: int) -> Array:
    """Return columns of the signal delayed by first, first + 1, ... samples."""
    return np.stack([np.append(np.zeros(k), signal[:len(signal) - k])
                     for k in range(first, first + count)], axis=1)


def _weighted_least_squares(command: Array, position: Array, order: int, delay: int,
                            used: Any) -> Array:
    """Start: least squares of the equation error, filtered by the denominator found before."""
    feedback, theta, best = np.zeros(order), np.zeros(2 * order + 1), np.inf
    for _ in range(_WEIGHTED_ROUNDS):
        below = np.append(1.0, -feedback)
        y, r, one = (lfilter([1.0], below, signal)
                     for signal in (position, command, np.ones(len(position))))
        columns = np.column_stack([delayed(y, 1, order), delayed(r, delay, order), one])
        found = _solved(columns[used], y[used])
        feedback = _stabilised(found[:order])
        found[-1] /= 1.0 - feedback.sum()
        found[:order] = feedback
        cost = float(np.linalg.norm(_residual(found, command, position, order, delay)[used]))
        change, worst = best - cost, best
        if cost < best:
            theta, best = found, cost
        if np.isfinite(worst) and abs(change) <= _CONVERGED * worst:
            break
    return theta


def _solved(columns: Array, values: Array) -> Array:
    """Least squares of tall columns, scaled to the same length."""
    size = np.linalg.norm(columns, axis=0)
    reduced = np.linalg.qr(np.column_stack([columns / size, values]), mode='r')
    solution = np.linalg.lstsq(reduced[:, :-1], reduced[:, -1], rcond=_NEGLIGIBLE)[0]
    return np.asarray(solution / size)


def _stabilised(feedback: Array) -> Array:
    """Mirror poles outside the unit circle into it."""
    poles = np.roots(np.append(1.0, -feedback))
    size = np.abs(poles)
    if (size < 1.0).all():
        return feedback
    size = np.maximum(size, 1e-12)
    mirrored = np.where(size >= 1.0, poles / size * np.minimum(1.0 / size, 0.999), poles)
    return np.asarray(-np.real(np.poly(mirrored))[1:])


def _residual(theta: Array, command: Array, position: Array, order: int, delay: int) -> Array:
    explained = theta[-1] + _respond(theta[:order], theta[order:-1], delay, command)
    return np.asarray(position - explained)


def _gauss_newton(theta: Array, command: Array, position: Array, order: int, delay: int,
                  used: Any) -> Array:
    """Return the best parameters."""
    residual = _residual(theta, command, position, order, delay)[used]
    if not np.isfinite(residual).all():
        raise DataError(f'no stable model of order {order} fits; move more')
    for _ in range(_NEWTON_ROUNDS):
        change = _solved(_jacobian(theta, command, order, delay)[used], residual)
        cost = float(residual @ residual)
        for step in _STEPS:
            trial = theta + step * change
            new = _residual(trial, command, position, order, delay)[used]
            if _is_stable(trial[:order]) and new @ new < cost:
                theta, residual = trial, new
                break
        if cost - residual @ residual <= _CONVERGED * cost:
            break
    return theta


def _is_stable(feedback: Array) -> bool:
    return bool((np.abs(np.roots(np.append(1.0, -feedback))) < 1.0).all())


def _jacobian(theta: Array, command: Array, order: int, delay: int) -> Array:
    """Return the derivatives of the prediction, one column a parameter."""
    below = np.append(1.0, -theta[:order])
    r = lfilter([1.0], below, command)
    y = lfilter([1.0], below, _respond(theta[:order], theta[order:-1], delay, command))
    return np.column_stack([delayed(y, 1, order), delayed(r, delay, order),
                            np.ones(len(command))])
