"""Every check of a recording, in order, once, where it enters."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.clipping import clipped, refuse_wrapped, resolution
from forcecal_ros.checks.clocks import (
    lost_messages,
    refuse_clocks_apart,
    refuse_offset,
    silences,
)
from forcecal_ros.checks.held import dead_bands, lost_packets, without_held
from forcecal_ros.checks.interpolated import interpolated
from forcecal_ros.checks.motion import refuse_frozen_pose, refuse_silent_pose
from forcecal_ros.checks.pace import refuse_degrees_a_second, refuse_other_pace
from forcecal_ros.checks.repeats import refuse_dead, refuse_stuck
from forcecal_ros.checks.slowness import lag_note
from forcecal_ros.checks.values import readable, startup
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import CHANNELS, PoseStream, Recording, Stream
import numpy as np

SENSORS = ('wrench', 'accelerometer', 'optidrive', 'angular_velocity')
"""Streams whose values are a sensor's."""

OPTIONAL = ('optidrive', 'angular_velocity')
"""Signals that messages and simulators hold as zeros where nothing measures them."""


class Checked(NamedTuple):
    """
    A recording that can be used.

    Attributes
    ----------
    recording : Recording
        Without what is no reading; its notes say what that was.
    removed : dict of str to int
        How many samples each stream lost.
    """

    recording: Recording
    removed: dict[str, int]


def checked(recording: Recording, raw_wrench: bool = False) -> Checked:
    """
    Check everything that a recording holds, whatever will be made of it.

    It runs once: a recording that was checked is returned as it is, with what was removed then.

    Parameters
    ----------
    raw_wrench : bool
        Its wrench holds raw channels, before their matrix.

    Raises
    ------
    DataError
        A stream is empty, spoilt, dead or stuck, or clocks are apart; one sentence says which
        channel, when, and what to do.
    """
    if recording.removed is not None:
        return Checked(recording, dict(recording.removed))
    if recording.wrench is not None and not len(recording.wrench):
        raise DataError('wrench: no message was recorded; look at its topic and its driver, and '
                        'record again')
    recording, removed = _readable(_begun(_without_absent(recording)), raw_wrench)
    refuse_other_pace(recording)
    refuse_clocks_apart(recording)
    refuse_degrees_a_second(recording)
    for name in SENSORS:
        stream = getattr(recording, name)
        if stream is not None:
            refuse_dead(stream, name, CHANNELS[name])
            refuse_stuck(stream, name, CHANNELS[name], recording.pose or recording.target)
    if recording.wrench is not None and recording.pose is not None and len(recording.pose):
        refuse_wrapped(recording.wrench, CHANNELS['wrench'], recording.pose)
    refuse_frozen_pose(recording)
    refuse_silent_pose(recording)
    recording = without_held(recording)
    follows = _how_it_follows(recording) if not raw_wrench else ''
    if not raw_wrench:
        refuse_offset(recording, 'smooths' in follows)
    notes = (*([follows] if follows else []), *_coarse(recording), *silences(recording),
             *lost_messages(recording),
             *(str(one) for one in clipped(recording)))
    fresh = [note for note in notes if note not in recording.notes]
    # raw channels are checked once more as a wrench, after their matrix
    return Checked(replace(recording, notes=(*recording.notes, *fresh),
                           removed=None if raw_wrench else removed), removed)


def _how_it_follows(recording: Recording) -> str:
    wrench, pose = recording.wrench, recording.pose
    return lag_note(wrench, pose) if wrench is not None and pose is not None else ''


def _coarse(recording: Recording) -> Iterator[str]:
    """Name dead bands, and poses that come in steps or on straight lines."""
    wrench, pose = recording.wrench, recording.pose
    if wrench is not None:
        yield from dead_bands(wrench.values, CHANNELS['wrench'])
    if pose is not None and (straight := interpolated(pose)):
        yield straight
    if pose is not None and recording.accelerometer is None and pose.has_position:
        step = max(resolution(column) for column in pose.position.T)
        if step > limits.COARSE_PLACE:
            yield (f'pose: its position comes in steps of {1e3 * step:.3g} mm: accelerations that '
                   'are taken from it jump; publish it with more digits')


def _begun(recording: Recording) -> Recording:
    """Leave out what drivers publish before their sensors answer: no numbers, or zeros."""
    changed: dict[str, Any] = {}
    notes = []
    for name in ('wrench', 'accelerometer'):
        stream = getattr(recording, name)
        if stream is not None and (first := startup(stream)):
            changed[name] = stream.rows(slice(first, None))
            notes.append(f'{name}: its first {first} samples hold no reading, up to '
                         f'{stream.t[first]:.2f} s; left out')
    return replace(recording, **changed, notes=(*recording.notes, *notes)) if notes else recording


def computed(recording: Recording) -> Recording:
    """
    Leave out of a simulator's recording what is no number.

    Its sensors may well repeat themselves to the last bit, and clip nowhere.
    """
    return _readable(_without_absent(recording), raw_wrench=False)[0]


def _readable(recording: Recording, raw_wrench: bool) -> tuple[Recording, dict[str, int]]:
    """Leave out samples that are no readings."""
    changed: dict[str, Any] = {}
    removed, notes = {}, []
    for name in (*SENSORS, 'pose', 'target'):
        stream = getattr(recording, name)
        if stream is None:
            continue
        limit = limits.ABSURD_RAW if raw_wrench and name == 'wrench' else limits.ABSURD
        good, note = readable(stream, name, CHANNELS[name], limit)
        if note:
            changed[name], removed[name] = stream.rows(good), int((~good).sum())
            notes.append(note)
    if changed:
        recording = replace(recording, **changed, notes=(*recording.notes, *notes))
    return _without_lost_packets(recording, removed), removed


def _without_lost_packets(recording: Recording, removed: dict[str, int]) -> Recording:
    """Leave out zeros that drivers send where a packet was lost."""
    wrench = recording.wrench
    lost = None if wrench is None else lost_packets(wrench.values)
    if wrench is None or lost is None or not lost.any():
        return recording
    removed['wrench'] = removed.get('wrench', 0) + int(lost.sum())
    return replace(recording, wrench=wrench.rows(~lost), notes=(*recording.notes, (
        f'wrench: {int(lost.sum())} messages are zero in all channels between others that are '
        'not, as of lost packets; left out')))


def _without_absent(recording: Recording) -> Recording:
    """Take streams for not measured that are empty, or hold what messages hold then."""
    found = {name: why for name in (*SENSORS, 'pose', 'target') if (why := _absence(
        name, getattr(recording, name)))}
    absent: dict[str, Any] = dict.fromkeys(found)
    notes = [f'{name}: {why}; taken as not measured' for name, why in found.items()]
    return replace(recording, **absent, notes=(*recording.notes, *notes)) if found else recording


def _absence(name: str, stream: Stream | PoseStream | None) -> str:
    """Say why a stream is none; empty: it is one, or never was."""
    if stream is None or name == 'wrench':
        return ''
    if not len(stream):
        return 'no message'
    if name not in OPTIONAL or not isinstance(stream, Stream):
        return ''
    if name == 'angular_velocity' and np.isnan(stream.values).all():
        return 'no number throughout'
    return '' if stream.values.any() else 'zero throughout'
