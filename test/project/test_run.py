"""``./run`` sets up once, keeps two ROS 2 installations apart, and says in a line what failed.

The set-up itself runs for real before any test can; here an interpreter of a few shell lines
notes what it is asked to install.
"""

from pathlib import Path
import shutil
import subprocess

import pytest

ROOT = Path(__file__).resolve().parents[2]
PYTHON = r"""#!/bin/sh
case "$*" in
    *platform*) echo 3.12.0 ;;
    "-m venv "*)
        for venv; do :; done
        mkdir -p "$venv/bin"
        cp "$0" "$venv/bin/python"
        touch "$venv/pyvenv.cfg"
        printf '#!/bin/sh\necho "$0 $*"; env\n' >"$venv/bin/forcecal"
        chmod +x "$venv/bin/forcecal" ;;
    "-m pip install "*)
        echo "$*" >>"$HOME/pip.log"
        [ -z "$FAIL" ] || { echo "ERROR: $FAIL"; exit 1; } ;;
esac
"""
SOURCED = {
    'AMENT_PREFIX_PATH': '/opt/ros/humble', 'LD_LIBRARY_PATH': '/opt/ros/humble/lib',
    'PYTHONPATH': '/opt/ros/humble/lib/python3.10/site-packages', 'ROS_DISTRO': 'humble',
    'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp', 'ROS_DOMAIN_ID': '7',
}


class Newcomer:
    """Someone with a fresh copy of the project and one Python."""

    def __init__(self, home):
        self.home, self.project = home, home / 'a project'
        for folder in (self.project, home / 'bin'):
            folder.mkdir()
        for name in ('run', 'setup.py', 'setup.cfg'):
            shutil.copy2(ROOT / name, self.project)
        (home / 'bin' / 'python3.12').write_text(PYTHON)
        (home / 'bin' / 'python3.12').chmod(0o755)

    def runs(self, *arguments, **environment):
        path = f'{self.home}/bin:/usr/bin:/bin'
        return subprocess.run(
            [self.project / 'run', *arguments], cwd=self.home, capture_output=True, text=True,
            check=False, env={'HOME': str(self.home), 'PATH': path, 'FORCECAL_ROS': 'wheels',
                              **environment})

    @property
    def installed(self):
        log = self.home / 'pip.log'
        return [line.rpartition(' ')[2] for line in log.read_text().splitlines()]


@pytest.fixture
def newcomer(tmp_path):
    """Return someone who has just cloned the project."""
    return Newcomer(tmp_path)


def test_second_run_installs_nothing_until_the_set_up_changes(newcomer):
    for _ in range(2):
        assert newcomer.runs('demo', '--out', 'x').returncode == 0
    assert newcomer.installed == ['.[ros,plots,mujoco]']
    with (newcomer.project / 'setup.py').open('a') as file:
        file.write('# another requirement\n')
    newcomer.runs('demo')
    assert newcomer.installed == ['.[ros,plots,mujoco]', '.[ros,plots,mujoco]']


def test_tests_bring_their_tools_and_the_demo_needs_no_less_afterwards(newcomer):
    for purpose in ('demo', 'test', 'demo'):
        assert newcomer.runs(purpose).returncode == 0
    assert newcomer.installed == ['.[ros,plots,mujoco]', '.[ros,plots,mujoco,test]']


def test_project_that_was_moved_is_set_up_again(newcomer):
    newcomer.runs('demo')
    newcomer.project = newcomer.project.rename(newcomer.home / 'elsewhere')
    done = newcomer.runs('demo')
    assert 'making .venv' in done.stderr
    assert done.stdout.startswith(str(newcomer.home / 'elsewhere'))


def test_arguments_and_folder_reach_the_command(newcomer):
    out = newcomer.runs('estimate', 'my bag', '-o', 'x').stdout
    assert out.startswith(f'{newcomer.project}/.venv/bin/forcecal estimate my bag -o x\n')
    assert f'PWD={newcomer.home}\n' in out


def test_commands_that_are_printed_begin_as_this_one_did(newcomer):
    out = newcomer.runs('help').stdout
    assert out.startswith(f'{newcomer.project}/.venv/bin/forcecal --help\n')
    command = str(newcomer.project / 'run').replace(' ', '\\ ')
    assert f'FORCECAL_COMMAND={command}\n' in out
    assert './run help' in newcomer.runs('--help').stdout


def test_wheels_never_see_a_distribution_that_the_shell_has_sourced(newcomer):
    out = newcomer.runs('demo', **SOURCED).stdout
    assert '/opt/ros' not in out
    assert 'RMW_IMPLEMENTATION' not in out
    assert 'ROS_DOMAIN_ID=7' in out


def test_failed_set_up_ends_in_one_line_and_is_tried_again(newcomer):
    done = newcomer.runs('demo', FAIL='no matching distribution')
    assert done.returncode == 1
    assert 'pip failed: no matching distribution' in done.stderr.splitlines()[-1]
    assert newcomer.runs('demo').returncode == 0
    assert len(newcomer.installed) == 2


@pytest.mark.parametrize('linked', [True, False])
def test_an_environment_of_another_project_and_other_files_are_not_erased(newcomer, linked):
    kept, venv = newcomer.home / 'other' / 'kept', newcomer.project / '.venv'
    kept.parent.mkdir()
    kept.touch()
    if linked:
        (kept.parent / 'pyvenv.cfg').touch()
        venv.symlink_to(kept.parent)
    else:
        kept.parent.rename(venv)
        kept = venv / 'kept'
    done = newcomer.runs('demo')
    assert done.returncode == 1 and kept.exists()
    assert ('.venv is a link to' if linked else 'not a virtual environment') in done.stderr


def test_place_without_ros_is_refused(newcomer):
    done = newcomer.runs('demo', FORCECAL_ROS='/nowhere')
    assert done.returncode == 1
    assert 'FORCECAL_ROS=/nowhere: no setup.bash' in done.stderr


def test_wrong_use_tells_the_right_one(newcomer):
    done = newcomer.runs()
    assert done.returncode == 2
    assert done.stderr.startswith('usage: ./run demo')


def test_several_workers_know_which_tests_stay_together(request):
    if not hasattr(request.config, 'workerinput'):
        pytest.skip('only where the tests run on several workers')
    assert request.node.nodeid.endswith('@project/test_run')
