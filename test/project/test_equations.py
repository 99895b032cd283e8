"""The table of equations and the docstrings say the same."""

import ast
from importlib import import_module
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / 'forcecal_ros'
TAG = re.compile(
    r'\[(Gamez2005|Traversaro2014)\] Eq\. (\d+(?:(?:, | and | to |-)\d+(?!\.\d))*)')
ROW = re.compile(r'^- (Eq\. [^:]+): `([\w.]+)`, `([\w/]+)`$', re.MULTILINE)
ELSEWHERE = {'report', 'geometry', 'calibration', 'motion'}
"""Rooms that show, hold or use an equation's result without being its home."""


def equations(text):
    """Return every (source, number) that a text names."""
    found = set()
    for source, numbers in TAG.findall(' '.join(text.split())):
        for part in re.split(r', | and ', numbers):
            first, *last = (int(n) for n in re.split(r'-| to ', part))
            found |= {(source, n) for n in range(first, (last or [first])[0] + 1)}
    return found


@pytest.fixture(scope='module')
def docstrings():
    """Map each documented name of the package to its docstring."""
    names = {}
    for path in sorted(SOURCE.rglob('*.py')):
        if not re.search(r'\[(Gamez2005|Traversaro2014)\]', text := path.read_text()):
            continue
        module = '.'.join(path.relative_to(SOURCE).with_suffix('').parts)
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                names[f'{module}.{node.name}'] = ast.get_docstring(node) or ''
    return names


def imported(tree):
    """Map each name that a source imports from the package to what it is."""
    return {alias.asname or alias.name: from_package(node.module, alias.name)
            for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
            and (node.module or '').partition('.')[0] == 'forcecal_ros' for alias in node.names}


def from_package(module, name):
    """Return a member or a submodule."""
    found = getattr(import_module(module), name, None)
    return import_module(f'{module}.{name}') if found is None else found


def called(source):
    """Return all functions and classes of the package that a source calls."""
    tree = ast.parse(source)
    known = imported(tree)
    names = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [known.get(f.id) for f in names if isinstance(f, ast.Name)] + [
        getattr(known.get(f.value.id), f.attr, None) for f in names
        if isinstance(f, ast.Attribute) and isinstance(f.value, ast.Name)]


ROWS = [(f'{source} {equation}', *names) for source, rows in re.findall(
    r'^## (\[\w+\])$(.+?)(?=^## )', (ROOT / 'docs/reference/equations.md').read_text(),
    re.MULTILINE | re.DOTALL) for equation, *names in ROW.findall(rows)]


def test_there_is_a_table():
    assert len(ROWS) > 30


@pytest.mark.parametrize(('named', 'function', 'test'), ROWS, ids=[row[1] for row in ROWS])
def test_a_row_names_a_function_that_says_so_and_a_test_that_calls_it(
        docstrings, named, function, test):
    assert equations(named) <= equations(docstrings[function])
    module, _, name = function.rpartition('.')
    wanted = from_package(f'forcecal_ros.{module}', name)
    assert any(one is wanted for one in called((ROOT / 'test' / f'{test}.py').read_text()))


def test_a_name_in_a_comment_or_another_module_of_its_name_is_no_call():
    source = 'from forcecal_ros.calibrate.tool import mass_from_tilt\n'
    wanted = from_package('forcecal_ros.calibrate.tool', 'mass_from_tilt')
    assert not any(one is wanted for one in called(source + '# mass_from_tilt(1, 2, 3)'))
    assert wanted not in called('def mass_from_tilt(): pass\nmass_from_tilt()')
    assert wanted in called(source + 'mass_from_tilt(1, 2, 3)')
    assert wanted in called('from forcecal_ros.calibrate import tool as m\nm.mass_from_tilt()')


def test_every_equation_named_in_a_docstring_stands_in_the_table(docstrings):
    listed = {one for named, _, _ in ROWS for one in equations(named)}
    missing = {(name, one) for name, text in docstrings.items()
               for one in equations(text) - listed if name.split('.')[0] not in ELSEWHERE}
    assert not missing


def test_every_equation_of_the_procedure_is_there():
    listed = {one for named, _, _ in ROWS for one in equations(named)}
    assert {('Gamez2005', n) for n in range(1, 30)} <= listed
    assert {('Traversaro2014', n) for n in (3, 4, 5, *range(9, 19), *range(21, 25))} <= listed
