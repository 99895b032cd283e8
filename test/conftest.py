"""Fixtures of general use: where recorded data is, and a DDS domain of one's own."""

from contextlib import redirect_stdout
import fcntl
from io import StringIO
import os
from pathlib import Path
import re
import shutil
import subprocess

from hypothesis import settings
from machine import machine
from processes import own_domain
import pytest

# small matrices are slower on two threads than on one, many times so where cores are busy
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

settings.register_profile('same_everywhere', derandomize=True, deadline=None, max_examples=30)
settings.load_profile('same_everywhere')

ROOT = Path(__file__).resolve().parents[1]

GIVING_WAY = 10
"""Niceness of what computes only: a tenth of the weight of what has to answer in time."""

SHARED = 'PYTEST_XDIST_WORKER' in os.environ
"""Whether another worker may have the machine, too."""

NO_DATA = 'wants recordings that are not here: '
FETCH = {
    'kuka_lbr_med': 'Zenodo record 11096791 as $FORCECAL_DATA/kuka_lbr_med',
    'icub_foot': "the log of an iCub's foot in the air as $FORCECAL_DATA/icub_foot",
    'rig_sample': 'a run of the rig by other code as $FORCECAL_RIG_SAMPLE'}
"""Where recordings that only others can make come from, and where they are looked for."""

GENERATED = re.compile(r'(__pycache__|build|install|log|dist|.+\.egg-info|\.(?!ci|gitignore).+)')


def _is_live(item) -> bool:
    return bool(item.get_closest_marker('live')) or any(
        name.startswith('ros_domain') for name in item.fixturenames)


@pytest.hookimpl(tryfirst=True)  # before the workers look at the groups
def pytest_collection_modifyitems(items):
    """Begin with what waits for nodes, on two workers of several, and with what takes longest."""
    names = sorted({item.location[0] for item in items if _is_live(item)})
    live = {name: f'live {i % 2}' for i, name in enumerate(names)}
    for item in items:
        name = item.location[0]
        if _is_live(item):
            item.add_marker(pytest.mark.flaky(reruns=2, condition=SHARED))
        if name in live:  # whose module fixtures are made once
            item.add_marker(pytest.mark.with_live)
        group = name.removeprefix('test/').removesuffix('.py')
        item.add_marker(pytest.mark.xdist_group(live.get(name, group)))
    items.sort(key=lambda item: (item.location[0] not in live,
                                 not item.get_closest_marker('lint')))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Let the worker that runs no nodes give way to those that have to keep up with a clock."""
    if SHARED and not item.get_closest_marker('with_live') and not os.nice(0):
        os.nice(GIVING_WAY)


@pytest.fixture(autouse=True)
def _machine(request):
    """Run a live test that failed beside others again, without them: that counts."""
    if not SHARED:
        yield
        return
    with machine(alone=getattr(request.node, 'execution_count', 1) > 1):
        yield


def _recorded_elsewhere(variable: str, default: str, what: str) -> Path:
    path = Path(os.environ.get(variable, ROOT.parent / 'shared' / default))
    path = path / what if variable == 'FORCECAL_DATA' else path
    if not path.is_dir():
        pytest.skip(f'{NO_DATA}{what}')
    return path


@pytest.fixture(scope='session')
def kuka_data():
    """Return the recordings of a KUKA arm, below ``$FORCECAL_DATA`` or ``../shared/data``."""
    return _recorded_elsewhere('FORCECAL_DATA', 'data', 'kuka_lbr_med')


@pytest.fixture(scope='session')
def icub_data():
    """Return the recording of an iCub's foot, below ``$FORCECAL_DATA`` or ``../shared/data``."""
    return _recorded_elsewhere('FORCECAL_DATA', 'data', 'icub_foot')


@pytest.fixture(scope='session')
def rig_sample():
    """Return the rig by other code: ``$FORCECAL_RIG_SAMPLE`` or ``../shared/rig_sample``."""
    return _recorded_elsewhere('FORCECAL_RIG_SAMPLE', 'rig_sample', 'rig_sample')


@pytest.fixture(scope='session')
def once(tmp_path_factory):
    """Return a function that lets one worker fill a folder for all; the others wait for it."""
    root = tmp_path_factory.getbasetemp()
    root = root.parent if SHARED else root

    def folder(name, fill):
        with (root / f'{name}.lock').open('w') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (root / name).exists():
                (root / f'{name}.begun').mkdir()
                fill(root / f'{name}.begun')
                (root / f'{name}.begun').rename(root / name)
        return root / name

    return folder


@pytest.fixture(scope='session', autouse=True)
def _compiled(once):
    """Compile what most tests run in one worker, and meanwhile something else in another."""
    if SHARED:
        parts = [_compile_rig, _compile_observer]
        for part in parts if os.environ['PYTEST_XDIST_WORKER'] != 'gw1' else parts[::-1]:
            once(part.__name__, part)


def _compile_rig(_):
    from rig_recordings import FREE, own_recording
    own_recording(parts=FREE[:1])


def _compile_observer(_):
    from forcecal_ros.observe import replay
    from observing import calibration, record
    replay(record(0.1), calibration())


@pytest.fixture(scope='session')
def brief(once):
    """Return a folder with ``bag``, a brief run at 250 Hz, and its ``c.yaml``, json and html."""
    from calibration_runs import brief_run
    from forcecal_ros.cli.main import main
    from forcecal_ros.io.bags import write_recording

    def fill(folder):
        write_recording(folder / 'bag', brief_run())
        with redirect_stdout(StringIO()) as said:
            assert main(['calibrate', str(folder / 'bag'), '-o', str(folder / 'c.yaml'), '--json',
                         '--report', str(folder / 'c.html')]) == 0
        (folder / 'c.json').write_text(said.getvalue())

    return once('brief', fill)


@pytest.fixture(scope='session')
def second_rig(once):
    """Return a folder with ``bag`` and ``clean.npz``: the same motion run by the second rig."""
    if not (ROOT / 'benchmark' / 'blind').is_dir():
        pytest.skip('the second rig is not part of what is installed')
    from rig_recordings import write_second
    return once('second_rig', write_second)


@pytest.fixture(scope='session', params=[
    'second_rig', pytest.param('rig_sample', marks=pytest.mark.long)])
def other_rig(request):
    """Return a folder with ``bag`` and ``clean.npz``, by each code that is not this package's."""
    return request.getfixturevalue(request.param)


def pytest_terminal_summary(terminalreporter):
    """Say in one line how many tests were skipped for want of data, and what to fetch."""
    reasons = [report.longrepr[2] for report in terminalreporter.stats.get('skipped', ())
               if NO_DATA in report.longrepr[2]]
    wanted = [where for name, where in FETCH.items()
              if any(reason.endswith(name) for reason in reasons)]
    if reasons:
        terminalreporter.write_line(
            f'{len(reasons)} tests were skipped for want of recordings; fetch '
            + '; '.join(wanted))


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


@pytest.fixture
def ros_domain(tmp_path):
    """Keep a DDS domain for this test, its child processes included."""
    with own_domain(tmp_path / 'ros_log') as domain:
        yield domain


@pytest.fixture(scope='module')
def ros_domain_of_module(tmp_path_factory):
    """Keep a domain for all tests of a module, whose nodes then start only once."""
    with own_domain(tmp_path_factory.mktemp('ros_log')) as domain:
        yield domain
