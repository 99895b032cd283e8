"""Who has the machine: tests that compute share it, some that run nodes want it for themselves."""

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import fcntl
from pathlib import Path
import time

HERE = Path(__file__)

PRESSURE = Path('/proc/pressure/cpu')
"""Where Linux counts how long something waited for a processor [us]."""

QUIET = 0.1
"""
Part of a look's time in which something waited: a machine that only runs pytest has 0.00 to 0.03,
one with as many busy processes as cores 0.4 and more.
"""

LOOK = 0.5
"""Over which that is measured [s]."""

PATIENCE = 60.0
"""For so long is waited for a quiet machine; what then fails, fails [s]."""


@contextmanager
def machine(alone: bool) -> Iterator[None]:
    """
    Take part in the machine, or all of it: then once nothing else takes part.

    Whoever wants all of it holds the turnstile, which nobody else gets past meanwhile.
    """
    with ExitStack() as held:
        with HERE.open() as turnstile:
            fcntl.flock(turnstile, fcntl.LOCK_EX)
            share = held.enter_context((HERE.parent / 'live.py').open())
            fcntl.flock(share, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        if alone:
            _wait_for_quiet()
        yield


def _wait_for_quiet() -> None:
    end = time.monotonic() + PATIENCE
    while PRESSURE.exists() and time.monotonic() < end:
        before = _waited()
        time.sleep(LOOK)
        if _waited() - before < QUIET * LOOK:
            return


def _waited() -> float:
    """Return for how long something waited for a processor since the start [s]."""
    return int(PRESSURE.read_text().splitlines()[0].rpartition('total=')[2]) * 1e-6
