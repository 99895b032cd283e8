"""What every report begins with: sentences with a label, and commands."""

from typing import NamedTuple


class Step(NamedTuple):
    """What to do next: a sentence, and the command that does it where there is one."""

    words: str
    command: str = ''


class Fact(NamedTuple):
    """One line of the first screen."""

    label: str
    words: str
    command: str = ''
