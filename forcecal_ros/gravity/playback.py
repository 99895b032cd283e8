"""Gravity compensation over a recording, by the same steps as live."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from forcecal_ros.calibration.model import Accelerometer, Calibration
from forcecal_ros.errors import ConfigError, DataError, UnobservableError
from forcecal_ros.geometry import Array
from forcecal_ros.gravity.live import begin, on_sample
from forcecal_ros.observe.design import design
from forcecal_ros.observe.filters.bias_filter import Estimate
from forcecal_ros.observe.filters.bias_model import model_from_calibration
from forcecal_ros.observe.playback import answers
from forcecal_ros.observe.pose_free.model import Imu, pose_free_model
from forcecal_ros.observe.pose_free.step import pose_free_step, PoseFreeEstimate, PoseFreeState
from forcecal_ros.observe.settings import FilterSettings as Settings
from forcecal_ros.observe.settings import Settings as ObserverSettings
from forcecal_ros.recording.streams import Recording, Stream
import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int], object]


@dataclass(frozen=True)
class Compensated:
    """
    Gravity-compensated wrench over time; rows as in ``bias_filter.Estimate``.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Stamps of the wrench [s].
    wrench, std, bias, bias_std, correlation, innovation : ndarray, shape (n, 6)
        In ft_sensor, wire sign [N, N m].
    nis : ndarray, shape (n,)
    contact : ndarray of bool, shape (n,)
    status : ndarray of int, shape (n,)
    gravity : ndarray, shape (n, 3), or None
        In ft_sensor, where it was estimated [m/s^2].
    mass, mass_std : ndarray, shape (n,), or None
        Where it was estimated [kg].
    """

    t: Array
    wrench: Array
    std: Array
    bias: Array
    bias_std: Array
    correlation: Array
    innovation: Array
    nis: Array
    contact: NDArray[np.bool_]
    status: NDArray[np.int64]
    gravity: Array | None = None
    mass: Array | None = None
    mass_std: Array | None = None


def silent(samples: int) -> None:
    """Show no progress."""


def replay(recording: Recording, calibration: Calibration, settings: Settings = Settings(),
           observer: ObserverSettings = ObserverSettings(),
           progress: Progress = silent) -> Compensated:
    """
    Compensate a recording whose pose is known.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration
    settings : Settings
    observer : observe.Settings
        Of the observer that finds the load.
    progress : callable
        Told how many samples were done since it was told last.

    Returns
    -------
    Compensated

    Raises
    ------
    DataError
        The recording holds no wrench or no pose, or its accelerometer speaks another unit.
    ConfigError
        The calibration does not hold what the settings need.
    """
    _wrench(recording)
    if recording.pose is None or not len(recording.pose):
        raise DataError(f'{_name(recording)} holds no pose; name its topic by --topic pose=..., '
                        'or let an IMU find gravity (--orientation imu)')
    if recording.accelerometer is not None and calibration.accelerometer is not None:
        _check_unit(recording, calibration.accelerometer)
    model = model_from_calibration(calibration, settings, observer)
    live = begin(model)
    times: list[float] = []
    estimates: list[Estimate] = []
    for state, samples in answers(recording, design(calibration, observer)):
        for sample in samples:
            live, estimate = on_sample(live, sample, state.motion.rotation, model)
            times.append(sample.t)
            estimates.append(estimate)
        progress(len(samples))
    return _collect(times, estimates)


def replay_pose_free(recording: Recording, calibration: Calibration,
                     settings: Settings = Settings(), imu: Imu = Imu(),
                     progress: Progress = silent) -> Compensated:
    """
    Compensate a recording whose pose is unknown, by its accelerometer and gyro.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration
        Its accelerometer's map holds for the gyro too.
    settings : Settings
    imu : Imu
    progress : callable
        As for :func:`replay`.

    Returns
    -------
    Compensated
        With gravity and mass.

    Raises
    ------
    DataError
        The recording holds no wrench, or its accelerometer speaks another unit.
    UnobservableError
        It holds no accelerometer or no angular velocity.
    ConfigError
        The calibration does not hold what the settings need.
    """
    wrench = _wrench(recording)
    model = pose_free_model(calibration, settings, imu)
    force, omega = recording.accelerometer, recording.angular_velocity
    accelerometer = calibration.accelerometer
    if accelerometer is None or force is None or omega is None or not len(force) * len(omega):
        raise UnobservableError(
            f'{_name(recording)} tells gravity neither by a pose nor by accelerometer and '
            'angular velocity (sensor_msgs/Imu); record one of the two')
    _check_unit(recording, accelerometer)
    delay = float(accelerometer.delay)
    f = (force.at(wrench.t + delay) - accelerometer.offset.value) @ np.linalg.inv(
        accelerometer.matrix).T
    turning = omega.at(wrench.t + delay) @ axes_of(accelerometer)
    periods = np.diff(wrench.t, prepend=wrench.t[0] - model.wrench.covariances.period)
    state = PoseFreeState()
    estimates: list[PoseFreeEstimate] = []
    for row in zip(wrench.values, f, turning, periods.tolist()):
        state, estimate = pose_free_step(state, *row, model)
        estimates.append(estimate)
        progress(1)
    return _collect_pose_free(wrench.t, estimates)


def axes_of(accelerometer: Accelerometer) -> Array:
    """
    Rotation closest to the accelerometer's map, (3, 3), from ft_sensor to the IMU.

    Raises
    ------
    ConfigError
        The map is left-handed, as no gyro's axes are.
    """
    u, _, v = np.linalg.svd(accelerometer.map.value)
    if np.linalg.det(u @ v) < 0:
        raise ConfigError('the accelerometer map is left-handed, so the axes of its gyro are not '
                          'known; use an IMU whose axes are right-handed (REP-145)')
    return np.asarray(u @ v)


def _name(recording: Recording) -> str:
    return recording.source or 'the recording'


def _wrench(recording: Recording) -> Stream:
    if recording.wrench is None or not len(recording.wrench):
        raise DataError(f'{_name(recording)} holds no wrench; '
                        'name its topic by --topic wrench=...')
    return recording.wrench


def _check_unit(recording: Recording, accelerometer: Accelerometer) -> None:
    if recording.accelerometer_unit != accelerometer.unit:
        raise DataError(
            f'the accelerometer is recorded in {recording.accelerometer_unit}, the calibration '
            f'is for {accelerometer.unit}; calibrate with the same sensor')


def _collect(t: Sequence[float] | Array, estimates: Sequence[Estimate],
             **extra: Array) -> Compensated:
    columns = {name: np.array(column) for name, column in zip(Estimate._fields, zip(*estimates))}
    columns.update(extra, t=np.array(t))
    for column in columns.values():
        column.setflags(write=False)
    return Compensated(**columns)


def _collect_pose_free(t: Array, estimates: Sequence[PoseFreeEstimate]) -> Compensated:
    return _collect(t, [e.contact for e in estimates],
                    gravity=np.array([e.gravity for e in estimates]),
                    mass=np.array([e.mass for e in estimates]),
                    mass_std=np.array([e.mass_std for e in estimates]))
