"""A recording made right before it is replayed: values, pauses, clocks that run apart."""

from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.diagnose.pairing import bridged, require_overlap
from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import DataError
from forcecal_ros.recording.checks.clocks import Clock, clocks, dropouts, skew_between
from forcecal_ros.recording.checks.entry import checked
from forcecal_ros.recording.checks.pauses import SENSORS
from forcecal_ros.recording.stamps import with_even_stamps
from forcecal_ros.recording.streams import Recording


class Corrected(NamedTuple):
    """
    A recording on one clock.

    Attributes
    ----------
    recording : Recording
    clocks : tuple of Clock
        As they were found.
    skew : dict of str to float
        Of the streams whose stamps were corrected.
    lost : dict of str to float
        Fraction of lost samples by stream.
    notes : tuple of str
        What had to be left out.
    stamped : Recording
        Before its clocks were corrected.
    """

    recording: Recording
    clocks: tuple[Clock, ...]
    skew: dict[str, float]
    lost: dict[str, float]
    notes: tuple[str, ...] = ()
    stamped: Recording = Recording()


def corrected(recording: Recording, rig: Rig, shortest: float) -> Corrected:
    """
    Bring all streams to the clock of the commands.

    Parameters
    ----------
    recording : Recording
    rig : Rig
    shortest : float
        For how long commands and sensors have to be there together [s].

    Returns
    -------
    Corrected

    Raises
    ------
    DataError
        Commands or sensors are missing, not finite, or do not overlap.
    """
    known, stamped = recording.notes, checked(recording).recording
    evened, notes = _evened(stamped)
    stamped = replace(stamped, **evened, notes=(*stamped.notes, *notes))
    # what is no reading has a stamp all the same: it is not lost
    found = clocks(replace(recording, **evened), _rates(rig))
    _check_commands(stamped)
    require_overlap(stamped, 'target', shortest)
    recording = bridged(stamped)
    skew = skew_between(found)
    start = float(recording.target.t[0]) if recording.target is not None else 0.0
    changed = {}
    for name, value in skew.items():
        stream = getattr(recording, name)
        changed[name] = replace(stream, t=start + (stream.t - start) / (1.0 + value))
    return Corrected(replace(recording, **changed), found, skew, dropouts(found),
                     stamped.notes[len(known):], recording)


def evened(recording: Recording) -> Corrected:
    """
    Take all streams to be on one clock already, as where no commands were recorded.

    Raises
    ------
    DataError
        A stream cannot be used.
    """
    known, stamped = recording.notes, checked(recording).recording
    changed, notes = _evened(stamped)
    stamped = replace(stamped, **changed, notes=(*stamped.notes, *notes))
    return Corrected(stamped, (), {}, {}, stamped.notes[len(known):], stamped)


def _evened(recording: Recording) -> tuple[dict[str, Any], list[str]]:
    """Even the stamps of sensors that jitter around regular instants; return these, and notes."""
    changed: dict[str, Any] = {}
    notes = []
    for name in SENSORS:
        stream = getattr(recording, name)
        if stream is None or len(stream) < 2:
            continue
        even, jitter = with_even_stamps(stream)
        if even is not stream:
            changed[name] = even
            notes.append(f'{name}: stamps jittered by {1e3 * jitter.std:.2f} ms and were evened')
    return changed, notes


def _rates(rig: Rig) -> dict[str, float]:
    rates = {'wrench': rig.wrench_sensor.rate, 'accelerometer': rig.accelerometer.rate,
             'pose': rig.pose_sensor.rate, 'target': 1.0 / rig.robot.period}
    return rates | ({'optidrive': rig.optidrive.rate} if rig.optidrive else {})


def _check_commands(recording: Recording) -> None:
    target = recording.target
    if target is None or not len(target):
        raise DataError('the recording holds no commands (target_frame); record them, the '
                        'simulator replays them')
    if recording.wrench is None and recording.accelerometer is None:
        raise DataError('the recording holds neither wrench nor accelerometer; record at least '
                        'one of them')
