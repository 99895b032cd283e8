"""Nodes as child processes, started and stopped together."""

from collections.abc import Mapping, Sequence
import os
import signal
import subprocess
import sys
import tempfile
from types import TracebackType
from typing import IO

from forcecal_ros.errors import DataError

PATIENCE = 5.0
"""Time from SIGINT to SIGKILL [s], ten times what a node takes to come to rest."""


class Processes:
    """
    Nodes of this package; the end of its context ends them all.

    Parameters
    ----------
    environment : mapping
        Variables added to those of this process.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = {**os.environ, **environment}
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._outputs: dict[str, IO[bytes]] = {}

    def start(self, node: str, parameters: Mapping[str, object]) -> None:
        """Start one node with its parameters."""
        arguments = [part for name, value in parameters.items()
                     for part in ('-p', f'{name}:={_text(value)}')]
        self._outputs[node] = tempfile.TemporaryFile()  # noqa: SIM115 - outlives this call
        self._running[node] = subprocess.Popen(
            [sys.executable, '-m', f'forcecal_ros.nodes.{node}', '--ros-args', *arguments],
            stdin=subprocess.DEVNULL, stdout=self._outputs[node], stderr=subprocess.STDOUT,
            env=self._environment, start_new_session=True)

    def check(self) -> None:
        """
        Check that all nodes are running.

        Raises
        ------
        DataError
            One has ended; with the last line of its output.
        """
        for node, process in self._running.items():
            if process.poll() is not None:
                raise DataError(f'the {node} node ended with status {process.returncode}: '
                                f'{self._last_line(node)}')

    def _last_line(self, node: str) -> str:
        self._outputs[node].seek(0)
        lines = self._outputs[node].read().decode(errors='replace').strip().splitlines()
        return lines[-1] if lines else 'it said nothing'

    def __enter__(self) -> 'Processes':
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        for process in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._running.values():
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        for output in self._outputs.values():
            output.close()


def _text(value: object) -> str:
    """Return a value as YAML that ROS reads as the same type."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return '[' + ', '.join(_text(item) for item in value) + ']'
    return repr(value) if isinstance(value, float) else str(value)
