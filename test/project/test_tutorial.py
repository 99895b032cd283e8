"""The tutorial's commands as they stand, one after the other, and the answers that it promises."""

from pathlib import Path
import re
import shlex
import subprocess
import sys

import pytest

TUTORIAL = Path(__file__).resolve().parents[2] / 'docs' / 'tutorials' / 'first-calibration.md'
ANSWER = re.compile(r'^(identified: \w+|no_gap)', re.MULTILINE)


def blocks():
    """Return the indented blocks of the page, those aside that want a second terminal."""
    found = re.findall(r'(?:^    .+\n)+', TUTORIAL.read_text(), re.MULTILINE)
    return [block for block in found if 'ros2 ' not in block]


def steps():
    """Yield each command, and the answer that stands in the block after it, if there is one."""
    every = blocks()
    for block, then in zip(every, [*every[1:], '']):
        lines = [line.strip() for line in block.splitlines()]
        promised = ANSWER.search('\n'.join(line.strip() for line in then.splitlines()))
        for line in lines:
            if line.startswith('forcecal '):
                yield line, promised[1] if promised and line == lines[-1] else ''


def test_the_page_has_commands_and_promises():
    every = list(steps())
    assert [line.split()[1] for line, _ in every] == [
        'demo', 'calibrate', 'estimate', 'play', 'export', 'export', 'sample', 'diagnose',
        'diagnose']
    assert [promised for *_, promised in every][-2:] == ['identified: wrench_delay', 'no_gap']


@pytest.mark.long
@pytest.mark.live
def test_every_command_answers_what_the_page_says(tmp_path):
    for line, promised in steps():
        done = subprocess.run(
            [sys.executable, '-m', 'forcecal_ros.cli.main', *shlex.split(line, comments=True)[1:]],
            cwd=tmp_path, capture_output=True, text=True, timeout=900, check=False)
        assert done.returncode == 0, f'{line}\n{done.stderr}'
        assert done.stdout.startswith(promised), f'{line}\n{done.stdout}'
