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
import tempfile


@contextmanager
def own_domain() -> Iterator[None]:
    """Keep to a DDS domain that no other benchmark or test of this package is in."""
    with (tempfile.TemporaryDirectory() as logs,
          socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reservation):
        for domain in random.sample(range(1, 102), 101):
            try:
                reservation.bind(f'\0forcecal-test-domain-{domain}')
                break
            except OSError:
                continue
        os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_LOG_DIR=logs,
                          ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        yield


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
