"""``import forcecal_ros as fc``: quick to import, and the notebook that shows it runs."""

import json
from pathlib import Path
import subprocess
import sys

import forcecal_ros as fc
from matplotlib.figure import Figure
import pytest

NOTEBOOK = Path(__file__).parents[1] / 'examples' / 'gap.ipynb'


@pytest.fixture(scope='module')
def cells():
    """Run the notebook; return its variables."""
    variables = {}
    for cell in json.loads(NOTEBOOK.read_text())['cells']:
        if cell['cell_type'] == 'code':
            exec(compile(''.join(cell['source']), NOTEBOOK.name, 'exec'), variables)  # noqa: S102
    return variables


def test_the_import_loads_neither_numpy_nor_the_rest():
    code = 'import sys, forcecal_ros; print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert not {'numpy', 'scipy', 'yaml', 'rosbags', 'forcecal_ros.api'} & {*done.stdout.split()}


def test_functions_stay_under_the_names_of_subpackages():
    import forcecal_ros.calibrate.pipeline
    import forcecal_ros.diagnose.engine  # noqa: F401

    assert callable(fc.calibrate) and callable(fc.diagnose)


def test_the_notebook_names_the_delay(cells):
    gap = cells['gap']
    assert gap.to_dict()['verdict'] == 'identified'
    (row,) = gap.rows
    name, parameter, value, std, unit, _ = row
    assert (name, parameter, unit) == ('wrench_delay', 'delay', 's')
    assert abs(value - 0.004) < 4 * std
    assert 'wrench_delay' in repr(gap) and '<td>wrench_delay</td>' in gap._repr_html_()


@pytest.mark.parametrize('name', ['calibration', 'contact', 'gap'])
def test_results_print_as_tables_and_draw(cells, name):
    result = cells[name]
    assert repr(result).count('\n') == len(result.rows) + 1
    assert isinstance(result.plot(), Figure) and json.dumps(result.to_dict())


def test_results_become_data_frames(cells):
    assert list(cells['calibration'].to_dataframe()) == ['estimate', 'value', 'std', 'unit']
    assert len(cells['contact'].to_dataframe()) == cells['contact'].to_dict()['samples']


def test_a_calibration_is_saved_and_loaded(cells, tmp_path):
    fc.save(cells['calibration'], tmp_path / 'c.yaml')
    assert fc.load(tmp_path / 'c.yaml').value.mass.value == cells['calibration'].value.mass.value
    fc.save(cells['gap'], tmp_path / 'gap.json')
    assert fc.load(tmp_path / 'gap.json')['verdict'] == 'identified'
