"""Fixtures of general use: where recorded data is, and a DDS domain of one's own."""

from contextlib import contextmanager
import os
from pathlib import Path
import random
import re
import shutil
import socket
import subprocess

from hypothesis import settings
import pytest

# small matrices are slower on two threads than on one, many times so where cores are busy
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

settings.register_profile('same_everywhere', derandomize=True, deadline=None)
settings.load_profile('same_everywhere')

ROOT = Path(__file__).resolve().parents[1]
GENERATED = re.compile(r'(__pycache__|build|install|log|dist|.+\.egg-info|\.(?!ci|gitignore).+)')


@pytest.hookimpl(tryfirst=True)  # before the workers look at the groups
def pytest_collection_modifyitems(items):
    """Keep what runs nodes to one worker of several, where it has the DDS traffic to itself."""
    for item in items:
        live = item.get_closest_marker('live') or any(
            name.startswith('ros_domain') for name in item.fixturenames)
        item.add_marker(pytest.mark.xdist_group('live' if live else str(item.path)))


def _shared(variable: str, name: str) -> Path:
    path = Path(os.environ.get(variable, ROOT.parent / 'shared' / name))
    if not path.is_dir():
        pytest.skip(f'{path} is absent; set {variable} to a copy')
    return path


@pytest.fixture(scope='session')
def data_dir():
    """Return where recordings of real sensors are: ``$FORCECAL_DATA`` or ``../shared/data``."""
    return _shared('FORCECAL_DATA', 'data')


@pytest.fixture(scope='session')
def rig_sample():
    """Return where the rig recording is: ``$FORCECAL_RIG_SAMPLE`` or ``../shared/rig_sample``."""
    return _shared('FORCECAL_RIG_SAMPLE', 'rig_sample')


@pytest.fixture(scope='session')
def project_files():
    """Paths below the project's root of all that belongs to it, links as links."""
    if (ROOT / '.git').exists() and shutil.which('git'):
        names = subprocess.run(
            ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
            cwd=ROOT, check=True, capture_output=True, text=True).stdout.split('\0')
        paths = {Path(name) for name in names if name}
    else:
        paths = {path.relative_to(ROOT) for path in ROOT.rglob('*')
                 if not path.is_dir() or path.is_symlink()}
    return sorted(path for path in paths if os.path.lexists(ROOT / path)
                  and not any(GENERATED.fullmatch(part) for part in path.parts))


@contextmanager
def _ros_domain(log_dir):
    with (pytest.MonkeyPatch.context() as monkeypatch,
          socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reservation):
        for domain in random.sample(range(1, 102), 101):
            try:
                reservation.bind(f'\0forcecal-test-domain-{domain}')
                break
            except OSError:
                continue
        else:
            pytest.fail('all DDS domains from 1 to 101 are taken by other tests')
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        monkeypatch.setenv('ROS_LOG_DIR', str(log_dir))
        yield domain


@pytest.fixture
def ros_domain(tmp_path):
    """
    Keep this test's nodes, child processes included, to themselves.

    Domains 1 to 101 have ports below Linux's ephemeral ones. A name in the abstract socket
    namespace reserves one among all tests on this machine, and vanishes with the process.
    """
    with _ros_domain(tmp_path / 'ros_log') as domain:
        yield domain


@pytest.fixture(scope='module')
def ros_domain_of_module(tmp_path_factory):
    """Keep a domain for all tests of a module, whose nodes then start only once."""
    with _ros_domain(tmp_path_factory.mktemp('ros_log')) as domain:
        yield domain
