"""Noise of the sensors from any recording, for calibrations that had no stretch at rest."""

from dataclasses import replace

from forcecal_ros.calibration.model import Calibration, Estimate, Noise
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.white import white_covariance
from forcecal_ros.recording.required import require
from forcecal_ros.recording.streams import Recording, Stream
import numpy as np

FEWEST = 100
"""Samples that a covariance is taken from: it is then known to 14 % in each direction."""


def white_noise(stream: Stream) -> Array:
    """
    Covariance (k, k) of the white part of a signal (n, k), motion or not.

    Raises
    ------
    DataError
        Fewer than 100 samples.
    """
    if len(stream) < FEWEST:
        raise DataError(f'{len(stream)} samples do not tell the noise; record {FEWEST} or more')
    return white_covariance(stream.values)


def with_noise(calibration: Calibration, recording: Recording) -> Calibration:
    """
    Return the calibration with the noise of wrench and accelerometer as this recording shows it.

    Q and R of [Gamez2005] stay unknown.

    Raises
    ------
    DataError
        The recording holds no wrench, or is too short.
    """
    wrench, force, sensor = recording.wrench, recording.accelerometer, calibration.accelerometer
    require(recording, ['wrench'])
    assert wrench is not None
    specific_force = None
    if force is not None and sensor is not None:
        inverse = np.linalg.inv(sensor.matrix)
        specific_force = Estimate(inverse @ white_noise(force) @ inverse.T, np.nan, '(m/s^2)^2')
    unknown = np.full((3, 3), np.nan)
    return replace(calibration, noise=Noise(
        Q=Estimate(unknown[:2, :2], np.nan, '(m, m/s)^2 s'),
        R=Estimate(unknown, np.nan, '(m, m/s, m/s^2)^2 s'),
        wrench=Estimate(white_noise(wrench), np.nan, '(N, N m)^2'),
        specific_force=specific_force, wrench_rate=wrench.rate,
        accelerometer_rate=force.rate if force is not None else float('nan')))
