"""Nodes as processes of their own, started and stopped together."""

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
"""A node that has not gone that long after SIGINT is killed [s]."""


class Processes:
    """
    Nodes of this package; use it as a context, which ends them all.

    Parameters
    ----------
    environment : mapping
        Added to this process's own.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = {**os.environ, **environment}
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._said: dict[str, IO[bytes]] = {}

    def start(self, node: str, parameters: Mapping[str, object]) -> None:
        """Start one node with its parameters."""
        arguments = [part for name, value in parameters.items()
                     for part in ('-p', f'{name}:={_text(value)}')]
        self._said[node] = tempfile.TemporaryFile()  # noqa: SIM115 - outlives this call
        self._running[node] = subprocess.Popen(
            [sys.executable, '-m', f'forcecal_ros.nodes.{node}', '--ros-args', *arguments],
            stdin=subprocess.DEVNULL, stdout=self._said[node], stderr=subprocess.STDOUT,
            env=self._environment, start_new_session=True)

    def check(self) -> None:
        """
        Make sure that all are running.

        Raises
        ------
        DataError
            One has ended; with the last thing it said.
        """
        for node, process in self._running.items():
            if process.poll() is not None:
                raise DataError(f'the {node} node ended with status {process.returncode}: '
                                f'{self._last_words(node)}')

    def _last_words(self, node: str) -> str:
        self._said[node].seek(0)
        lines = self._said[node].read().decode(errors='replace').strip().splitlines()
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
        for said in self._said.values():
            said.close()


def _text(value: object) -> str:
    """Write a value as YAML that ROS takes as the same type."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return '[' + ', '.join(_text(item) for item in value) + ']'
    return repr(value) if isinstance(value, float) else str(value)
