"""Nodes as processes, in a DDS domain of their own, and what they cost."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import random
import signal
import socket
import subprocess
import sys

from forcecal_ros.nodes.client import only_this_machine


@contextmanager
def own_domain(logs: Path) -> Iterator[int]:
    """
    Keep nodes to themselves that start meanwhile, those of child processes included.

    Domains 1 to 101 have ports below Linux's ephemeral ones. A name in the abstract socket
    namespace reserves one among all tests and benchmarks on this machine, and vanishes with the
    process. ROS writes its logs to ``logs``.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reservation:
        domain = _reserve(reservation)
        here = {'ROS_DOMAIN_ID': str(domain), 'ROS_LOG_DIR': str(logs), **only_this_machine()}
        before = {name: os.environ.get(name) for name in here}
        os.environ.update(here)
        try:
            yield domain
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


def _reserve(reservation: socket.socket) -> int:
    for domain in random.sample(range(1, 102), 101):
        try:
            reservation.bind(f'\0forcecal-test-domain-{domain}')
        except OSError:
            continue
        return domain
    raise RuntimeError('all DDS domains from 1 to 101 are taken by other tests')


@contextmanager
def process(arguments: Sequence[str], parameters: Mapping[str, object] = {}) -> Iterator[int]:
    """Run a python program with ROS parameters, and give its process id."""
    given = [part for name, value in parameters.items() for part in ('-p', f'{name}:={value}')]
    running = subprocess.Popen(
        [sys.executable, *arguments, '--ros-args', *given],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield running.pid
    finally:
        running.send_signal(signal.SIGINT)
        running.wait(10.0)


def processor_time(pid: int) -> float:
    """Return what a process has used so far, nanoseconds as the scheduler counts them [s]."""
    tasks = Path(f'/proc/{pid}/task').glob('*/schedstat')
    return sum(int(task.read_text().split()[0]) for task in tasks) * 1e-9
