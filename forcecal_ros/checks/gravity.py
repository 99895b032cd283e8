"""Whether an accelerometer shows gravity as pose and calibration say, and a wrench its tool."""

from forcecal_ros.checks.hypotheses import (
    corrected,
    judge,
    Known,
    MIN_GRAVITY_SPREAD,
    refuse_late_accelerometer,
)
from forcecal_ros.checks.messages import Stated
from forcecal_ros.core.axes import DOWN
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
from forcecal_ros.core.streams import Recording
import numpy as np

_ACCELERATIONS = {'g': 1.0 / STANDARD_GRAVITY, 'mg': 1e3 / STANDARD_GRAVITY, 'mm/s^2': 1e3}
"""Units that drivers send instead of m/s^2: how many of them one m/s^2 is."""

OTHER_UNIT, GRAVITY_OFF, NO_GRAVITY = 2.0, 0.2, 0.05
"""Gravity at rest off by the first factor is another unit, to the second share, by which a
calibrated sensor is not as it was: offsets wander by a hundredth. Less than the third is an offset
alone: sensors that are not calibrated have 1 m/s^2 and gains 10 % off."""


def refuse_other_unit(at_rest: Array, gravity: float, decays: bool = False) -> None:
    """
    Refuse an accelerometer that says m/s^2 and at rest does not show gravity.

    Parameters
    ----------
    at_rest : ndarray, shape (n, 3)
        Means of static poses, as recorded.
    gravity : float
        Magnitude [m/s^2].
    decays : bool
        Whether readings drift while the robot stands, as behind a high-pass.

    Raises
    ------
    DataError
        Names the unit that the readings are in, and the remedy.
    """
    shown = float(np.median(np.linalg.norm(at_rest, axis=1)))
    share = shown / gravity
    if 1.0 / OTHER_UNIT < share < OTHER_UNIT:
        return
    found = f'accelerometer: it reads {shown:.3g} at rest, expected {gravity:.3g} m/s^2 (gravity)'
    for unit, scale in _ACCELERATIONS.items():
        if abs(share / scale - 1.0) < GRAVITY_OFF:
            raise DataError(f'{found}: it is in {unit}; {corrected(1.0 / scale, unit)}')
    if share < NO_GRAVITY and decays:
        raise DataError(f'{found}, and decays at standstill: the sensor is AC-coupled; pass '
                        '--coupling ac')
    if share < NO_GRAVITY:
        raise DataError(f'{found}, and stays there: the driver subtracts gravity; configure it to '
                        'publish specific force (REP-145)')
    raise DataError(f'{found}: no known unit explains it, so its gain is wrong; divide by '
                    f'{share:.3g} in the driver')


def refuse_on_another_link(at_rest: Array, gravity: Array) -> None:
    """
    Refuse an accelerometer in which gravity does not turn as the pose turns it.

    Parameters
    ----------
    at_rest, gravity : ndarray, shape (n, 3)
        Means of static poses, and gravity there by the pose [m/s^2].

    Raises
    ------
    DataError
        Says how little it turns.
    """
    shown, expected = (float(np.linalg.norm(x.std(axis=0))) for x in (at_rest, gravity))
    g = float(np.linalg.norm(gravity, axis=1).mean())
    if expected > MIN_GRAVITY_SPREAD * g and shown < 0.5 * expected:
        raise DataError(
            f'accelerometer: its readings at rest vary by {shown:.2g} m/s^2, expected '
            f'{expected:.2g} m/s^2 from the rotation of the pose: it is not mounted on the tool; '
            'select another one with --topic accelerometer=NAME')


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
        'accelerometer: its calibrated reading is '
        f'{float(np.median(np.linalg.norm(shown, axis=1))):.3g} m/s^2 and differs by {off:.3g} '
        f'm/s^2 from gravity in the pose ({g:.3g} m/s^2): its unit or mounting has changed, or it '
        'is on another link; calibrate again')
