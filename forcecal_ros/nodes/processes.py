"""Nodes as child processes, started and stopped together, heard on this machine alone."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.resources import files
import os
import random
import signal
import subprocess
import sys
import tempfile
from types import TracebackType
from typing import IO

from forcecal_ros.core.errors import DataError

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


def only_this_machine() -> dict[str, str]:
    """
    Return environment variables that keep a process' DDS traffic on the loopback interface.

    With Fast DDS, Jazzy's own, messages go over UDP and never through shared memory, where each
    process of the machine, of whatever domain, waits at locks that a killed one never releases.
    Its profile alone has to say so: ``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` would bring
    shared memory back. Its buffers hold some tenths of a second of topics at 1 kHz, as far as the
    system grants them. Any other middleware is told LOCALHOST.
    """
    if os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps').startswith('rmw_fastrtps'):
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
                'FASTRTPS_DEFAULT_PROFILES_FILE': str(files(__package__) / 'loopback.xml')}
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


@contextmanager
def own_domain() -> Iterator[dict[str, str]]:
    """
    Take this process to a DDS domain of this machine only, where no robot listens.

    A ROS_DOMAIN_ID of the user is kept.

    Yields
    ------
    dict
        Environment variables for child processes.
    """
    domain = os.environ.get('ROS_DOMAIN_ID') or str(random.randint(1, 101))
    environment = {'ROS_DOMAIN_ID': domain, **only_this_machine()}
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        yield environment
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
