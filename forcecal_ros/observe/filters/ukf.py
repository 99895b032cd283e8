"""The unscented Kalman filter of [Ukf2025], its sigma points in a form that keeps its digits.

[Ukf2025] sets alpha = 0.001, beta = 2, kappa = 0, which puts the sigma points a few thousandths
of a standard deviation from the mean and gives the centre the weight -10^6: the textbook sums
lose six to seven digits to it. Summed by pairs the weights are harmless. With h = alpha
sqrt(n + kappa), columns L_i of the Cholesky factor, and for each pair

    D_i = [y(x + h L_i) - y(x - h L_i)] / 2h
    C_i = [y(x + h L_i) + y(x - h L_i) - 2 y(x)] / 2h

the same transform, term by term, is

    mean = y(x) + m,  m = sum_i C_i / h
    P_yy = sum_i (D_i D_i^T + C_i C_i^T) + (beta - alpha^2) m m^T
    P_xy = sum_i L_i D_i^T

and the differences come from :attr:`Function.difference`, which never subtracts large numbers.
"""

from math import sqrt

from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.filters.gaussian import cholesky, condition, Expected, Function, Gaussian
from forcecal_ros.observe.settings import PAPER_SCALING, Scaling
import numpy as np


def weights(n: int, scaling: Scaling = PAPER_SCALING) -> tuple[float, float, float]:
    """Return w_0^(m), w_0^(c), w_i of n states as [Ukf2025] prints them, to look at."""
    lam = scaling.alpha ** 2 * (n + scaling.kappa) - n
    centre = lam / (n + lam)
    return centre, centre + 1 - scaling.alpha ** 2 + scaling.beta, 0.5 / (n + lam)


def transform(belief: Gaussian, function: Function,
              scaling: Scaling = PAPER_SCALING) -> Expected:
    """
    Pass a belief through a function by its 2 n + 1 sigma points, without noise.

    Raises
    ------
    NotPositiveDefinite
        The belief's covariance is none.
    """
    mean = belief.mean
    factor = cholesky(belief.cov)
    h = scaling.alpha * sqrt(len(mean) + scaling.kappa)
    offsets = h * factor.T
    moved = function.difference(mean, np.concatenate([offsets, -offsets]))
    plus, minus = moved[:len(mean)], moved[len(mean):]
    D = (plus - minus) * (0.5 / h)
    C = (plus + minus) * (0.5 / h)
    centre, cov = function.value(mean), D.T @ D
    if np.count_nonzero(C):
        shift = C.sum(axis=0) / h
        centre = centre + shift
        cov = cov + C.T @ C + (scaling.beta - scaling.alpha ** 2) * np.outer(shift, shift)
    return Expected(centre, cov, factor @ D)


def expect(belief: Gaussian, measurement: Function, R: Array,
           scaling: Scaling = PAPER_SCALING) -> Expected:
    """Foretell a reading by sigma points; ``R`` (k, k) is the covariance of its noise."""
    mean, cov, cross = transform(belief, measurement, scaling)
    return Expected(mean, cov + R, cross)


def update(belief: Gaussian, reading: Array, measurement: Function, R: Array) -> Gaussian:
    """
    Take in a reading (k,) whose noise has the covariance ``R`` (k, k).

    On a linear measurement the outcome is the Kalman filter's, to rounding: there is nothing an
    unscented transform could add.
    """
    return condition(belief, expect(belief, measurement, R), reading)
