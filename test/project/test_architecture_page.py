"""The page for newcomers shows the rooms as they are, and names what is there."""

import ast
from pathlib import Path
import re

from imports import architecture, PACKAGE, PATHS, tree
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'architecture.md').read_text()
FILES = ('.html', '.json', '.md', '.py', '.yaml')
PARAMETERS = {'limits', 'watch'}
"""Groups of parameters of nodes, which the page names besides modules."""

TICKED = sorted(set(re.findall(r'`([^`\n]+)`', PAGE)))


def test_the_picture_shows_the_imports_of_today():
    graph = architecture.reduced(architecture.rooms())
    drawn = set(re.findall(r'<g id="(room-[^"]+|[^"]+-imports-[^"]+)"',
                           architecture.PICTURE.read_text()))
    assert drawn == architecture.ids(graph), 'draw it again: python docs/architecture.py'
    assert f']({architecture.PICTURE.name})' in PAGE


def test_every_room_has_its_row():
    rows = set(re.findall(r'^- `([\w.]+)`: ', PAGE, re.MULTILINE))
    assert set(architecture.rooms()) <= rows


@pytest.mark.parametrize('name', [n for n in TICKED if re.fullmatch(r'[\w./*]+\.(py|md)', n)])
def test_every_file_named_is_there(name):
    assert list(ROOT.glob(name)) or list((ROOT / PACKAGE).glob(name))


@pytest.mark.parametrize('name', [
    n for n in TICKED if re.fullmatch(r'[a-z_]+(\.\w+)+', n)
    and n.split('.')[0] not in PARAMETERS and not n.endswith(FILES)])
def test_every_module_and_function_named_is_there(name):
    module, attribute = f'{PACKAGE}.{name}', ''
    if module not in PATHS:
        module, _, attribute = module.rpartition('.')
    assert module in PATHS, name
    assert not attribute or attribute in _defined(tree(module))


def _defined(tree):
    found = {node.name for node in tree.body
             if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    for node in tree.body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found
