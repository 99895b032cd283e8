"""colcon builds and tests the package, and its executables run from where ``ros2 run`` looks."""

import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

from forcecal_ros.cli.node import NODES
import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = 'forcecal_ros'
START_SECONDS = 300.0

pytestmark = [pytest.mark.workspace, pytest.mark.long]


def _colcon(workspace, *arguments):
    program = shutil.which('colcon', path=f'{Path(sys.executable).parent}:{os.environ["PATH"]}')
    done = subprocess.run([program, '--log-base', 'log', *arguments], cwd=workspace,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def workspace(tmp_path_factory, project_files):
    """Return a workspace in which colcon built a copy of this tree."""
    pytest.importorskip('colcon_core')
    workspace = tmp_path_factory.mktemp('workspace')
    for path in project_files:
        copy = workspace / 'src' / PACKAGE / path
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, copy, follow_symlinks=False)
    _colcon(workspace, 'build', '--packages-select', PACKAGE)
    return workspace


def _start(workspace, name, *arguments):
    """Start an executable as ``ros2 run`` does in a shell that has sourced the workspace."""
    program = workspace / 'install' / PACKAGE / 'lib' / PACKAGE / name
    return subprocess.Popen(
        ['bash', '-c', '. install/local_setup.bash; exec "$@"', 'bash', program, *arguments],
        cwd=workspace, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True)


@pytest.fixture(scope='module')
def heard(ros_domain_of_module):
    """Spin a node that listens to diagnostics; return a function of the names it heard so far."""
    from diagnostic_msgs.msg import DiagnosticArray
    import rclpy
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('onlooker', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    names = set()

    def hear(message):
        names.update(status.name for status in message.status)

    node.create_subscription(DiagnosticArray, 'diagnostics', hear, 10)

    def so_far():
        executor.spin_once(timeout_sec=0.1)
        return names

    yield so_far
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture(scope='module')
def running(workspace, heard):
    """Return a function that starts a node, and kill those that are left."""
    processes = []

    def start(name):
        processes.append(_start(workspace, name))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.wait()


def test_command_runs_from_the_workspace(workspace):
    process = _start(workspace, 'forcecal', '--help')
    out, err = process.communicate(timeout=START_SECONDS)
    assert process.returncode == 0, err
    assert 'calibrate' in out


def test_every_executable_is_where_ros2_run_looks_and_in_no_path(workspace):
    install = workspace / 'install' / PACKAGE
    assert {path.name for path in (install / 'lib' / PACKAGE).iterdir()} == {'forcecal', *NODES}
    assert not (install / 'bin').exists()


def test_workspace_uses_its_own_copy(workspace):
    script = f'. install/local_setup.bash; python -c "import {PACKAGE}; print({PACKAGE}.__file__)"'
    path = f'{Path(sys.executable).parent}:{os.environ["PATH"]}'
    out = subprocess.run(['bash', '-c', script], cwd=workspace, capture_output=True, text=True,
                         env={**os.environ, 'PATH': path}, check=True).stdout
    assert Path(out.strip()).is_relative_to(workspace / 'install')


@pytest.mark.parametrize('name', ['observer', 'impedance', 'sequencer', 'sim'])
def test_node_starts_and_ends_cleanly_when_interrupted(running, heard, name):
    process, end = running(name), time.monotonic() + START_SECONDS
    while name not in heard():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, f'{name} says nothing after {START_SECONDS} s'
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=START_SECONDS)
    assert process.returncode == 0, err
    assert 'Traceback' not in err


def test_share_holds_what_launch_files_and_tools_look_for(workspace):
    share = workspace / 'install' / PACKAGE / 'share' / PACKAGE
    for folder in ('config', 'launch', 'layouts'):
        wanted = {path.name for path in (ROOT / folder).glob('*.*')}
        assert wanted <= {path.name for path in share.glob(f'{folder}/*')}
    assert (share / 'package.xml').is_file()


def test_colcon_test_finds_the_tests(workspace):
    _colcon(workspace, 'test', '--packages-select', PACKAGE, '--return-code-on-test-failure',
            '--pytest-args', 'test/project/test_packaging.py', '-k', 'test_version_is_the_same')
    result = _colcon(workspace, 'test-result', '--all')
    assert 'Summary: 1 test, 0 errors, 0 failures, 0 skipped' in result
