"""The package from Python: ``import forcecal_ros as fc``, then ``fc.read``, ``fc.calibrate``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from forcecal_ros import results
from forcecal_ros.core.streams import Recording
from forcecal_ros.results import check, load, Recorded, Result, save

__all__ = ['calibrate', 'check', 'diagnose', 'estimate', 'load', 'read', 'save', 'simulate']


def read(bag: str | Path, *, topics: Mapping[str, str] | None = None, preset: str = '',
         wrench_sign: int | None = None) -> Recording:
    """
    Read and check a recording.

    Parameters
    ----------
    bag : str or Path
        rosbag2 folder or file.
    topics, preset : mapping of str to str, str
        Role (``wrench``, ``pose``, ``target``, ...) to topic, if it is not the usual one or that
        of a driver: ``ur``, ``franka``, ``kuka_fri`` or ``broadcaster``.
    wrench_sign : int, optional
        -1 if the driver reports tool on environment; by default that of the bag, or 1.

    Returns
    -------
    Recording
        SI units; each stream with its own stamps [s]; poses of ft_sensor in the base.

    Raises
    ------
    DataError
        It cannot be read, or a stream cannot be used; names the remedy.
    """
    return results.run_read(bag, topics or {}, preset, wrench_sign)


def calibrate(recording: Recorded, **settings: Any) -> Result:
    """
    Estimate tool, sensors, noise and observer.

    Parameters
    ----------
    recording : Recording or path
        Static poses or motion, without contact.
    settings : dict
        Fields of :class:`forcecal_ros.calibrate.settings.IdentificationSettings`, as ``gravity``
        [m/s^2], ``sensor_rotation`` [rad] or ``coupling``.

    Returns
    -------
    Result
        Of a Calibration: tool, sensors and noise in SI units; wrenches in ft_sensor are those of
        the environment on the tool.

    Raises
    ------
    DataError, UnobservableError
        The recording does not determine the tool; names the cause and the remedy.
    """
    return results.run_calibration(recording, settings)


def estimate(recording: Recorded, calibration: Any, *, filter: str | None = None,  # noqa: A002
             **settings: Any) -> Result:
    """
    Estimate the contact wrench at every sample.

    Parameters
    ----------
    recording : Recording or path
        Wrench, and pose or accelerometer as the calibration needs them.
    calibration : Result, Calibration or path
        Of the tool and the sensors of the recording.
    filter : str, optional
        ``kalman``, ``newton``, ``ukf``, ``ekf`` or ``static``; by default the calibration's.
    settings : dict
        Further fields of :class:`forcecal_ros.observe.ObserverSettings`.

    Returns
    -------
    Result
        Of a ContactEstimate, (n, 6): environment on tool, in ft_sensor [N, N m].

    Raises
    ------
    DataError
        The recording lacks a stream, or contradicts the calibration.
    """
    return results.run_estimate(recording, calibration, {'filter': filter, **settings})


def diagnose(recording: Recorded, against: Any = None, *, heldout: Recorded | None = None
             ) -> Result:
    """
    Find where and why a recording departs from a model.

    Parameters
    ----------
    recording : Recording or path
        Of the robot.
    against : optional
        A Recording, or its path, by a simulator of the same commands; a calibration (Result,
        Calibration or path), along the measured motion; an MJCF file (``.xml``) or a simulator,
        run with the recorded commands; a rig, its file or ``nominal``, the default for its own.
    heldout : Recording or path, optional
        To judge on; by default parts of every phase of the first.

    Returns
    -------
    Result
        Of a Diagnosis; ``invalid_data`` is its verdict on a recording that cannot be compared.

    Raises
    ------
    ConfigError, DataError
        The model or the simulator cannot be used; names the cause and the remedy.
    """
    return results.run_diagnosis(recording, against, heldout)


def simulate(recording: Recorded, rig: Any = None, *, seed: int = 0) -> Recording:
    """
    Return what a rig measures under the recorded commands.

    Parameters
    ----------
    recording : Recording or path
        With the ``target``: commanded poses.
    rig : Rig or path, optional
        By default the nominal one of this package.
    seed : int
        Of the sensor noise.

    Returns
    -------
    Recording
        Wrench, accelerometer and pose under these commands.

    Raises
    ------
    DataError
        The recording holds no commands.
    """
    return results.run_simulation(recording, rig, seed)
