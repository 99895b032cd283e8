"""Long work shows itself: one changing line on a terminal, a line a stage elsewhere."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import sys
from threading import Event, Thread
import time
from typing import Any

from forcecal_ros.cli.common import CLEAR, warn

AFTER = 2.0
"""What is done sooner shows nothing on a terminal [s]."""

TICK = 0.2
"""Between two looks of the changing line, which shows whole seconds [s]."""


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Add ``--quiet``."""
    parser.add_argument('--quiet', action='store_true', help='show no progress')


def bar(args: argparse.Namespace, **settings: Any) -> Any:
    """Return a bar of tqdm: share done and time left, on a terminal."""
    from tqdm import tqdm

    return tqdm(leave=False, delay=AFTER, disable=args.quiet or None, **settings)


def tell(args: argparse.Namespace, stage: str) -> None:
    """Print which stage begins, where no terminal shows it."""
    if not args.quiet and not sys.stderr.isatty():
        warn(stage)


@contextmanager
def stages(args: argparse.Namespace, after: float = AFTER) -> Iterator[Callable[[str], None]]:
    """
    Show which stage a command is in, and for how long it has worked.

    Parameters
    ----------
    after : float
        When a terminal begins to show it [s].

    Yields
    ------
    callable
        To be told each stage as it begins.
    """
    if args.quiet or not sys.stderr.isatty():
        yield lambda stage: tell(args, stage)
        return
    line = _Line(after)
    line.start()
    try:
        yield line.show
    finally:
        line.end()


class _Line(Thread):
    """The changing line: seconds and stage, while another thread works."""

    def __init__(self, after: float) -> None:
        super().__init__(daemon=True)
        self._stage, self._began, self._after = '', time.monotonic(), after
        self._ended = Event()

    def show(self, stage: str) -> None:
        """Show another stage from now on."""
        self._stage = stage

    def run(self) -> None:
        """Print until the end."""
        while not self._ended.wait(TICK):
            seconds = time.monotonic() - self._began
            if seconds > self._after:
                print(f'{CLEAR}{seconds:3.0f} s  {self._stage}', end='', file=sys.stderr,
                      flush=True)

    def end(self) -> None:
        """Take the line away."""
        self._ended.set()
        self.join()
        print(CLEAR, end='', file=sys.stderr, flush=True)
