"""Every error that a user can fix has an id, which ends its message and is explained."""

from argparse import Namespace
import ast
from functools import cache
from pathlib import Path
import re

from forcecal_ros.checks.hypotheses import TABLE
from forcecal_ros.cli.main import main
from forcecal_ros.core import errors
from forcecal_ros.core.errors import ForcecalError, id_of, KINDS, with_id
import pytest

PACKAGE = Path(errors.__file__).parents[1]
PLACES = {place for places in KINDS.values() for place in places.split(' ')}
CLASSES = {'ModuleNotFoundError', 'OSError', ''}


@cache
def functions(module):
    """Return the names of the functions of a module or package of this package."""
    path = PACKAGE.joinpath(*module.split('.'))
    files = [path.with_suffix('.py')] if path.with_suffix('.py').is_file() else path.glob('*.py')
    return {node.name for file in files for node in ast.walk(ast.parse(file.read_text()))
            if isinstance(node, ast.FunctionDef)}


def test_the_page_explains_at_most_80_ids_what_is_wrong_why_and_what_to_do():
    page = (PACKAGE.parent / 'docs/reference/errors.md').read_text()
    explained = re.findall(r'\n## (FC\d{4}): [A-Z].+[^.]\n\n.+\. \*.+\.\*\n', page)
    assert explained == list(KINDS) and len(KINDS) <= 80
    assert page.count('\n## ') == len(KINDS)


@pytest.mark.parametrize('place', sorted(PLACES - CLASSES))
def test_every_place_of_the_table_is_there(place):
    module, _, function = place.partition('/')[0].partition(':')
    assert functions(module) >= ({function} if function else set()), place


def test_every_package_that_refuses_something_has_a_kind():
    refusing = {path.relative_to(PACKAGE).with_suffix('').parts[0]
                for path in PACKAGE.rglob('*.py')
                if re.search(r'raise (\w+Error|Mismatch)\(', path.read_text())}
    assert refusing - {'__init__', 'entry'} <= PLACES


@pytest.mark.parametrize('row', TABLE[1:], ids=lambda row: row.name)
def test_every_hypothesis_about_a_recording_has_a_kind_of_its_own(row):
    assert f'checks.hypotheses:judge/{row.name.partition(" ")[0]}' in PLACES


def test_the_innermost_refusal_decides():
    with pytest.raises(errors.UsageError) as caught:
        try:
            raise errors.DataError('inner') from OSError('a file')
        except ForcecalError as error:
            raise errors.UsageError('outer') from error
    assert id_of(caught.value) == 'FC0990'  # raised here, outside the package
    assert with_id(caught.value) == 'outer [FC0990]'
    assert with_id(caught.value, 'said by a node [FC0702]') == 'said by a node [FC0702]'


@pytest.mark.parametrize('error', [
    errors.DataError('no'), errors.ConfigError('no'), errors.UsageError('no'),
    errors.UnobservableError('no'), errors.MotionError('no'), OSError(2, 'no'),
    ModuleNotFoundError('no', name='rosbags')], ids=lambda error: type(error).__name__)
def test_every_message_of_a_command_ends_with_an_id(error, capsys):
    def run(args):
        raise error

    assert main([], lambda _: Namespace(run=run)) in (1, 2)
    assert re.search(r'\[FC\d{4}\]\n$', capsys.readouterr().err)


@pytest.mark.parametrize(('arguments', 'id_'), [
    (['check', 'no_such_bag'], 'FC0201'), (['calibrate', '--bla'], 'FC0001'),
    (['plan', '--tilt', '200'], 'FC0001'), (['compare', 'a.yaml', 'b.yaml'], 'FC0103'),
    (['export', 'a.yaml', '--for', 'ur'], 'FC0103'), (['insitu', 'a.yaml', '-o', 'b'], 'FC0102'),
    (['calibrate', 'x', '-o', 'x'], 'FC0002'),
    (['diagnose', 'x', '--mujoco', 'missing.xml'], 'FC0004')])
def test_a_refusal_has_the_id_of_its_kind(arguments, id_, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        main(arguments)
    except SystemExit as end:
        assert end.code == 2
    assert capsys.readouterr().err.endswith(f'[{id_}]\n')


def test_mujoco_that_is_not_installed_is_a_missing_package(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('forcecal_ros.sim.mujoco.mujoco', None)
    assert main(['diagnose', 'x', '--mujoco', 'missing.xml']) == 1
    assert capsys.readouterr().err.endswith('[FC0003]\n')
