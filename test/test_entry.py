"""Installed commands: what a signal does while they are being loaded, and while they work."""

import os
import signal
import subprocess
import sys

from longer import first
import pytest

INTERRUPTED = """
import builtins, os, signal, sys
original = builtins.__import__
def interrupt(name, *rest):
    if name == {module!r}:
        os.kill(os.getpid(), signal.SIGINT)
    return original(name, *rest)
builtins.__import__ = interrupt
from forcecal_ros.entry import {command}
sys.exit({command}())
"""


@pytest.mark.parametrize('command, module, status', [
    ('forcecal', 'argparse', 130), ('observer', 'numpy', 0)])
def test_a_signal_in_the_midst_of_an_import_prints_nothing(command, module, status):
    done = subprocess.run(
        [sys.executable, '-c', INTERRUPTED.format(command=command, module=module)],
        capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (status, '', '')


def test_a_signal_while_a_node_reads_its_parameters_prints_nothing(tmp_path):
    os.mkfifo(tmp_path / 'a.yaml')
    with subprocess.Popen(
            ['env', '--default-signal', sys.executable, '-c',
             'import sys; from forcecal_ros.entry import observer; sys.exit(observer())',
             '--ros-args', '--params-file', 'a.yaml'], cwd=tmp_path,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as node:
        with (tmp_path / 'a.yaml').open('w'):
            node.send_signal(signal.SIGINT)
            said = node.communicate(timeout=60)
    assert (node.returncode, said) == (0, ('', ''))


def test_a_command_line_that_is_loaded_is_run():
    done = subprocess.run(
        [sys.executable, '-c', 'from forcecal_ros.entry import forcecal; exit(forcecal())',
         '--version'],
        capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.startswith('forcecal ')


@pytest.mark.parametrize('number', first([signal.SIGINT, signal.SIGTERM, signal.SIGHUP]))
def test_whatever_ends_a_command_is_told_in_one_line_and_leaves_nothing(tmp_path, number):
    os.mkfifo(tmp_path / 'list')
    with subprocess.Popen(
            # in the background a shell lets its commands ignore SIGINT
            ['env', '--default-signal', sys.executable, '-m', 'forcecal_ros.cli.main', 'calibrate',
             '@list', '-o', 'out'], cwd=tmp_path,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as command:
        with (tmp_path / 'list').open('w'):  # once it is read, the command is at work
            command.send_signal(number)
            said = command.communicate(timeout=60)
    assert (command.returncode, said) == (128 + number, ('', 'forcecal: interrupted\n'))
    assert os.listdir(tmp_path) == ['list']


def test_results_that_a_signal_interrupts_leave_no_scratch(tmp_path):
    script = """if True:
        import os, signal, sys
        from forcecal_ros.cli import main as cli
        from forcecal_ros.core.files import new_directory
        def run(args):
            with new_directory('out') as scratch:
                scratch.mkdir()
                os.kill(os.getpid(), signal.SIGTERM)
        sys.exit(cli.main([], lambda words: cli.argparse.Namespace(run=run)))"""
    done = subprocess.run([sys.executable, '-c', script], cwd=tmp_path, capture_output=True,
                          text=True, check=False)
    assert (done.returncode, done.stderr) == (143, 'forcecal: interrupted\n')
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize('call, package', [
    ('entry.sim()', 'numba'), ("cli.main(['node', 'gap'])", 'numba'),
    ("cli.main(['calibrate', '.'])", 'lz4')])
def test_what_apt_does_not_have_is_named_in_one_line(call, package):
    code = ('import sys; from forcecal_ros import entry; '
            'from forcecal_ros.cli import main as cli; '
            'from forcecal_ros.core.extras import BESIDE_APT; '
            f'sys.modules.update(dict.fromkeys(BESIDE_APT)); sys.exit({call})')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                          check=False)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1
    assert f'{package} is not installed' in line and f'pip install {package}' in line
