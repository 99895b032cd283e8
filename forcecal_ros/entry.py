"""Where executables begin: a signal while they are being loaded ends them quietly."""

from collections.abc import Callable
from functools import partial
from importlib import import_module
import os
import signal
import sys
from types import FrameType
from typing import Any


def forcecal() -> int:
    """Run a command line."""
    return int(loaded('cli.main', 130)())


def _node(name: str) -> int:
    """Run a node."""
    try:
        return int(loaded(f'nodes.{name}', 0)())
    except ModuleNotFoundError as error:
        from forcecal_ros.core.extras import missing

        if not (why := missing(error)):
            raise
        sys.exit(f'{name}: {why}')


gap, impedance, observer, sequencer, sim = (
    partial(_node, name) for name in ('gap', 'impedance', 'observer', 'sequencer', 'sim'))


def loaded(module: str, interrupted: int) -> Callable[..., Any]:
    """
    Load a module of this package, and return its ``main``.

    An exception in the midst of an import comes out as any other, with a traceback; so that until
    all is loaded, SIGINT ends the process as it stands, with status ``interrupted``.
    """
    def end(number: int, frame: FrameType | None) -> None:
        os._exit(interrupted)

    before = signal.signal(signal.SIGINT, end)
    try:
        return import_module(f'forcecal_ros.{module}').main  # type: ignore[no-any-return]
    finally:
        signal.signal(signal.SIGINT, before)
