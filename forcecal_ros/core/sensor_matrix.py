"""A six-axis calibration applied: wrench = matrix (raw - offset), [Traversaro2014] Eq. 2."""

from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording, Stream
import numpy as np

Wrench = tuple[float, float, float, float, float, float]


class SensorMatrix(NamedTuple):
    """Matrix (6, 6) and offset (6,) of a sensor whose driver publishes six raw channels."""

    matrix: Array
    offset: Array


def sensor_matrix(calibration: Calibration) -> SensorMatrix | None:
    """
    Return the six-axis part of a calibration, for use on a WrenchStamped.

    Returns
    -------
    SensorMatrix or None
        None where there is none: the readings are wrenches already.

    Raises
    ------
    ConfigError
        The matrix is for another number of channels than a wrench has.
    """
    if calibration.matrix is None or calibration.matrix_offset is None:
        return None
    matrix, offset = calibration.matrix.value, calibration.matrix_offset.value
    if matrix.shape != (6, 6):
        raise ConfigError(f'matrix is {matrix.shape[0]} x {matrix.shape[1]}; a wrench topic '
                          'carries six raw channels, so 6 x 6 is required')
    return SensorMatrix(matrix, offset)


def corrected(raw: Wrench, part: SensorMatrix) -> Wrench:
    """Apply the matrix to one reading as the driver publishes it; [N], [N m]."""
    a, b, c, d, e, f = all_corrected(np.array(raw), part).tolist()
    return a, b, c, d, e, f


def all_corrected(raw: Array, part: SensorMatrix) -> Array:
    """
    Apply the matrix to one reading, or to several in rows.

    Parameters
    ----------
    raw : ndarray, shape (6,) or (n, 6)
        As the driver publishes them.

    Returns
    -------
    ndarray, shape (6,) or (n, 6)
        [N], [N m].
    """
    return np.asarray((raw - part.offset) @ part.matrix.T)


def recording_corrected(recording: Recording, part: SensorMatrix) -> Recording:
    """
    Apply the matrix to the wrench of a recording.

    Parameters
    ----------
    recording : Recording
        Its wrench holds the raw channels.
    """
    raw = recording.wrench
    if raw is None:
        return recording
    return replace(recording, wrench=Stream(raw.t, all_corrected(raw.values, part), raw.frame))


def with_matrix_of(calibration: Calibration, source: Calibration) -> Calibration:
    """
    Return a calibration that takes raw channels by the matrix of another.

    Parameters
    ----------
    calibration : Calibration
        Identified from corrected wrenches.
    source : Calibration
        Whose matrix corrected them.
    """
    return replace(calibration, matrix=source.matrix, matrix_offset=source.matrix_offset)


def required_sensor_matrix(source: Calibration, name: str) -> SensorMatrix:
    """
    Return the six-axis part of a calibration that was named for it.

    Parameters
    ----------
    name : str
        Of its file, for messages.

    Raises
    ------
    ConfigError
        It holds none, or one of another number of channels.
    """
    part = sensor_matrix(source)
    if part is None:
        raise ConfigError(f'{name}: has no key matrix; pass the calibration.yaml that `forcecal '
                          'insitu` wrote')
    return part
