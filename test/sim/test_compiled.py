"""Claims about compiled code: what it may use, and that it runs wherever it is installed."""

from importlib import import_module
import os
from pathlib import Path
import pkgutil
import subprocess
import sys

import forcecal_ros.effects
from forcecal_ros.effects import EFFECTS, with_effects
import forcecal_ros.sim.rig
from numba.extending import is_jitted
import pytest

MODULES = [import_module(m.name) for room in (forcecal_ros.effects, forcecal_ros.sim.rig)
           for m in pkgutil.walk_packages(room.__path__, f'{room.__name__}.')]
COMPILED = {(module.__name__, name): value for module in MODULES
            for name, value in vars(module).items() if is_jitted(value)
            and value.py_func.__module__ == module.__name__}


@pytest.mark.parametrize('function', COMPILED.values(), ids=lambda f: f.py_func.__name__)
def test_compiled_function_uses_numbers_and_functions_of_its_own_file_only(function):
    source = function.py_func
    module = sys.modules[source.__module__]
    own = Path(module.__file__).read_text()
    for name in source.__code__.co_names:
        value = source.__globals__.get(name)
        if is_jitted(value):
            assert value.py_func.__module__ == source.__module__
        elif isinstance(value, int | float):
            assert f'\n{name} = ' in own


def test_simulator_compiles_one_form_of_each_function():
    from forcecal_ros.sim.rig.simulator import Simulator, warm_up
    warm_up()
    from forcecal_ros.sim.rig.file import load_rig
    Simulator(load_rig('rigid_tool.yaml'), 'acc2').advance()
    every = {effect.name: {q.name: q.typical for q in effect.parameters}
             for effect in EFFECTS.values()}
    Simulator(with_effects(load_rig(), every)).advance()
    entries = [COMPILED[f'forcecal_ros.{m}', f] for m, f in (
        ('sim.rig.robot', 'move'), ('sim.rig.tool', 'slide_along'),
        ('sim.rig.sensors', 'respond'),
        ('effects.signals', '_stop'))]
    assert [len(entry.signatures) for entry in entries] == [1] * len(entries)


@pytest.fixture
def unwritable(tmp_path):
    """Make a module whose folder can take no machine code."""
    (tmp_path / 'twice.py').write_text(
        'from forcecal_ros.core.jit import compiled\n\n\n'
        '@compiled\ndef twice(x):\n    return 2 * x\n')
    (tmp_path / '__pycache__').touch()
    return tmp_path


def run(folder, cache):
    environment = {**os.environ, 'XDG_CACHE_HOME': str(cache), 'PYTHONDONTWRITEBYTECODE': '1',
                   'PYTHONPATH': os.pathsep.join([str(folder), *sys.path])}
    environment.pop('NUMBA_CACHE_DIR', None)
    done = subprocess.run(
        [sys.executable, '-c', ('from forcecal_ros.core.jit import waits_for_compiler as waits\n'
                                'from twice import twice; print(waits(twice), twice(21))')],
        env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.stdout.split()[1] == '42', done.stderr
    return done.stdout.split()[0]


@pytest.mark.long
def test_machine_code_goes_to_the_user_cache_where_the_package_cannot_be_written(unwritable):
    assert run(unwritable, unwritable / 'cache') == 'True'
    assert list((unwritable / 'cache').rglob('*.nbc'))
    assert run(unwritable, unwritable / 'cache') == 'False'


@pytest.mark.long
def test_without_any_place_to_cache_it_still_runs(unwritable):
    (unwritable / 'file').touch()
    run(unwritable, unwritable / 'file')
