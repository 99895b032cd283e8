"""The accelerometer: which one was mounted, and its readings in the unit of its model."""

from dataclasses import replace

from forcecal_ros.calibration.model import Accelerometer
from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import Recording
import numpy as np


def as_specific_force(recording: Recording, accelerometer: Accelerometer | None) -> Recording:
    """
    Bring an accelerometer's readings to m/s^2 along the axes of ft_sensor.

    Parameters
    ----------
    accelerometer : Accelerometer or None
        As calibrated; without, its readings are left out.

    Raises
    ------
    DataError
        It was calibrated in another unit.
    """
    stream = recording.accelerometer
    if stream is None or accelerometer is None:
        return replace(recording, accelerometer=None)
    if recording.accelerometer_unit != accelerometer.unit:
        raise DataError(f'the accelerometer speaks {recording.accelerometer_unit}, it was '
                        f'calibrated in {accelerometer.unit}; calibrate with this one')
    f = np.linalg.solve(accelerometer.matrix,
                        (stream.values - accelerometer.offset.value).T).T
    return replace(recording, accelerometer=replace(stream, values=f),
                   accelerometer_unit='m/s^2')


def mounted(recording: Recording, rig: Rig) -> str:
    """Say which accelerometer was mounted: the one whose volts at the start fit better."""
    stream, name = recording.accelerometer, rig.accelerometer.mounted
    pose = recording.pose or recording.target
    if stream is None or recording.accelerometer_unit != 'V' or pose is None or not len(stream):
        return name
    first = stream.values[:max(1, int(0.3 * stream.rate))].mean(axis=0)
    up = -pose.R_base_sensor[0].T @ np.array(rig.gravity)

    def miss(candidate: str) -> float:
        model = rig.accelerometer.model(candidate)
        f = up if model.highpass == 0.0 else np.zeros(3)
        volts = np.array(model.gain) * f + model.offset
        return float(np.linalg.norm(first - volts))

    best = min(('acc1', 'acc2'), key=miss)
    return best if miss(best) < 0.5 * miss(name) else name


def in_volts(recording: Recording, rig: Rig, name: str) -> Recording:
    """
    Bring an accelerometer that speaks m/s^2 to volts.

    A driver that converts volts takes the rig's offset off; a sensor that speaks m/s^2 by itself
    does not know of it, and its readings hold it. What it says at the start tells which it is.
    """
    model, stream = rig.accelerometer.model(name), recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V' or not len(stream):
        return recording
    offset = np.array(model.offset)
    pose = recording.pose or recording.target
    if pose is not None and len(pose) and not model.highpass:
        first = stream.values[:max(1, int(0.3 * stream.rate))].mean(axis=0)
        rest = (first + pose.R_base_sensor[0].T @ np.array(rig.gravity)) * np.array(model.gain)
        if np.linalg.norm(rest - offset) < 0.5 * np.linalg.norm(rest):
            offset = np.zeros(3)
    return with_volts(recording, np.array(model.gain), offset)


def with_volts(recording: Recording, gain: Array, offset: Array) -> Recording:
    """Return volts where an accelerometer speaks m/s^2, by a gain and an offset."""
    stream = recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V':
        return recording
    return replace(recording, accelerometer=replace(stream, values=stream.values * gain + offset),
                   accelerometer_unit='V')
