"""One recording on one clock: checked values, pauses, clocks that run apart."""

from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.checks.clocks import Clock, clocks, dropouts, skew_between
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.signals import SENSORS
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.stamps import with_even_stamps
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.inputs.requirements import bridged, require_overlap
from forcecal_ros.effects.rig import Rig


class Corrected(NamedTuple):
    """
    A recording on one clock.

    Attributes
    ----------
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
    shortest : float
        For how long commands and sensors have to be there together [s].

    Raises
    ------
    DataError
        Commands or sensors are missing, not finite, or do not overlap.
    """
    stamped, changed = _evened(recording)
    # what is no reading has a stamp all the same: it is not lost
    found = clocks(replace(recording, **changed), _rates(rig))
    _check_commands(stamped)
    require_overlap(stamped, 'target', shortest)
    whole = bridged(stamped)
    skew = skew_between(found)
    start = float(whole.target.t[0]) if whole.target is not None else 0.0
    aligned = {}
    for name, value in skew.items():
        stream = getattr(whole, name)
        aligned[name] = replace(stream, t=start + (stream.t - start) / (1.0 + value))
    return Corrected(replace(whole, **aligned), found, skew, dropouts(found),
                     _new_notes(recording, stamped), whole)


def evened(recording: Recording) -> Corrected:
    """
    Take all streams to be on one clock already, as where no commands were recorded.

    Raises
    ------
    DataError
        A stream cannot be used.
    """
    stamped, _ = _evened(recording)
    return Corrected(stamped, (), {}, {}, _new_notes(recording, stamped), stamped)


def _new_notes(before: Recording, after: Recording) -> tuple[str, ...]:
    return after.notes[len(before.notes):]


def _evened(recording: Recording) -> tuple[Recording, dict[str, Any]]:
    """Check a recording and even sensors that jitter around instants; return these apart too."""
    recording = checked(recording).recording
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
    return replace(recording, **changed, notes=(*recording.notes, *notes)), changed


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
