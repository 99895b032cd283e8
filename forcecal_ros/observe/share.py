"""How much of an accelerometer the force confirms, from a motion in which nothing touches."""

from dataclasses import replace

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
from forcecal_ros.observe.playback import replay
from forcecal_ros.observe.settings import ObserverSettings
from forcecal_ros.observe.weighing import JUDGED, SLOWEST
import numpy as np
from scipy.signal import lfilter

PARTS = 12
"""Parts of the motion that are left out in turn for the standard error."""

SURE = 3.0
"""A share is believed to be less than all where it is by so many standard errors."""

SETTLED = 0.15
"""What filters that begin need at 5 Hz, and poses for a first angular velocity [s]."""


def with_share(calibration: Calibration, motion: Recording) -> Calibration:
    """
    Return the calibration with the share of its accelerometer that counts on each axis.

    Parameters
    ----------
    calibration : Calibration
        With an accelerometer and its delay.
    motion : Recording
        With wrench, accelerometer and pose, in which nothing touches the tool.

    Returns
    -------
    Calibration
        As it was where the motion holds no pose or the accelerometer is AC-coupled, which is
        weighed by nothing; a share of 1 where the motion does not tell that it is less.
    """
    sensor = calibration.accelerometer
    if sensor is None or sensor.coupling == 'ac' or not (
            motion.pose and motion.accelerometer and motion.wrench):
        return calibration
    plain = replace(calibration, accelerometer=replace(sensor, share=None, level=None))
    moved, force = _below(plain, motion)
    if len(moved) < PARTS * PARTS:
        return calibration
    cross, power = (_sums(-force * moved), _sums(moved * moved))
    found = cross.sum(axis=0) / power.sum(axis=0)
    left_out = (cross.sum(axis=0) - cross) / (power.sum(axis=0) - power)
    std = np.sqrt((PARTS - 1) / PARTS * ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0))
    share = np.where(found + SURE * std < 1.0, np.clip(found, 0.0, 1.0), 1.0)
    return replace(calibration, accelerometer=replace(
        sensor, share=Estimate(share, std, '1'),
        level=Estimate(moved.std(axis=0), np.nan, 'm/s^2')))


def _below(calibration: Calibration, motion: Recording) -> tuple[Array, Array]:
    """Return what accelerometer and force over mass show beyond gravity, (n, 3) [m/s^2]."""
    by_it, by_pose = (replay(motion, calibration, ObserverSettings(name))
                      for name in ('kalman', 'static'))
    use = by_it.valid & by_pose.valid & (by_it.t > by_it.t[0] + SETTLED)
    mass, rate = float(calibration.mass), 1 / float(np.median(np.diff(by_it.t)))
    moved = (by_pose.inertial - by_it.inertial)[use, :3] / mass
    force = by_pose.measured[use, :3] / mass
    return _band(moved, rate), _band(force, rate)


def _band(values: Array, rate: float) -> Array:
    """Return values as ``weighing.weigh`` judges them, their mean taken off."""
    slowest, judged = 1 - np.exp(-1 / rate / SLOWEST), 1 - np.exp(-JUDGED / rate)
    values = values - values.mean(axis=0)
    values = values - lfilter([slowest], [1, slowest - 1], values, axis=0)
    for _ in range(2):
        values = lfilter([judged], [1, judged - 1], values, axis=0)
    return np.asarray(values - values.mean(axis=0))


def _sums(values: Array) -> Array:
    """Return the sums over equal parts, shape (PARTS, 3)."""
    n = len(values) // PARTS
    return np.asarray(values[:n * PARTS].reshape(PARTS, n, 3).sum(axis=1))
