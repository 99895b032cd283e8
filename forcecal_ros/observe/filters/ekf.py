"""The extended Kalman filter (EKF), which on linear functions is the exact one."""

from forcecal_ros.geometry import Array
from forcecal_ros.observe.filters.gaussian import condition, Expected, Function, Gaussian


def expect(belief: Gaussian, measurement: Function, R: Array) -> Expected:
    """Foretell a reading by the Jacobian at the mean; ``R`` (k, k) covariance of its noise."""
    H = measurement.jacobian(belief.mean)
    cross = belief.cov @ H.T
    return Expected(measurement.value(belief.mean), H @ cross + R, cross)


def update(belief: Gaussian, reading: Array, measurement: Function, R: Array) -> Gaussian:
    """Take in a reading (k,) whose noise has the covariance ``R`` (k, k)."""
    return condition(belief, expect(belief, measurement, R), reading)
