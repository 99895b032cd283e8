"""Growth is a decision: code lines of each package, files and constants have a budget."""

import ast
from functools import cache
from pathlib import Path

import pytest
from sources import parsed

PACKAGE = Path(__file__).resolve().parents[2] / 'forcecal_ros'

BUDGETS = {
    'calibrate': 2094, 'checks': 1738, 'cli': 2756, 'core': 2163, 'diagnose': 5278,
    'effects': 737, 'impedance': 719, 'insitu': 1919, 'io': 2478, 'motion': 1432,
    'nodes': 3419, 'observe': 2709, 'report': 1850, 'rig_fit': 478, 'sim': 2870}
"""Code lines; less is better: lower a number with the code."""

MOST_AT_ROOT = 249
"""Code lines of the modules next to the packages: the interface from Python."""

MOST_FILES, MOST_CONSTANTS = 231, 385
"""Of the whole package; a constant is a number bound to an upper-case name of a module."""

FILES = sorted(PACKAGE.rglob('*.py'))


def statements(node):
    """Yield the statements within a node, and within those."""
    for name in ('body', 'orelse', 'finalbody', 'handlers', 'cases'):
        for one in getattr(node, name, ()):
            yield one
            yield from statements(one)


@cache
def code_lines(path):
    """Count lines that are neither blank, comment nor docstring."""
    documented = sum(
        one.end_lineno - one.lineno + 1 for one in statements(parsed(path))
        if isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant)
        and isinstance(one.value.value, str))
    lines = [line.strip() for line in path.read_text().splitlines()]
    return len([line for line in lines if line and not line.startswith('#')]) - documented


def constants(path):
    """Count numbers that are bound to upper-case names at module level."""
    count = 0
    for node in parsed(path).body:
        targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(
            node, ast.AnnAssign) else []
        value = getattr(node, 'value', None)
        if value is None or isinstance(value, (ast.Dict, ast.Call)) or not any(
                isinstance(one, ast.Constant) and type(one.value) in (int, float)
                for one in ast.walk(value)):
            continue
        count += sum(isinstance(name, ast.Name) and name.id.isupper()
                     for target in targets for name in getattr(target, 'elts', [target]))
    return count


def test_a_docstring_and_a_comment_are_no_code(tmp_path):
    path = tmp_path / 'one.py'
    path.write_text('"""Doc.\nMore.\n"""\n# why\nX, Y = 1, 2\n"""Of X."""\n\n\n'
                    'def f():\n    return 1\n')
    assert (code_lines(path), constants(path)) == (3, 2)


@pytest.mark.parametrize('package', BUDGETS)
def test_a_package_keeps_its_budget(package):
    assert sum(map(code_lines, (PACKAGE / package).rglob('*.py'))) <= BUDGETS[package]


def test_the_modules_next_to_the_packages_keep_their_budget():
    assert sum(map(code_lines, PACKAGE.glob('*.py'))) <= MOST_AT_ROOT


def test_every_package_has_a_budget():
    assert {path.parent.name for path in PACKAGE.glob('*/__init__.py')} == set(BUDGETS)


def test_files_and_constants_keep_their_budget():
    assert len(FILES) <= MOST_FILES
    assert sum(map(constants, FILES)) <= MOST_CONSTANTS
