"""The package works with each Python that ``./run`` takes and that is on this machine."""

import json
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = f'3.{sys.version_info.minor}'
VERSIONS = [f'3.{minor}' for minor in range(10, 15) if f'3.{minor}' != HERE]

IMPORTS = """
import importlib, pkgutil, forcecal_ros
for module in pkgutil.walk_packages(forcecal_ros.__path__, 'forcecal_ros.'):
    if module.name != 'forcecal_ros.nodes.launching':  # of a launch file, which pip does not bring
        importlib.import_module(module.name)
"""


def interpreter(version):
    """Return the path of a Python of a version; None where it is not here."""
    places = Path.home().glob(f'.pyenv/versions/{version}.*/bin/python{version}')
    return shutil.which(f'python{version}') or next(map(str, places), None)


@pytest.mark.long
@pytest.mark.workspace
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('version', VERSIONS)
def test_a_rig_is_calibrated_and_diagnosed(version, tmp_path):
    python = interpreter(version)
    if not python:
        pytest.skip(f'python{version} is not on this machine')

    def run(*command):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    run(python, '-m', 'venv', 'venv')
    venv = tmp_path / 'venv' / 'bin'
    run(venv / 'python', '-m', 'pip', 'install', '-q', f'{ROOT}[ros,plots,mujoco]')
    run(venv / 'python', '-c', IMPORTS)
    run(venv / 'forcecal', 'sample', 'rig', '-o', 'rig')
    tool = json.loads(run(venv / 'forcecal', 'calibrate', 'rig/sound', '--json', '-o', 'c.yaml'))
    assert tool['mass']['value'] == pytest.approx(13.0, abs=0.005)
    gap = json.loads(run(venv / 'forcecal', 'diagnose', 'rig/late', '--json', '-o', 'why'))
    assert gap['verdict'] == 'identified'
    assert [effect['name'] for effect in gap['effects']] == ['wrench_delay']
