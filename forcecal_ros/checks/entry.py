"""Every check of the signals of a recording, in order, once, where it enters."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from forcecal_ros.checks import signals
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import CHANNELS, Recording
import numpy as np

_ALL = ('wrench', 'accelerometer', 'optidrive', 'angular_velocity', 'pose', 'target')


def checked(recording: Recording, raw_wrench: bool = False) -> Recording:
    """
    Check every signal of a recording, whatever will be made of it.

    What the signals mean together is judged by :func:`forcecal_ros.checks.hypotheses.judge`.

    It runs once: a recording that was checked is returned as it is. Only raw channels are checked
    once more, as a wrench, after their matrix.

    Parameters
    ----------
    raw_wrench : bool
        Its wrench holds raw channels, before their matrix.

    Returns
    -------
    Recording
        Without what is no reading: its notes say what that was, ``removed`` how many samples.

    Raises
    ------
    DataError
        A stream is empty, spoilt, dead or stuck, or clocks are apart; one sentence says which
        channel, when, and what to do.
    """
    if recording.removed is not None and not recording.raw_wrench:
        return recording
    if recording.wrench is not None and not len(recording.wrench):
        raise DataError('wrench: no message was recorded; check its topic and its driver, and '
                        'record again')
    recording, removed = _readable(_begun(_measured(recording)), raw_wrench)
    signals.refuse_other_pace(recording)
    signals.refuse_clocks_apart(recording)
    signals.refuse_degrees_a_second(recording)
    signals.refuse_far_displacement(recording.optidrive)
    for name, stream in signals.present(recording, _ALL[:4]).items():
        signals.refuse_dead(stream, name)
        signals.refuse_stuck(stream, name, CHANNELS[name], recording.pose or recording.target)
    if recording.wrench is not None and recording.pose is not None and len(recording.pose):
        signals.refuse_wrapped(recording.wrench, recording.pose)
    signals.refuse_frozen_pose(recording)
    for name, stream in signals.present(recording, ('wrench', 'pose')).items():
        recording = _without(recording, name, *signals.without_repetitions(stream, name))
    notes = (*_coarse(recording), *signals.silences(recording), *signals.lost_messages(recording),
             *(str(one) for one in signals.clipped(recording)))
    fresh = [note for note in notes if note not in recording.notes]
    return replace(recording, notes=(*recording.notes, *fresh), removed=removed,
                   raw_wrench=raw_wrench)


def computed(recording: Recording) -> Recording:
    """
    Leave out of a simulator's recording what is no number.

    Its sensors may well repeat themselves to the last bit, and clip nowhere.
    """
    return _readable(_measured(recording), raw_wrench=False)[0]


def _without(recording: Recording, name: str, keep: signals.Mask, note: str) -> Recording:
    """Leave samples of one stream out, and note why."""
    if not note:
        return recording
    changed: dict[str, Any] = {name: getattr(recording, name).rows(keep)}
    return replace(recording, **changed, notes=(*recording.notes, note))


def _coarse(recording: Recording) -> Iterator[str]:
    """Name dead bands, and poses that come in steps or on straight lines."""
    wrench, pose = recording.wrench, recording.pose
    for channel, column in zip(CHANNELS['wrench'], () if wrench is None else wrench.values.T):
        if limit := signals.dead_band(column):
            yield (f'{channel} has no reading between 0 and {limit:.3g}: the driver sets '
                   'small readings to zero (dead band), which distorts the bias; disable this')
    if pose is not None and (straight := signals.interpolated(pose)):
        yield straight
    if pose is not None and recording.accelerometer is None and pose.has_position:
        step = max(signals.resolution(column) for column in pose.position.T)
        # positions in larger steps show no acceleration: robots report tenths of a millimetre
        coarse_m = 1e-3
        if step > coarse_m:
            yield (f'pose: its position has a resolution of {1e3 * step:.3g} mm, too coarse to '
                   'compute accelerations; publish it with more digits')


def _begun(recording: Recording) -> Recording:
    """Leave out what drivers publish before their sensors answer: no numbers, or zeros."""
    for name, stream in signals.present(recording, ('wrench', 'accelerometer')).items():
        if first := signals.startup(stream):
            recording = _without(
                recording, name, np.arange(len(stream)) >= first,
                f'{name}: the first {first} samples, up to {stream.t[first]:.2f} s, contain no '
                'reading; left out')
    return recording


def _readable(recording: Recording, raw_wrench: bool) -> tuple[Recording, dict[str, int]]:
    """Leave out samples that are no readings."""
    removed = dict(recording.removed or {})
    for name, stream in signals.present(recording, _ALL).items():
        limit = signals.ABSURD_RAW if raw_wrench and name == 'wrench' else signals.ABSURD
        good, note = signals.readable(
            stream.t, signals.rows_of(stream), name, CHANNELS[name], limit)
        if note:
            removed[name] = removed.get(name, 0) + int((~good).sum())
            recording = _without(recording, name, good, note)
    if recording.wrench is not None:
        lost = signals.lost_packets(recording.wrench.values)
        if lost.any():
            removed['wrench'] = removed.get('wrench', 0) + int(lost.sum())
            recording = _without(
                recording, 'wrench', ~lost,
                f'wrench: {int(lost.sum())} isolated messages are zero in all channels, as after '
                'lost packets; left out')
    return recording, removed


def _measured(recording: Recording) -> Recording:
    """Take streams for not measured that are empty, or hold what messages hold then."""
    for name in _ALL:
        if why := signals.absence(name, getattr(recording, name)):
            changed: dict[str, Any] = {name: None}
            recording = replace(recording, **changed, notes=(
                *recording.notes, f'{name}: {why}; treated as not measured'))
    return recording
