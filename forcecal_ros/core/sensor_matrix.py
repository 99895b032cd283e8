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
    """Matrix, row by row, and offset of a sensor whose driver publishes six raw channels."""

    matrix: tuple[float, ...]
    offset: Wrench


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
    o = offset.tolist()
    return SensorMatrix(tuple(matrix.ravel().tolist()), (o[0], o[1], o[2], o[3], o[4], o[5]))


def corrected(raw: Wrench, part: SensorMatrix) -> Wrench:
    """
    Apply the matrix to one reading.

    Parameters
    ----------
    raw : tuple of 6 float
        As the driver publishes it.

    Returns
    -------
    tuple of 6 float
        [N], [N m].
    """
    m, o = part
    a, b, c = raw[0] - o[0], raw[1] - o[1], raw[2] - o[2]
    d, e, f = raw[3] - o[3], raw[4] - o[4], raw[5] - o[5]
    return (m[0] * a + m[1] * b + m[2] * c + m[3] * d + m[4] * e + m[5] * f,
            m[6] * a + m[7] * b + m[8] * c + m[9] * d + m[10] * e + m[11] * f,
            m[12] * a + m[13] * b + m[14] * c + m[15] * d + m[16] * e + m[17] * f,
            m[18] * a + m[19] * b + m[20] * c + m[21] * d + m[22] * e + m[23] * f,
            m[24] * a + m[25] * b + m[26] * c + m[27] * d + m[28] * e + m[29] * f,
            m[30] * a + m[31] * b + m[32] * c + m[33] * d + m[34] * e + m[35] * f)


def all_corrected(raw: Array, part: SensorMatrix) -> Array:
    """
    Apply the matrix to readings in rows.

    Parameters
    ----------
    raw : ndarray, shape (n, 6)

    Returns
    -------
    ndarray, shape (n, 6)
        [N], [N m].
    """
    return np.asarray((raw - part.offset) @ np.reshape(part.matrix, (6, 6)).T)


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
