"""A machine that lacks something says so in one line with what brings it, and no traceback."""

import os
from pathlib import Path
import re
import subprocess
import sys
import sysconfig

from longer import first
import pytest

ROOT = Path(__file__).resolve().parents[2]
ROS = re.compile(r'rclpy|.+_msgs|std_srvs|builtin_interfaces|rosidl_.+|rpyutils')


@pytest.fixture(scope='module')
def lacking(tmp_path_factory):
    """Return what runs ``forcecal`` with all packages but some, for real: links to the others."""
    def run(pattern, *arguments, **environment):
        folder = tmp_path_factory.mktemp('packages')
        for entry in Path(sysconfig.get_path('purelib')).iterdir():
            if not pattern.fullmatch(entry.name):
                (folder / entry.name).symlink_to(entry)
        # -S: no site-packages but these
        return subprocess.run(
            [sys.executable, '-S', '-m', 'forcecal_ros.cli.main', *map(str, arguments)],
            cwd=folder, env={**os.environ, 'PYTHONPATH': f'{ROOT}:{folder}', **environment},
            capture_output=True, text=True, check=False)
    return run


def only_line(done):
    assert done.returncode == 1 and done.stdout == ''
    assert done.stderr.startswith('forcecal: ') and done.stderr.count('\n') == 1, done.stderr
    return done.stderr


@pytest.mark.parametrize('command', first(['demo', 'play bag', 'record -o out']))
def test_without_ros_its_commands_say_what_brings_it(lacking, command):
    said = only_line(lacking(ROS, *command.split()))
    assert 'ROS 2 is not available' in said
    assert 'setup.bash' in said or re.search(r'-m pip install .*ros-jazzy-rclpy', said)


def test_without_distributed_a_cluster_is_refused_with_what_installs_it(lacking, tmp_path):
    said = only_line(lacking(re.compile('distributed.*'), 'calibrate', 'one', 'two', '--dask',
                             'tcp://host:8786', '-o', tmp_path / 'out'))
    assert '--dask requires the Python package distributed' in said
    assert re.search(r"-m pip install '?distributed", said)


def test_where_the_home_cannot_be_written_to_logs_go_elsewhere(ros_domain, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != 'ROS_LOG_DIR'}
    done = subprocess.run(
        [sys.executable, '-m', 'forcecal_ros.cli.main', 'record', '-o', tmp_path / 'out',
         '--duration', '0.5'], capture_output=True, text=True, check=False,
        env={**environment, 'HOME': '/proc', 'TMPDIR': str(tmp_path)})
    note, complaint = done.stderr.splitlines()
    assert '/proc/.ros/log cannot be written to; logs go to' in note
    assert 'no message was received on any topic' in complaint and done.returncode == 1
