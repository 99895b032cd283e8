"""``import forcecal_ros as fc``: quick to import, and the notebook that shows it runs."""

from dataclasses import replace
import inspect
from itertools import pairwise
import json
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

from calibration_runs import brief_run
import forcecal_ros as fc
from forcecal_ros.core.errors import DataError, ForcecalError
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.diagnose import plan
from forcecal_ros.diagnose.sources import choice
from forcecal_ros.io.bags import write_recording
from forcecal_ros.report.rows import as_text, table
from longer import first
from matplotlib.figure import Figure
import numpy as np
import pytest
from rig_recordings import FREE, motion, PERIOD

NOTEBOOK = Path(__file__).parents[1] / 'examples' / 'gap.ipynb'


@pytest.fixture(scope='module')
def patch_of_module():
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(scope='module', params=first([FREE[:8], None]), ids=['brief', 'as it is'])
def cells(request):
    """Run the notebook, the usual run on a brief motion; return its variables."""
    variables = {}
    if request.param:
        positions, rotations, phases = motion(request.param)
        told = PoseStream(PERIOD * np.arange(len(positions)), positions, rotations)
        patch = request.getfixturevalue('patch_of_module')
        patch.setattr(plan, 'motion_for', lambda *_, **__: SimpleNamespace(
            target=told, phases=phases))
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
    # the brief motion leaves some odds to a low-pass
    assert gap.to_dict()['verdict'] in ('identified', 'ambiguous')
    (row,) = gap.rows
    name, parameter, value, std, unit, _ = row
    assert (name, parameter, unit) == ('wrench_delay', 'delay', 's')
    assert abs(value - 0.004) < 4 * std
    assert 'wrench_delay' in repr(gap) and '<td>wrench_delay</td>' in gap._repr_html_()


def test_estimates_print_as_the_commands_print_them_and_are_kept_in_si_units(cells):
    calibration, gap = cells['calibration'], cells['gap']
    _, head, mass, *_ = repr(calibration).splitlines()
    assert head.split() == ['estimate', 'value', '±', 'unit']
    shown = as_text(table(calibration.value)).splitlines()[2].split()
    assert mass.split() == shown and shown[-1] == 'kg'
    assert all(f'<td>{cell}</td>' in calibration._repr_html_() for cell in shown[2:])
    _, _, _, std, _, _ = gap.rows[0]
    half, unit = repr(gap).splitlines()[2].split()[3:5]
    assert unit == 'ms' and float(half) == pytest.approx(1.96e3 * std, rel=0.2)  # a digit
    assert gap.to_dataframe()['standard error'][0] == std


@pytest.mark.parametrize('name', ['calibration', 'contact', 'gap'])
def test_results_print_as_tables_and_draw(cells, name):
    result = cells[name]
    assert repr(result).count('\n') == len(result.rows) + 1
    assert isinstance(result.plot(), Figure) and json.dumps(result.to_dict())


def test_a_stated_sign_goes_into_the_calibration_and_comes_from_it(tmp_path):
    made = brief_run()
    turned = replace(made, wrench=replace(made.wrench, values=-made.wrench.values))
    write_recording(tmp_path / 'bag', turned)
    calibration = fc.calibrate(fc.read(tmp_path / 'bag', wrench_sign=-1))
    fc.save(calibration, tmp_path / 'c.yaml')
    assert fc.load(tmp_path / 'c.yaml').value.wrench_sign == -1
    stated, by_calibration = (
        fc.estimate(fc.read(tmp_path / 'bag', wrench_sign=sign), tmp_path / 'c.yaml').value
        for sign in (-1, None))
    np.testing.assert_array_equal(stated.contact, by_calibration.contact)
    assert np.abs(stated.contact[stated.t < 1.0, :3]).max() < 5.0


@pytest.fixture(scope='module')
def bag(brief):
    return brief / 'bag'


def test_a_path_does_for_a_recording_and_for_a_calibration(bag, tmp_path):
    read = fc.read(bag)
    calibration = fc.calibrate(str(bag))
    assert calibration.rows == fc.calibrate(read).rows
    fc.save(calibration, tmp_path / 'c.yaml')
    assert fc.estimate(bag, tmp_path / 'c.yaml').rows == fc.estimate(read, calibration).rows
    assert fc.check(bag).rows == fc.check(read).rows
    np.testing.assert_array_equal(fc.simulate(bag, 'nominal').wrench.values,
                                  fc.simulate(read).wrench.values)


@pytest.mark.parametrize('of, source', [
    (lambda bag: bag, 'PairSource'), (lambda bag: next(bag.glob('*.mcap')), 'PairSource'),
    (lambda bag: 'nominal', 'RigSource'), (lambda bag: None, 'RigSource')],
    ids=['bag', 'file', 'nominal', 'none'])
def test_a_bag_and_the_nominal_rig_are_compared_with_by_name(bag, of, source, monkeypatch):
    taken = []

    def source_of(*given):
        taken.extend(given)
        raise DataError(type(made(*given)[0]).__name__)

    made = choice.source_of
    monkeypatch.setattr(choice, 'source_of', source_of)
    with pytest.raises(DataError, match=source):
        fc.diagnose(bag, of(bag), heldout=bag)
    assert len(taken[1]) == 2


@pytest.mark.parametrize('call, said', [
    (lambda bag: fc.calibrate(3), r'pass a Recording or path, not .*int.*FC0201'),
    (lambda bag: fc.estimate(bag, 3), r'pass a Calibration or path, not .*int.*FC0103'),
    (lambda bag: fc.diagnose(bag, 3), r'int has no method parameters; .*FC0804'),
    (lambda bag: fc.diagnose('no_bag', 'nominal'), r'no_bag does not exist; .*FC0201')])
def test_what_is_no_recording_or_model_is_refused_with_what_to_pass(bag, call, said):
    with pytest.raises(ForcecalError, match=said):
        call(bag)


def test_results_become_data_frames(cells):
    assert list(cells['calibration'].to_dataframe()) == ['estimate', 'value', 'standard error',
                                                         'unit']
    assert len(cells['contact'].to_dataframe()) == cells['contact'].to_dict()['samples']


def test_a_calibration_is_saved_and_loaded(cells, tmp_path):
    fc.save(cells['calibration'], tmp_path / 'c.yaml')
    assert fc.load(tmp_path / 'c.yaml').value.mass.value == cells['calibration'].value.mass.value
    fc.save(cells['gap'], tmp_path / 'gap.json')
    again = fc.load(tmp_path / 'gap.json')
    assert again.headline == cells['gap'].headline and again.to_dict() == cells['gap'].to_dict()
    assert [row[:5] for row in again.rows] == [row[:5] for row in cells['gap'].rows]
    names = [one.get_text() for one in again.plot().axes[0].get_yticklabels()]
    assert 'force.x' in names and len(names) == len(again.value.gap.channels)


def test_a_calibration_is_drawn_without_phases_and_without_its_recording(tmp_path):
    result = fc.calibrate(replace(brief_run(), phases=()))
    assert [axes.get_ylabel() for axes in result.plot().axes] == [
        f'{what}force {axis} [N]' for what in ('', 'contact ') for axis in 'xyz']
    fc.save(result, tmp_path / 'c.yaml')
    shown = [one.get_text() for axes in fc.load(tmp_path / 'c.yaml').plot().axes
             for one in axes.get_yticklabels()]
    assert [text.partition('  ')[0] for text in shown] == [row[0] for row in result.rows]
    assert shown[0].endswith(' kg') and ' ± ' in shown[0]


def test_a_recording_prints_and_checks_as_a_table():
    made = brief_run()
    lines = repr(made).splitlines()
    assert lines[2].split() == ['wrench', '3833', '250', 'Hz', '15.33', 's'] and len(lines) == 8
    checked = fc.check(replace(made, wrench=None))
    assert ('calibrate', 'no') in [row[:2] for row in checked.rows]
    assert ('diagnose', 'yes, against a model') in [row[:2] for row in fc.check(made).rows]
    assert [axes.get_ylabel() for axes in checked.plot().axes] == [
        f'accel.{axis} [V]' for axis in 'xyz']
    with pytest.raises(DataError, match=r'record wrench \[FC0801\]$'):
        fc.check(replace(made, wrench=None, accelerometer=None, optidrive=None)).plot()


@pytest.mark.parametrize('name', sorted({*fc.API} - {'Result'}))
def test_every_function_describes_each_of_its_parameters(name):
    function = getattr(fc, name)
    about = inspect.getdoc(function)
    _, _, parameters = about.partition('Parameters\n----------\n')
    named = {word for line in parameters.partition('\n\n')[0].splitlines()
             if not line.startswith(' ') for word in line.partition(' :')[0].split(', ')}
    assert named == {*inspect.signature(function).parameters}
    assert '\n\nReturns\n-------\n' in about or name == 'save'
    assert '\n\nRaises\n------\n' in about or name == 'check'
    rows = parameters.partition('\n\n')[0].splitlines()
    assert all(after.startswith(' ') for row, after in pairwise([*rows, ''])
               if not row.startswith(' ')), 'a parameter without a description'


def test_the_module_stays_short():
    path = Path(fc.__file__).with_name('api.py')
    assert len(path.read_text().splitlines()) <= 150
