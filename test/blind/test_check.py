"""The blind check from end to end, short: twelve cases through the tool, opened and scored."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.timeout(1800), pytest.mark.long]
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp('blind') / 'run'
    done = subprocess.run(
        [sys.executable, str(ROOT / 'benchmark' / 'blind_check.py'), '--seeds', 'development',
         '12', '--seconds', '20', '--bags', '1', '--jobs', '1', '--run', str(folder)],
        env={**os.environ, 'PYTHONPATH': str(ROOT)}, capture_output=True, text=True,
        check=False)
    assert done.returncode == 0, done.stderr
    return folder


def _results(run):
    return {path.stem: json.loads(path.read_text()) for path in (run / 'results').glob('*')}


def test_no_case_crashes_the_tool(run):
    results = _results(run)
    assert len(results) == 12
    assert not [one for one in results.values() if one['document']['verdict'] == 'crashed']
    assert sorted(one['route'] for one in results.values()).count('bags') == 1


def test_ten_of_twelve_verdicts_are_right(run):
    said = next(line for line in (run / 'RESULTS.md').read_text().splitlines()
                if line.startswith('Verdicts right'))
    right = int(said.removeprefix('Verdicts right: ').split()[0])
    assert right >= 10, (run / 'RESULTS.md').read_text()


def test_results_were_written_before_labels_were_opened(run):
    opened = (run / 'opened.json').stat().st_mtime_ns
    assert all(path.stat().st_mtime_ns < opened for path in (run / 'results').glob('*'))
    assert all((run / name).stat().st_mtime_ns < path.stat().st_mtime_ns
               for name in ('commitments.json', 'run.json')
               for path in (run / 'results').glob('*'))


def test_pictures_are_drawn(run):
    assert {'detection.png', 'confusion.png', 'reliability.png'} <= {
        path.name for path in run.iterdir()}
