"""The unscented Kalman filter of [Ukf2025] as pure functions of (mean, cov)."""

from forcecal_ros.geometry import Array
from forcecal_ros.observe.filters.gaussian import condition, Expected, Function, Gaussian
from forcecal_ros.observe.filters.sigma_points import PAPER_SCALING, Scaling, transform


def expect(belief: Gaussian, measurement: Function, R: Array,
           scaling: Scaling = PAPER_SCALING) -> Expected:
    """
    Foretell a reading by sigma points.

    Parameters
    ----------
    belief : Gaussian
    measurement : Function
    R : ndarray, shape (k, k)
        Covariance of its noise.
    scaling : Scaling

    Returns
    -------
    Expected
    """
    mean, cov, cross = transform(belief, measurement, scaling)
    return Expected(mean, cov + R, cross)


def update(belief: Gaussian, reading: Array, measurement: Function, R: Array,
           scaling: Scaling = PAPER_SCALING) -> Gaussian:
    """
    Take in a reading.

    On a linear measurement the outcome is the Kalman filter's, to rounding: there is nothing an
    unscented transform could add.

    Parameters
    ----------
    belief : Gaussian
    reading : ndarray, shape (k,)
    measurement : Function
    R : ndarray, shape (k, k)
    scaling : Scaling

    Returns
    -------
    Gaussian
    """
    return condition(belief, expect(belief, measurement, R, scaling), reading)
