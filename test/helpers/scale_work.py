"""What the workers of the tests of scaling out are given to do."""

import os
from pathlib import Path
import signal
import time

from forcecal_ros.core.errors import DataError


def square(number):
    if number < 0:
        raise DataError(f'{number} is negative')
    return number * number


def killed_at_first(task):
    """Square a number; whoever meets the file that is not there yet is killed half-way."""
    number, mark = task
    if number == 2 and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def always_killed(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def meet(folder):
    """Wait for a second process that was given this work, and say which process this is."""
    (Path(folder) / str(os.getpid())).touch()
    end = time.monotonic() + 60.0
    while len(list(Path(folder).iterdir())) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    return os.getpid()
