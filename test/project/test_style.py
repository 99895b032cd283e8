"""Style and types of the source, with the rules of ruff.toml and mypy.ini."""

import ast
from pathlib import Path
import re
import subprocess
import sys

import message_stubs
import pytest

ROOT = Path(__file__).resolve().parents[2]
MACHINE_PATH = re.compile(r'(?<![\w.~$}/-])/' + r'(work|root|home|Users)/')


def _check(module, *arguments):
    pytest.importorskip(module)
    done = subprocess.run([sys.executable, '-m', module, *arguments], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.lint
def test_source_follows_the_rules_of_ament():
    _check('ruff', 'check', '--output-format', 'concise', '.')


@pytest.mark.lint
@pytest.mark.long
def test_types_are_strict():
    pytest.importorskip('numpy', minversion='2.2', reason='older ones have types of their own')
    pytest.importorskip('rclpy', reason='without ROS the types of the nodes are not known')
    _check('mypy')


@pytest.mark.lint
def test_stubs_are_those_of_the_messages():
    pytest.importorskip('rclpy')
    made = message_stubs.make()
    assert {str(path.relative_to(message_stubs.STUBS)): path.read_text()
            for path in message_stubs.STUBS.rglob('*.pyi')} == made


@pytest.mark.lint
def test_no_file_knows_the_machine_it_was_written_on(project_files):
    found = []
    for path in project_files:
        if (ROOT / path).is_file():
            text = (ROOT / path).read_bytes().decode(errors='replace')
            found += [f'{path}: {line}' for line in text.splitlines() if MACHINE_PATH.search(line)]
    assert not found


def test_no_error_is_rebuilt_from_its_type():
    """A constructor of another signature raises TypeError there, and attributes are lost."""
    rebuilt = [f'{path.relative_to(ROOT)}:{node.lineno}'
               for path in (ROOT / 'forcecal_ros').rglob('*.py')
               if ')(' in (text := path.read_text()) or '__class__(' in text
               for node in ast.walk(ast.parse(text))
               if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
               and (isinstance(node.exc.func, ast.Call)
                    or getattr(node.exc.func, 'attr', '') == '__class__')]
    assert not rebuilt
