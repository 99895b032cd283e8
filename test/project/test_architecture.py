"""Imports point one way, numerics know no ROS: read from the source, nothing is imported."""

import ast
from graphlib import CycleError, TopologicalSorter
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[2]
_spec = spec_from_file_location('architecture', ROOT / 'docs' / 'architecture.py')
architecture = module_from_spec(_spec)
_spec.loader.exec_module(architecture)
PACKAGE, PATHS, room = architecture.PACKAGE, architecture.PATHS, architecture.room
imported_by, tree = architecture.imported_by, architecture.tree

ROS = re.compile(
    r'\w+_msgs|rcl\w*|std_srvs|builtin_interfaces|ament_\w+|launch\w*|rosidl\w*|ros\w*2\w*|tf2\w*')

NUMERICS = (
    ('core',),
    ('checks',),
    ('io',),
    ('effects', 'calibrate', 'insitu', 'motion', 'observe', 'sim'),
    ('diagnose', 'impedance'),
    ('rig_fit',),
)
LAYERS = (
    *NUMERICS,
    ('io.bags', 'report'),
    ('nodes',),
    ('cli',),
    ('results',),
    ('api',),
)
"""From the ground up: a module may import from its own line and from those above it."""

WITHIN_DIAGNOSE = (
    ('verdict',), ('dataset', 'recordings'), ('model',), ('localise',), ('search',), ('judge',),
    ('result',), ('engine',), ('sources',), ('live', 'plan'))
"""The same of the parts of ``diagnose``, its modules and sub-packages."""


def _loaded_by(name):
    """Return all modules of this package that importing ``name`` executes."""
    loaded, waiting = set(), [name]
    while waiting:
        module = waiting.pop()
        if module in PATHS and module not in loaded:
            loaded.add(module)
            waiting.extend(imported_by(module))
            waiting.append(module.rpartition('.')[0])
    return loaded


def _of(units):
    return [name for name in PATHS if room(name) in units]


def _foreign(name):
    """Return the top-level names of what a module imports from elsewhere."""
    return {module.split('.')[0] for module in imported_by(name)} - {PACKAGE}


NUMERIC_MODULES = _of([unit for layer in NUMERICS for unit in layer])


def test_every_module_has_its_layer():
    known = {unit for layer in LAYERS for unit in layer}
    assert {room(name) for name in PATHS} - {''} <= known


@pytest.mark.parametrize('layer', range(len(LAYERS)), ids=lambda n: LAYERS[n][0])
def test_imports_never_point_down_the_layers(layer):
    below = {unit for line in LAYERS[layer + 1:] for unit in line}
    wrong = [f'{name} -> {target}' for name in _of(LAYERS[layer]) for target in imported_by(name)
             if target in PATHS and room(target) in below]
    assert not wrong


def _part_of_diagnose(name):
    """Return the module or sub-package of ``diagnose`` that a module belongs to."""
    return name.split('.')[2]


@pytest.mark.parametrize('layer', range(len(WITHIN_DIAGNOSE)), ids=lambda n: WITHIN_DIAGNOSE[n][0])
def test_imports_within_diagnose_point_one_way(layer):
    inside = [name for name in PATHS if room(name) == 'diagnose' and name.count('.') > 1]
    assert {_part_of_diagnose(name) for name in inside} == {
        part for line in WITHIN_DIAGNOSE for part in line}
    allowed = {part for line in WITHIN_DIAGNOSE[:layer + 1] for part in line}
    wrong = [f'{name} -> {target}' for name in inside
             if _part_of_diagnose(name) in WITHIN_DIAGNOSE[layer] for target in imported_by(name)
             if target in inside and _part_of_diagnose(target) not in allowed]
    assert not wrong


@pytest.mark.parametrize('grain', [room, str], ids=['parts', 'modules'])
def test_imports_make_no_circle(grain):
    graph = {}
    for name in PATHS:
        inside = {grain(target) for target in imported_by(name) if target in PATHS}
        graph.setdefault(grain(name), set()).update(inside - {grain(name)})
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(' <- '.join(error.args[1]))


@pytest.mark.parametrize('one, other', [
    ('sim', 'calibrate'), ('calibrate', 'sim'), ('calibrate', 'effects')])
def test_simulator_and_identification_share_no_physics(one, other):
    assert _of([one])
    wrong = {(name, loaded) for name in _of([one]) for loaded in _loaded_by(name)
             if room(loaded) == other}
    assert not wrong


def test_numerics_load_neither_ros_nor_bags():
    wrong = {f'{name} loads {loaded} imports {foreign}' for name in NUMERIC_MODULES
             for loaded in _loaded_by(name) for foreign in _foreign(loaded)
             if ROS.fullmatch(foreign) or foreign == 'rosbags'}
    assert not wrong


def test_numerics_neither_log_nor_print():
    printing = {f'{name}:{node.lineno}' for name in NUMERIC_MODULES
                for node in ast.walk(tree(name)) if isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name) and node.func.id == 'print'}
    assert not printing
    logging = {name for name in NUMERIC_MODULES if _foreign(name) & {'logging', 'tqdm'}}
    assert not logging


def test_only_bags_knows_rosbags():
    assert {room(name) for name in PATHS if 'rosbags' in _foreign(name)} == {'io.bags'}


def test_only_nodes_and_messages_know_ros():
    knowing = {room(name) for name in PATHS for foreign in _foreign(name)
               if ROS.fullmatch(foreign)}
    assert knowing <= {'nodes'}


PAGE = (ROOT / 'docs' / 'architecture.md').read_text()


def test_the_picture_of_the_page_shows_the_imports_of_today():
    graph = architecture.reduced(architecture.rooms())
    drawn = set(re.findall(r'<g id="(room-[^"]+|[^"]+-imports-[^"]+)"',
                           architecture.PICTURE.read_text()))
    assert drawn == architecture.ids(graph), 'draw it again: python docs/architecture.py'
    assert f']({architecture.PICTURE.name})' in PAGE


def test_every_room_has_its_row_in_the_page_and_every_file_that_it_names_is_there():
    rows = set(re.findall(r'^- `([\w.]+)`: ', PAGE, re.MULTILINE))
    assert set(architecture.rooms()) <= rows
    files = re.findall(r'`([\w./*]+\.(?:py|md))`', PAGE)
    assert files and all([*ROOT.glob(name), *(ROOT / PACKAGE).glob(name)] for name in files)
