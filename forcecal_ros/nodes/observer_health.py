"""The state of the observer as level and message of /diagnostics."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.observe.status import describe, level


class LastMessage(NamedTuple):
    """When a topic was received last [ns], and the frame_id of its first message."""

    steady_ns: int
    frame: str


def health(active: bool, calibrated: str | None, heard: Mapping[str, LastMessage],
           silent: Sequence[str], status: int, more: Sequence[str] = ()) -> tuple[str, str]:
    """
    Return level and message for /diagnostics.

    Parameters
    ----------
    calibrated : str or None
        Sensor frame of the calibration in use; None without one.
    heard, silent : dict, sequence of str
        The last message by topic; the topics that have fallen silent.
    status : int
        All bits of :class:`forcecal_ros.observe.Status` since the last report.
    more : sequence of str
        Further warnings.
    """
    if not active:
        return 'stale', 'not active'
    if calibrated is None:
        return 'warn', 'waiting for a calibration'
    if 'wrench' in silent or 'wrench' not in heard:
        return 'error', 'wrench: nothing received'
    warnings = [*(f'{topic}: nothing received' for topic in silent), *more]
    frame = heard['wrench'].frame
    if frame and frame != calibrated:
        warnings.append(f'wrench is of {frame!r}, the calibration of {calibrated!r}: is it '
                        'the same sensor?')
    grade = level(status)
    if warnings and grade == 'ok':
        grade = 'warn'
    return grade, '; '.join((*warnings, *describe(status))) or 'estimating'
