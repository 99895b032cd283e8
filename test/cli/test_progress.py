"""Long work shows itself on a terminal and in a log, and not where it is told to be quiet."""

from argparse import Namespace
import os
import pty
import subprocess
import sys

from forcecal_ros.cli.common import CLEAR, stages
import pytest

WORK = """
import sys
from argparse import Namespace
from forcecal_ros.cli.common import stages, warn
with stages(Namespace(quiet='--quiet' in sys.argv), after=0.0) as stage:
    stage('reading')
    sys.stdin.readline()
    stage('fitting')
    sys.stdin.readline()
warn('by the way')
"""


@pytest.mark.parametrize('quiet', [True, False])
def test_a_log_has_a_line_a_stage(capsys, quiet):
    with stages(Namespace(quiet=quiet)) as stage:
        stage('reading')
        stage('fitting')
    assert capsys.readouterr().err.splitlines() == ([] if quiet else [
        'forcecal: note: reading', 'forcecal: note: fitting'])


def on_terminal(*options, until=()):
    """Return what a terminal is sent by work that goes on when each of some words is there."""
    ours, theirs = pty.openpty()
    said = b''
    with subprocess.Popen([sys.executable, '-c', WORK, *options], stdin=subprocess.PIPE,
                          stderr=theirs) as process:
        os.close(theirs)
        for word in until:
            while word not in said:
                said += os.read(ours, 4096)
            process.stdin.write(b'\n')
            process.stdin.flush()
        process.stdin.close()
        try:
            while part := os.read(ours, 4096):
                said += part
        except OSError:  # the other end is closed
            os.close(ours)
    assert process.returncode == 0
    return said.decode().split(CLEAR)


def test_a_terminal_has_one_line_that_changes_and_goes():
    *lines, note = on_terminal(until=(b's  reading', b's  fitting'))
    assert all(line == '' or line.endswith((' s  reading', ' s  fitting')) for line in lines)
    assert note == 'forcecal: note: by the way\r\n'


def test_a_terminal_that_wants_quiet_has_it():
    assert on_terminal('--quiet') == ['', 'forcecal: note: by the way\r\n']
