"""The observer over a recording, by the same step as in the node, sample by sample or at once."""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge
from operator import itemgetter
from typing import Any

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array, quaternion_from_matrix
from forcecal_ros.observe.contact import ContactSample
from forcecal_ros.observe.design import design, Model
from forcecal_ros.observe.settings import Settings
from forcecal_ros.observe.step import (
    finish,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    Result,
    State,
)
from forcecal_ros.recording.streams import Recording
import numpy as np
from numpy.typing import NDArray

Event = tuple[float, str, Any]


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
    dropped : tuple of int, length 4
        Samples not used: wrench, accelerometer, pose, displacement.
    """

    t: Array
    contact: Array
    measured: Array
    innovation: Array
    inertial: Array
    status: NDArray[np.int64]
    dropped: tuple[int, ...]


def replay(recording: Recording, calibration: Calibration,
           settings: Settings = Settings()) -> ContactEstimate:
    """
    Estimate the contact wrench over a recording.

    All at once (:mod:`forcecal_ros.observe.batch`) where the stamps of each stream increase, else
    sample by sample.

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
    # the node, which never replays, need not load the compiler
    from forcecal_ros.observe.batch import estimates, in_order

    model = design(calibration, settings)
    if not in_order(recording):
        return _collect(*run(recording, model))
    t, wrenches, status, dropped = estimates(recording, model)
    for array in (wrenches, status):
        array.setflags(write=False)
    contact, measured, innovation, inertial = wrenches
    return ContactEstimate(t, contact, measured, innovation, inertial, status, dropped)


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
    for state, out in answers(recording, model):
        samples.extend(out)
    return state, samples


def answers(recording: Recording, model: Model) -> Iterator[Result]:
    """
    Feed a recording to the step and return what it says to every event, and at the end.

    Parameters
    ----------
    recording : Recording
    model : Model

    Returns
    -------
    iterator of tuple
        The state after the event and the samples it completed.
    """
    state = State()
    for t, kind, row in events(recording):
        if kind == 'wrench':
            result = on_wrench(state, t, row, model)
        elif kind == 'accelerometer':
            result = on_accelerometer(state, t, row, model)
        elif kind == 'displacement':
            result = on_displacement(state, t, row[0], model)
        else:
            result = on_pose(state, t, row[:3], row[3:], model)
        state = result[0]
        yield result
    yield finish(state, model)


def events(recording: Recording) -> Iterator[Event]:
    """
    Return what a recording holds for the observer, in the order of its stamps.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    iterator of tuple
        ``(stamp, kind, values)``; kinds are ``pose`` (position, quaternion xyzw),
        ``displacement``, ``accelerometer`` and ``wrench``.
    """
    streams = [(kind, stream.t, stream.values) for kind, stream in (
        ('displacement', recording.optidrive), ('accelerometer', recording.accelerometer),
        ('wrench', recording.wrench)) if stream is not None]
    if recording.pose is not None:
        pose = recording.pose
        streams.insert(0, ('pose', pose.t, np.hstack(
            [pose.position, quaternion_from_matrix(pose.R_base_sensor)])))
    return merge(*(
        [(t, kind, tuple(row)) for t, row in zip(times.tolist(), values.tolist())]
        for kind, times, values in streams), key=itemgetter(0))


def _collect(state: State, samples: list[ContactSample]) -> ContactEstimate:
    columns = [np.array(column) for column in zip(*samples)]
    for column in columns:
        column.setflags(write=False)
    t, contact, status, measured, innovation, inertial = columns
    return ContactEstimate(
        t, contact, measured, innovation, inertial, status, state.refusals.counts)
