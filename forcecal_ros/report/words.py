"""What every report begins with: sentences with a label, commands, which recordings."""

from collections.abc import Sequence
from datetime import datetime, timezone
import shlex
from typing import NamedTuple

from forcecal_ros.core.streams import Recording


class Step(NamedTuple):
    """What to do next: a sentence, and the command that does it where there is one."""

    words: str
    command: str = ''


def estimated_by(bag: str, calibration: str, how: Sequence[str] = ()) -> Step:
    """Say how a calibration is put to use; ``how``: what the command says of the recording."""
    return Step('Take weight, inertia and bias off this recording, or another one:', shlex.join(
        ('forcecal', 'estimate', bag, '--calibration', calibration, *how, '-o', 'contact')))


class Fact(NamedTuple):
    """One line of the first screen."""

    label: str
    words: str
    command: str = ''


DATED = 10 ** 18
"""Stamps before this, of 2001, are of a clock that began with the simulation [ns]."""


def origin(recordings: Sequence[Recording]) -> list[str]:
    """Say of each recording which one it is, when it was made and how long it is."""
    return [' · '.join(part for part in (one.source, _made(one), _lasting(one)) if part)
            for one in recordings]


def _made(recording: Recording) -> str:
    if recording.start_ns < DATED:
        return 'on simulated time'
    return datetime.fromtimestamp(recording.start_ns / 1e9, timezone.utc).strftime(
        '%Y-%m-%d %H:%M:%S UTC')


def _lasting(recording: Recording) -> str:
    ends = [s.t[-1] for s in (recording.wrench, recording.pose, recording.target)
            if s is not None and len(s)]
    return f'{max(ends):.0f} s' if ends else ''
