"""The reference pages are those that the code of today writes."""

import ast
import importlib.util
from itertools import chain
from pathlib import Path
import re

from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.localise import Location
from forcecal_ros.diagnose.model.evidence import Earlier
from forcecal_ros.diagnose.result import Diagnosis, to_document
import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs'
PACKAGE = DOCS.parent / 'forcecal_ros'
FILES = (DOCS / 'reference' / 'files.md').read_text()


@pytest.fixture(scope='module')
def reference():
    spec = importlib.util.spec_from_file_location('reference', DOCS / 'reference.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize('page', ['nodes.md', 'commands.md', 'files.md'])
def test_the_page_is_what_the_code_writes(reference, page):
    written = ''.join(reference.PAGES[page]())
    assert (DOCS / 'reference' / page).read_text() == written, 'run python docs/reference.py'


def ticked(text):
    """Return the words in code font that are keys."""
    return set(re.findall(r'`(\w+)`', text))


def literal_keys(module, function, name):
    """Return the keys that a function writes into a dictionary or argument of a name."""
    tree = ast.parse((PACKAGE / module).read_text())
    body, = (one for one in ast.walk(tree)
             if isinstance(one, ast.FunctionDef) and one.name == function)
    for node in ast.walk(body):
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == name:
            yield ast.literal_eval(node.slice)
        value = getattr(node, 'value', None)
        of = {ast.unparse(one) for one in (*getattr(node, 'targets', ()), *filter(
            None, [getattr(node, 'target', None)]))} | {getattr(node, 'arg', '')}
        if isinstance(value, ast.Dict) and (name in of or (
                name == 'return' and isinstance(node, ast.Return))):
            yield from (ast.literal_eval(key) for key in value.keys if key)


def test_the_page_has_the_keys_of_quality():
    paragraph, = re.findall(r'`quality` holds .+?(?= `source` holds)', FILES, re.DOTALL)
    written = set(chain.from_iterable(literal_keys(*one, 'quality') for one in (
        ('calibrate/quality.py', 'quality_of'), ('calibrate/pipeline.py', 'calibrate_by_motion'),
        ('insitu/result.py', 'to_calibration'))))
    assert ticked(paragraph) - {'quality', 'insitu'} == written


def keys_of(value, named=('parameters', 'per_channel', 'used')):
    """Yield all keys of a document, of dictionaries by names of things the inner ones."""
    for key, one in value.items() if isinstance(value, dict) else ():
        yield key
        inner = one.values() if key in named else one if isinstance(one, list) else [one]
        yield from chain.from_iterable(map(keys_of, inner))


def test_the_page_has_the_keys_of_a_diagnosis():
    effect = NamedEffect('wrench_bias_step', {'fx': Parameter(1.0, 0.1, 'N', at_bound=True)}, 0.9,
                         1.0, (0.9, 1.1), 1, 2.0, (1.9, 2.1))
    whole = Diagnosis(
        'identified', 'because', (effect,), (('wrench_bias_step', 0.9),),
        (Location('wrench_sensor', 'force.x', 'move', (1.0, 2.0), 3.0, 0.1),),
        Gap(3.0, 2.0, 1.0, 0.5, (0.4, 0.6), {'force.x': (3.0, 2.0, 1.0, 0.1)}), earlier=Earlier(
            {frozenset({'wrench_bias_step'}): 1.0}, 0.0, {}))
    written = {'source', 'recording', 'robot', 'recorded', 'created'} | set(keys_of(
        to_document(whole, {'force.x': 'N'}, 'rig_patched.yaml')))
    for source in ('pair', 'simulator'):
        written |= set(literal_keys(f'diagnose/sources/{source}.py', 'details', 'return'))
    section, = re.findall(r'^## diagnosis.json\n(.+?)^## ', FILES, re.MULTILINE | re.DOTALL)
    assert ticked(section) == written - {'format'} | {'contact', 'calibration'}
