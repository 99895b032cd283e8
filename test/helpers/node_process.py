"""Nodes as processes that begin where their imports have ended: a second less for each of them."""

from collections.abc import Mapping, Sequence
import multiprocessing
import os
import runpy
import signal
import sys

IMPORTED = ('nodes.sim', 'nodes.observer', 'nodes.sequencer', 'nodes.gap', 'nodes.impedance',
            'nodes.bags', 'cli.play')
"""What is imported once, in a process without threads from which the others fork."""

_SERVED = multiprocessing.get_context('forkserver')
_SERVED.set_forkserver_preload([f'forcecal_ros.{name}' for name in IMPORTED])


class NodeProcess:
    """
    A node in a process and a session of its own, with the interface of ``subprocess.Popen``.

    Parameters
    ----------
    module : str
        Run as ``python -m MODULE`` would.
    arguments : sequence of str
    output : str
        File for what it says.
    environment : mapping of str to str
    """

    def __init__(self, module: str, arguments: Sequence[str], output: str,
                 environment: Mapping[str, str]) -> None:
        self._process = _SERVED.Process(target=_run, daemon=True, args=(
            module, list(arguments), output, dict(environment)))
        self._process.start()

    @property
    def pid(self) -> int:
        """Return the process id."""
        return self._process.pid or 0

    @property
    def returncode(self) -> int | None:
        """Return the exit status, the negative number of a signal; None while it runs."""
        return self._process.exitcode

    def poll(self) -> int | None:
        """Return the exit status; None while it runs."""
        return self.returncode

    def wait(self) -> int | None:
        """Wait until it has ended."""
        self._process.join()
        return self.returncode

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)


def _run(module: str, arguments: list[str], output: str, environment: dict[str, str]) -> None:
    os.setsid()
    said = os.open(output, os.O_WRONLY | os.O_APPEND)
    os.dup2(said, 1)
    os.dup2(said, 2)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [module, *arguments]
    sys.modules.pop(module, None)  # what is run is run anew, as by python -m
    runpy.run_module(module, run_name='__main__', alter_sys=True)
