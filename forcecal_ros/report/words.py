"""What every report begins with: sentences with a label, and commands."""

from collections.abc import Sequence
import shlex
from typing import NamedTuple


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
