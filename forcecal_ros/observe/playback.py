"""The observer over a recording, by the same step as in the node."""

from dataclasses import dataclass
from heapq import merge
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forcecal_ros.calibration import Calibration
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array, quaternion_from_matrix
from forcecal_ros.observe.contact import ContactSample
from forcecal_ros.observe.design import Model, design
from forcecal_ros.observe.settings import Settings
from forcecal_ros.observe.step import (
    State, finish, on_accelerometer, on_displacement, on_pose, on_wrench)
from forcecal_ros.samples import Recording

_POSE, _DISPLACEMENT, _ACCELEROMETER, _WRENCH = range(4)


@dataclass(frozen=True)
class ContactEstimate:
    """
    Contact wrench over time; rows as in :class:`~forcecal_ros.observe.contact.ContactSample`.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Stamps of the wrench [s].
    contact, measured, innovation, inertial : ndarray, shape (n, 6)
        In ft_sensor, wire sign [N, N m].
    status : ndarray of int, shape (n,)
        Bits of :mod:`forcecal_ros.observe.status`.
    dropped : tuple of 4 int
        Samples not used: wrench, accelerometer, pose, displacement.
    """

    t: Array
    contact: Array
    measured: Array
    innovation: Array
    inertial: Array
    status: NDArray[np.int64]
    dropped: tuple[int, int, int, int]


def replay(recording: Recording, calibration: Calibration,
           settings: Settings = Settings()) -> ContactEstimate:
    """
    Estimate the contact wrench over a recording.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration
    settings : Settings

    Returns
    -------
    ContactEstimate

    Raises
    ------
    DataError
        The recording holds no wrench, or its accelerometer speaks another unit than the
        calibration's.
    """
    if recording.wrench is None or not len(recording.wrench):
        raise DataError(f'{recording.source or "the recording"} holds no wrench; '
                        'name its topic by --topic wrench=...')
    wanted = calibration.accelerometer
    if (wanted is not None and recording.accelerometer is not None
            and recording.accelerometer_unit != wanted.unit):
        raise DataError(
            f'the accelerometer is recorded in {recording.accelerometer_unit}, the calibration '
            f'is for {wanted.unit}; calibrate with the same sensor')
    return _collect(*run(recording, design(calibration, settings)))


def run(recording: Recording, model: Model) -> tuple[State, list[ContactSample]]:
    """
    Feed a recording to the step, in the order of its stamps.

    Parameters
    ----------
    recording : Recording
    model : Model

    Returns
    -------
    state : State
        After the last sample.
    samples : list of ContactSample
    """
    state = State()
    samples: list[ContactSample] = []
    for t, kind, row in merge(*_streams(recording)):
        if kind == _WRENCH:
            state, out = on_wrench(state, t, row, model)
        elif kind == _ACCELEROMETER:
            state, out = on_accelerometer(state, t, row, model)
        elif kind == _DISPLACEMENT:
            state, out = on_displacement(state, t, row[0], model)
        else:
            state, out = on_pose(state, t, row[:3], row[3:], model)
        samples.extend(out)
    state, out = finish(state, model)
    return state, [*samples, *out]


def _streams(recording: Recording) -> list[list[tuple[float, int, Any]]]:
    """Turn each stream into a list of events (stamp, kind, values)."""
    streams = [(kind, stream.t, stream.values) for kind, stream in (
        (_DISPLACEMENT, recording.optidrive), (_ACCELEROMETER, recording.accelerometer),
        (_WRENCH, recording.wrench)) if stream is not None]
    if recording.pose is not None:
        pose = recording.pose
        streams.append((_POSE, pose.t, np.hstack(
            [pose.position, quaternion_from_matrix(pose.R_base_sensor)])))
    return [[(t, kind, tuple(row)) for t, row in zip(times.tolist(), values.tolist())]
            for kind, times, values in streams]


def _collect(state: State, samples: list[ContactSample]) -> ContactEstimate:
    columns = [np.array(column) for column in zip(*samples)]
    for column in columns:
        column.setflags(write=False)
    t, contact, status, measured, innovation, inertial = columns
    return ContactEstimate(t, contact, measured, innovation, inertial, status, state.dropped)
