"""The commands of the pages as they stand, one after the other, and the answers they promise."""

from pathlib import Path
import re
import shlex
import shutil
import subprocess
import sys

import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs'
FIRST = 'tutorials/first-calibration.md'
ANSWER = re.compile(r'^(identified: \w+|no_gap)', re.MULTILINE)
HOW_TO = {
    'tutorials/simulation-gap.md': {}, 'how-to/plan.md': {}, 'how-to/ros2-control.md': {},
    'how-to/no-rest.md': {'BAG': 'rig/sound'}, 'how-to/fleet.md': {'BAG': 'rig/sound'},
    'how-to/mujoco.md': {'BAG': 'arm/heavier', 'arm.xml': 'arm/rigid_arm.xml'}}
"""Page, and what its words in capitals are in the folder of samples."""


def blocks(page):
    """Return the indented blocks of a page, without those that require a second terminal."""
    found = re.findall(r'(?:^    .+\n)+', (DOCS / page).read_text(), re.MULTILINE)
    return ['\n'.join(line for line in block.splitlines() if 'ros2 ' not in line)
            for block in found]


def steps(page):
    """Yield each command, and the answer that stands in the block after it, if there is one."""
    every = blocks(page)
    for block, then in zip(every, [*every[1:], '']):
        lines = [line.strip() for line in block.splitlines()]
        promised = ANSWER.search('\n'.join(line.strip() for line in then.splitlines()))
        for line in lines:
            if line.startswith('forcecal '):
                yield line, promised[1] if promised and line == lines[-1] else ''


def run(words, folder):
    """Run a command in a folder and return what it prints."""
    done = subprocess.run([sys.executable, '-m', 'forcecal_ros.cli.main', *words], cwd=folder,
                          capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, f'{words}\n{done.stderr}'
    return done.stdout


def test_the_page_has_commands_and_promises():
    every = list(steps(FIRST))
    assert [line.split()[1] for line, _ in every] == [
        'demo', 'calibrate', 'estimate', 'play', 'export', 'export', 'sample', 'diagnose',
        'diagnose']
    assert [promised for *_, promised in every][-2:] == ['identified: wrench_delay', 'no_gap']


@pytest.mark.long
@pytest.mark.live
def test_every_command_answers_what_the_page_says(tmp_path):
    for line, promised in steps(FIRST):
        said = run(shlex.split(line, comments=True)[1:], tmp_path)
        assert said.startswith(promised), f'{line}\n{said}'


@pytest.fixture(scope='module')
def samples(tmp_path_factory):
    folder = tmp_path_factory.mktemp('samples')
    run(['sample', 'rig', '-o', 'rig'], folder)
    run(['sample', 'rigid_arm', '-o', 'arm'], folder)
    run(['calibrate', 'rig/sound', '-o', 'calibration.yaml', '--quiet'], folder)
    return folder


@pytest.mark.long
@pytest.mark.parametrize('page', HOW_TO)
def test_every_command_of_a_page_runs(page, samples, tmp_path):
    shutil.copy(samples / 'calibration.yaml', tmp_path)
    for folder in re.findall(r'^ +mkdir -p (\S+)$', (DOCS / page).read_text(), re.MULTILINE):
        (tmp_path / folder).mkdir(parents=True)
    for line, _ in steps(page):
        words = [str(samples / HOW_TO[page][word]) if word in HOW_TO[page] else word
                 for word in shlex.split(line, comments=True)[1:]]
        run(words, tmp_path)
