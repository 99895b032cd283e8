"""Whether a calibration belongs to a recording."""

from forcecal_ros.checks.hypotheses import judge, Known, refuse_late_accelerometer
from forcecal_ros.checks.messages import Stated
from forcecal_ros.core.axes import DOWN
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Recording
import numpy as np

GRAVITY_OFF = 0.2
"""An accelerometer that shows gravity off by this share of it is not as it was calibrated:
offsets wander by a hundredth."""


def refuse_disagreeing(recording: Recording, calibration: Calibration) -> tuple[str, ...]:
    """
    Refuse a recording whose sensors are in other axes or units than those calibrated.

    Parameters
    ----------
    recording : Recording
        In the axes of the calibration.

    Returns
    -------
    tuple of str
        What weighs or pulls that the calibration does not know.

    Raises
    ------
    DataError
        Names cause and remedy, as ``forcecal calibrate`` does.
    """
    if calibration.accelerometer is not None and calibration.accelerometer.coupling == 'dc':
        refuse_late_accelerometer(recording, calibration.gravity * DOWN)
        _refuse_other_gravity(recording, calibration)
    return judge(recording, calibration.gravity * DOWN, Stated(
        DOWN, calibration.wrench_sign, calibration.sensor_rotation, calibration.sensor_from_pose,
        'calibration'), Known(float(calibration.mass), calibration.com.value,
                              calibration.wrench_bias.value))


def _refuse_other_gravity(recording: Recording, calibration: Calibration) -> None:
    """Refuse an accelerometer that shows gravity elsewhere than the pose and its calibration."""
    stream, sensor, pose = recording.accelerometer, calibration.accelerometer, recording.pose
    if stream is None or sensor is None or pose is None or (
            recording.accelerometer_unit != sensor.unit or min(len(stream), len(pose)) < 12):
        return
    t = pose.t[np.linspace(0, len(pose) - 1, min(2000, len(pose))).astype(int)]
    rows = np.searchsorted(pose.t, t)
    shown = (stream.at(t) - sensor.offset.value) @ np.linalg.inv(sensor.matrix).T
    g = calibration.gravity
    off = float(np.median(np.linalg.norm(shown - g * pose.R_base_sensor[rows, 2], axis=1)))
    if off < GRAVITY_OFF * g:
        return
    raise DataError(
        'accelerometer: by the calibration it shows '
        f'{float(np.median(np.linalg.norm(shown, axis=1))):.3g} m/s^2, {off:.3g} m/s^2 off the '
        f'{g:.3g} m/s^2 of gravity as the pose turns it: its unit or its mount is another than '
        'calibrated, or it hangs on another link; calibrate again with the sensor as it is')
