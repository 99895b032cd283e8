"""Where the installed commands begin: a signal while they are being loaded ends them quietly."""

from importlib import import_module
import os
import signal
from types import FrameType

INTERRUPTED = 130
"""Exit status of a command after SIGINT, as shells have it."""


def forcecal() -> int:
    """Run a command line."""
    return _main('cli', INTERRUPTED)


def gap() -> int:
    """Run the gap node."""
    return _main('nodes.gap', 0)


def impedance() -> int:
    """Run the impedance node."""
    return _main('nodes.impedance', 0)


def observer() -> int:
    """Run the observer."""
    return _main('nodes.observer', 0)


def sequencer() -> int:
    """Run the sequencer."""
    return _main('nodes.sequencer', 0)


def sim() -> int:
    """Run the simulated rig."""
    return _main('nodes.sim', 0)


def _main(module: str, interrupted: int) -> int:
    """
    Load a module, and call its ``main``.

    An exception in the midst of an import comes out as any other, with a traceback; so that until
    all is loaded, SIGINT ends the process as it stands.
    """
    def end(number: int, frame: FrameType | None) -> None:
        os._exit(interrupted)

    before = signal.signal(signal.SIGINT, end)
    main = import_module(f'forcecal_ros.{module}').main
    signal.signal(signal.SIGINT, before)
    return int(main())
