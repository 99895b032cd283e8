"""The Kalman filter: exact on linear functions, the extended filter (EKF) on others."""

from forcecal_ros.geometry import Array
from forcecal_ros.observe.filters.gaussian import condition, Expected, Function, Gaussian


def expect(belief: Gaussian, measurement: Function, R: Array) -> Expected:
    """
    Foretell a reading by the Jacobian at the mean.

    Parameters
    ----------
    belief : Gaussian
    measurement : Function
    R : ndarray, shape (k, k)
        Covariance of its noise.

    Returns
    -------
    Expected
    """
    H = measurement.jacobian(belief.mean)
    cross = belief.cov @ H.T
    return Expected(measurement.value(belief.mean), H @ cross + R, cross)


def update(belief: Gaussian, reading: Array, measurement: Function, R: Array) -> Gaussian:
    """
    Take in a reading.

    Parameters
    ----------
    belief : Gaussian
    reading : ndarray, shape (k,)
    measurement : Function
    R : ndarray, shape (k, k)

    Returns
    -------
    Gaussian
    """
    return condition(belief, expect(belief, measurement, R), reading)
