"""How the observer is doing, in one level and one sentence."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.observe.status import describe, level


class Heard(NamedTuple):
    """When a topic was heard last, and the frame_id of its first message."""

    steady_ns: int
    frame: str


def verdict(active: bool, calibrated: str | None, heard: Mapping[str, Heard],
            silent: Sequence[str], status: int) -> tuple[str, str]:
    """
    Return level and message for /diagnostics.

    Parameters
    ----------
    active
    calibrated
        Sensor frame of the calibration in use; None without one.
    heard, silent
        By topic; which of them have been silent of late.
    status : int
        All bits since the last report.
    """
    if not active:
        return 'stale', 'not active'
    if calibrated is None:
        return 'warn', 'waiting for a calibration'
    if 'wrench' in silent or 'wrench' not in heard:
        return 'error', 'wrench: nothing received'
    warnings = [f'{topic}: nothing received' for topic in silent]
    frame = heard['wrench'].frame
    if frame and frame != calibrated:
        warnings.append(f'wrench is of {frame!r}, the calibration of {calibrated!r}: is it '
                        'the same sensor?')
    grade = level(status)
    if warnings and grade == 'ok':
        grade = 'warn'
    return grade, '; '.join((*warnings, *describe(status))) or 'estimating'
