"""A calibration as plain dicts, lists, numbers and words, and back, every key checked."""

from typing import Any

from forcecal_ros.calibration.model import Calibration, FORMAT
from forcecal_ros.errors import ConfigError
from forcecal_ros.schema import Mismatch, plain, read
import numpy as np


def to_document(calibration: Calibration) -> dict[str, Any]:
    """Return what ``calibration.yaml`` holds and ``--json`` prints, in the order of the file."""
    return {'format': FORMAT, **plain(calibration)}


def from_document(document: dict[str, Any], name: str) -> Calibration:
    """
    Turn what :func:`to_document` returns into a calibration again.

    ``name`` says where it is from, for messages.

    Raises
    ------
    ConfigError
        A key is missing, has the wrong shape or unit, or is not finite.
    """
    try:
        calibration = read(Calibration, document, extra=True)
        _check(calibration)
    except ConfigError as error:
        raise ConfigError(f'{name}: {error}; correct the file or calibrate again') from None
    return calibration


def _check(c: Calibration) -> None:
    """Refuse parts that are right by themselves but do not go together."""
    if c.accelerometer:
        if np.linalg.matrix_rank(c.accelerometer.matrix) < 3:
            raise ConfigError('accelerometer.gain times accelerometer.map is singular, expected '
                              'three independent axes of non-zero gain')
        if c.accelerometer.coupling == 'ac' and c.accelerometer.cutoff is None:
            raise Mismatch('accelerometer.cutoff', None, 'the corner [Hz] of an ac sensor')
    if c.gravity_direction is not None and abs(np.linalg.norm(c.gravity_direction) - 1.0) > 1e-3:
        raise Mismatch('gravity_direction', list(c.gravity_direction), 'a unit vector')
    mounting = c.sensor_from_pose
    if mounting is not None and abs(np.linalg.norm(mounting[3:]) - 1.0) > 1e-3:
        raise Mismatch('sensor.from_pose', list(mounting), 'a unit quaternion at its end')
    if c.matrix is not None:
        channels = c.matrix.value.shape[1]
        if c.matrix_offset is None or len(c.matrix_offset.value) != channels:
            found = None if c.matrix_offset is None else c.matrix_offset.value.tolist()
            raise Mismatch('matrix.offset', found, f'{channels} numbers, one of each column')
