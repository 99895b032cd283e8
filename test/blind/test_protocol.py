"""Sealing and opening: what the protocol forbids, and that a killed run goes on."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
import time

from blind import seal
from blind.score import wilson
import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.long

TOOL = {'commit': 'abc', 'thresholds': 'def', 'changed': ''}


def _made(where, seeds):
    seal.prepare(where / 'run', where / 'labels', seeds, 2, 20.0)
    for job in seal.jobs(where / 'run', where / 'labels'):
        seal.make(job)


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    where = tmp_path_factory.mktemp('blind')
    _made(where, seal.SEALED)
    seal.seal(where / 'run', where / 'labels')
    return where


@pytest.fixture
def where(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / 'copy'))


def _answer(where, count=2):
    seal.start(where / 'run', TOOL)
    for one in seal.waiting(where / 'run')[:count]:
        seal.write_json(where / 'run' / 'results' / f'{one}.json', {'document': {}})


def _open(where):
    return seal.open_labels(where / 'run', where / 'labels', where / 'openings.jsonl')


def _refused(said, function, *given):
    with pytest.raises(seal.SealError, match=said):
        function(*given)


def test_labels_stay_closed_until_every_result_is_there_by_one_tool(where, tmp_path):
    _refused('labels lie apart', seal.prepare, tmp_path / 'run', tmp_path / 'run' / 'labels',
             seal.SEALED, 2, 20.0)
    _answer(where, 1)
    _refused('1 of 2 results are missing', _open, where)
    _refused('begun with another tool', seal.start, where / 'run', {**TOOL, 'commit': 'xyz'})
    _answer(where)
    assert len(_open(where)) == 2
    _refused('labels are open', seal.start, where / 'run', TOOL)
    (where / 'run' / 'commitments.json').unlink()
    _refused('not sealed', seal.start, where / 'run', TOOL)


def test_second_opening_of_the_same_seeds_is_refused(where, tmp_path):
    _answer(where)
    copy = Path(shutil.copytree(where, tmp_path / 'again'))
    _open(where)
    _refused('opened before', _open, where)
    shutil.copy(where / 'openings.jsonl', copy)
    _refused('opened before', _open, copy)


def test_changed_label_is_found(where):
    _answer(where)
    path = next(one for one in (where / 'labels').glob('*.json') if one.name != 'master.json')
    entry = json.loads(path.read_text())
    entry['label']['kind'] = 'none' if entry['label']['kind'] != 'none' else 'single'
    path.write_text(json.dumps(entry))
    _refused('not the one that was committed to', _open, where)


def test_changed_case_is_found(where):
    path = next((where / 'run' / 'cases').glob('[!.]*.npz'))
    path.write_bytes(path.read_bytes() + b'\0')
    seal.start(where / 'run', TOOL)
    _refused('not the one that was committed to', seal.waiting, where / 'run')


def test_run_tells_nothing_of_its_labels(made):
    master = json.loads((made / 'labels' / 'master.json').read_text())['master']
    told = b''.join(path.read_bytes() for path in (made / 'run').glob('*.json'))
    assert master.encode() not in told
    assert (made / 'labels' / 'master.json').stat().st_mode & 0o077 == 0
    for path in (made / 'labels').glob('*.json'):
        assert path.name == 'master.json' or json.loads(
            path.read_text())['nonce'].encode() not in told


def test_killed_run_goes_on_to_the_same_cases(tmp_path):
    run, labels = tmp_path / 'run', tmp_path / 'labels'
    command = [sys.executable, str(ROOT / 'benchmark' / 'blind_check.py'), '--seeds',
               'development', '2', '--seconds', '20', '--run', str(run), '--labels', str(labels),
               '--until', 'made', '--jobs', '1']
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 400
    while not list((run / 'cases').glob('[!.]*.npz')) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.kill()
    process.wait()
    first = {path: path.read_bytes() for path in (run / 'cases').glob('[!.]*.npz')}
    assert not (run / 'commitments.json').exists()
    subprocess.run(command, env=environment, check=True, stderr=subprocess.DEVNULL)
    bound = json.loads((run / 'commitments.json').read_text())
    assert {path.stem for path in (run / 'cases').glob('[!.]*.npz')} == set(bound)
    assert len(bound) == 2 and all(path.read_bytes() == data for path, data in first.items())


def test_eight_false_alarms_of_two_hundred_stay_below_eight_percent():
    low, high = wilson(8, 200)
    assert low == pytest.approx(0.0204, abs=2e-4) and high == pytest.approx(0.0769, abs=2e-4)
