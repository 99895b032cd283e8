"""
Delay between the sensors from free motion, for a calibration that holds none.

One from a recording with motion knows its delay already
(:mod:`forcecal_ros.calibrate.accelerometer`).
"""

from dataclasses import replace

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.core.time_grid import Averager, block_length
import numpy as np


def estimate_delay(recording: Recording, calibration: Calibration) -> Estimate:
    """
    Find the delay that makes force and acceleration of a free motion agree, u = m (a - g).

    Both are averaged over the same blocks, the accelerometer's shifted by the delay; what is
    constant in the residual, a bias that moved, does not count. The lever arm between
    accelerometer and centre of mass is taken to be zero, which shifts the delay of pure rotation.

    Parameters
    ----------
    recording : Recording
        With wrench and accelerometer, of motion in which nothing touches the tool.
    calibration : Calibration
        Mass, biases and accelerometer are used.

    Returns
    -------
    Estimate
        How much later than the wrench the accelerometer shows the same instant [s]; its standard
        error of parts of the motion.

    Raises
    ------
    DataError
        A sensor is missing, the recording is too short, or its motion does not tell.
    """
    wrench, accelerometer = recording.wrench, recording.accelerometer
    if wrench is None or accelerometer is None or calibration.accelerometer is None:
        raise DataError('the delay requires wrench and accelerometer, recorded and calibrated')
    known = calibration.accelerometer
    f = np.linalg.solve(known.matrix, (accelerometer.values - known.offset.value).T).T
    force, pull = wrench, Stream(accelerometer.t, f)
    # length of the blocks that are averaged, longer where a sensor is slow [s]
    shortest = 0.02
    length = block_length(shortest, 1 / wrench.rate, 1 / accelerometer.rate)
    # greatest delay looked for, either way; real pairs of sensors were 6 to 9 ms apart [s]
    largest = 0.02
    first = max(force.t[0], pull.t[0] + largest) if len(force) else 0.0
    last = min(force.t[-1], pull.t[-1] - largest) if len(force) else 0.0
    starts = np.arange(first, last - length, length / 2)
    # parts of the motion that are taken as independent of each other for the standard error
    parts = 12
    if len(starts) < 4 * parts:
        raise DataError(f'{len(starts)} blocks of {1e3 * length:.0f} ms of free motion are '
                        f'too few to estimate the delay; record at least {4 * parts}')
    F = Averager(force.t, force.values[:, :3]).means(starts, length)
    averager, mass = Averager(pull.t, f), float(calibration.mass)

    def residual(delay: float) -> Array:
        r = F + mass * averager.means(starts + delay, length)
        return np.asarray(r - np.nanmean(r, axis=0))

    # between the delays that are tried before the best one is refined [s], and steps of that
    step, iterations = 1e-3, 4
    grid = np.arange(-largest, largest + step / 2, step)
    best = float(min(grid, key=lambda delay: float(np.nansum(residual(delay)**2))))
    for _ in range(iterations):
        left = residual(best)
        slope = (residual(best + step / 2) - residual(best - step / 2)) / step
        good = np.isfinite(left + slope).all(axis=1)
        columns = np.insert(np.broadcast_to(np.eye(3), (len(left), 3, 3)), 0, -slope, axis=2)
        fit = robust_fit(columns[good], left[good], blocks=parts)
        best += float(fit.theta[0])
    variance = float(fit.covariance[0, 0])
    moved = float(np.nansum((F - np.nanmean(F, axis=0)) ** 2))
    explained = 1 - float(np.nansum(residual(best) ** 2)) / moved
    if explained < 0.5 or abs(best) > largest - step or variance > (largest / 10) ** 2:
        raise DataError(
            'the motion does not identify the delay: estimate '
            f'{quantity(best, variance ** 0.5, "s")}, limit {1e3 * largest:.0f} ms, and '
            f'{100 * explained:.0f} % of the force explained; move faster and without contact')
    return Estimate(best, np.sqrt(variance), 's')


def with_delay(calibration: Calibration, delay: Estimate) -> Calibration:
    """
    Return the calibration with another delay of its accelerometer.

    Parameters
    ----------
    calibration : Calibration
        With an accelerometer.
    delay : Estimate
        [s]
    """
    if calibration.accelerometer is None:
        raise DataError('the calibration has no accelerometer, so no delay can be set')
    return replace(calibration, accelerometer=replace(calibration.accelerometer, delay=delay))
