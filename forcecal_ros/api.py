"""The package from Python: ``import forcecal_ros as fc``, then ``fc.read``, ``fc.calibrate``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from forcecal_ros import results
from forcecal_ros.core.streams import Recording
from forcecal_ros.results import load, Result, save

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
        -1 if the driver reports tool on environment; by default as the calibration has it, or 1.

    Raises
    ------
    DataError
        It cannot be read, or a stream cannot be used; names the remedy.
    """
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.cli.common import preset_topics
    from forcecal_ros.io.bags import read_recording

    names = {**preset_topics(preset, str(bag)), **(topics or {})}
    return checked(read_recording(bag, names, wrench_sign, joints=True))


def check(recording: Recording) -> Result:
    """
    Return what a recording can be used for, and why not.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    Result
        Streams, motion, wrench sign and fault are in ``to_dict()``.
    """
    return results.run_check(recording)


def calibrate(recording: Recording, **settings: Any) -> Result:
    """
    Estimate tool, sensors, noise and observer.

    Parameters
    ----------
    recording : Recording
        Static poses or motion, without contact.
    settings : dict
        Fields of :class:`forcecal_ros.calibrate.settings.IdentificationSettings`, as ``gravity``
        [m/s^2], ``sensor_rotation`` [rad] or ``coupling``.

    Returns
    -------
    Result
        Of a Calibration: SI units, ft_sensor, environment on tool.

    Raises
    ------
    DataError, UnobservableError
        The recording does not determine the tool; names the cause and the remedy.
    """
    return results.run_calibration(recording, settings)


def estimate(recording: Recording, calibration: Any, *, filter: str | None = None,  # noqa: A002
             **settings: Any) -> Result:
    """
    Estimate the contact wrench at every sample.

    Parameters
    ----------
    recording : Recording
    calibration : Result, Calibration or path
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


def diagnose(recording: Recording, against: Any = None, *, heldout: Recording | None = None
             ) -> Result:
    """
    Find where and why a recording departs from a model.

    Parameters
    ----------
    recording, heldout : Recording
        The second, optional, is to judge on; by default parts of every phase of the first.
    against : optional
        A Recording by a simulator of the same commands; a calibration (Result, Calibration or
        path), along the measured motion; an MJCF file (``.xml``) or a simulator, run with the
        recorded commands; a rig or its file. None: the nominal rig, if the recording is by it.

    Returns
    -------
    Result
        Of a Diagnosis; the effects that it names, or a verdict without any.
    """
    return results.run_diagnosis(recording, against, heldout)


def simulate(recording: Recording, rig: Any = None, *, seed: int = 0) -> Recording:
    """
    Return what a rig measures under the recorded commands.

    Parameters
    ----------
    recording : Recording
        With the ``target``; a DataError names what is missing.
    rig : Rig or path, optional
        By default the nominal one of this package.
    seed : int
        Of the sensor noise.
    """
    return results.run_simulation(recording, rig, seed)
