"""``forcecal insitu``: SPEC in; offset, matrix, pictures and report out."""

from contextlib import redirect_stdout
from io import StringIO
import json
from pathlib import Path
import re

from browser import cut_on_a_phone, NEEDED
from forcecal_ros.cli.insitu import earlier
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.streams import Stream
from forcecal_ros.insitu import load_spec
from forcecal_ros.insitu.sources import read_table
from forcecal_ros.io.bags import write_signals
from forcecal_ros.io.calibration_file import load
import insitu_leg
from insitu_leg import GAUGES, Leg, OFFSET, record
import numpy as np
import pytest
import yaml

EXAMPLES = Path(__file__).resolve().parents[2] / 'config' / 'examples'
LEG = Leg(duration=20.0)
PROTOCOL = insitu_leg.PROTOCOL[:5]
"""Four data sets to train, one to validate."""
FOOT_SHIFT = np.array([0.0, 0.0, 0.25])
"""Origin of the second sensor, further down the leg, in the first one's frame [m]."""
COLUMNS = ['t', *(f'r{k}' for k in range(6)), *(f's{k}' for k in range(6)), 'ax', 'ay', 'az',
           'wx', 'wy', 'wz']


OF_ONE = [*COLUMNS[:7], 'ax', 'ay', 'az']
"""What the first sensor needs."""


def table_of(load, leg, seed):
    """Two sensors on one limb: the second feels the same wrench about its own origin."""
    log = record(load, leg, seed)
    second = log.wrench.copy()
    second[:, 3:] -= np.cross(FOOT_SHIFT, second[:, :3])
    rng = np.random.default_rng(seed)
    second += rng.normal(size=second.shape) * np.repeat([0.3, 0.02], 3)
    return np.column_stack([log.t, log.raw, second + 5.0, log.accel, log.gyro])


def save_table(path, rows, names=COLUMNS):
    np.savetxt(path, rows, delimiter=',', header=','.join(names), comments='', fmt='%.17g')


def write_tables(folder, leg=LEG, names=COLUMNS, change=lambda k, rows: rows):
    """Write the tables of all data sets, changed by their number and rows."""
    at = [COLUMNS.index(name) for name in names]
    for k, load_ in enumerate(PROTOCOL):
        save_table(folder / f'set{k + 1}.csv', change(k, table_of(load_, leg, 700 + k)[:, at]),
                   names)


def document(protocol=PROTOCOL, **changes):
    return {
        'format': 'forcecal-insitu/1',
        'time': {'column': 't', 'unit': 's'},
        'accelerometer': {'columns': ['ax', 'ay', 'az']},
        'sensors': {'leg': {
            'columns': [f'r{k}' for k in range(6)], 'unit': 'counts', 'frame': 'leg_ft',
            'manufacturer_matrix': np.linalg.inv(GAUGES).tolist()}},
        'data_sets': [
            {'file': f'set{k + 1}.csv', 'use': 'train' if one.train else 'validate',
             'added_mass': one.mass, 'position': list(one.position)}
            for k, one in enumerate(protocol)],
        **changes}


def write_spec(folder, content):
    path = folder / 'spec.yaml'
    path.write_text(yaml.safe_dump(content))
    return path


def read(folder, **changes):
    """Read the table a.csv of a folder."""
    spec = load_spec(write_spec(folder, document(**{'data_sets': [{'file': 'a.csv'}], **changes})))
    return read_table(spec, folder / 'a.csv', spec.sensors['leg'].columns)


@pytest.fixture(scope='module')
def tables(tmp_path_factory):
    folder = tmp_path_factory.mktemp('tables')
    write_tables(folder)
    return folder


@pytest.fixture(scope='module')
def done(tables):
    spec = write_spec(tables, document())
    with redirect_stdout(StringIO()) as said:
        assert main(['insitu', str(spec), '-o', str(tables / 'out')]) == 0
    (tables / 'printed').write_text(said.getvalue())
    return tables / 'out'


@NEEDED
def test_the_report_fits_a_phone(done, tmp_path):
    assert cut_on_a_phone(done / 'report.html', tmp_path) == []


def test_it_writes_result_calibration_pictures_and_a_report_of_the_papers_tables(tables, done):
    assert {path.name for path in done.iterdir()} == {
        'insitu.json', 'calibration.yaml', 'report.html', 'leg_forces.png', 'leg_subspace.png',
        'leg_singular_values.png'}
    assert (done / 'leg_forces.png').read_bytes().startswith(b'\x89PNG')
    html = (done / 'report.html').read_text()
    # what the sensor is worth comes before any table
    assert html.index('Held-out added masses are found within') < html.index('<table')
    for words in ('Table I', 'Table II', 'Table III', 'Spread of gravity', 'data:image/png'):
        assert words in html
    assert 'src="http' not in html and 'href="http' not in html
    printed = (tables / 'printed').read_text()
    assert 'Added mass [kg] (Table II)' in printed and 'by manufacturer' in printed
    assert 'set5' in printed and 'set1 (trained on)' in printed


def test_the_calibration_loads_and_turns_counts_into_the_wrench(done):
    calibration = load(done / 'calibration.yaml')
    log = record(insitu_leg.PROTOCOL[5], Leg(noise=0.0, duration=20.0), 5)
    wrench = (log.raw - calibration.matrix_offset.value) @ calibration.matrix.value.T
    off = np.sqrt(((wrench - log.wrench) ** 2).mean(axis=0))
    assert (off[:3] < 0.1).all()
    assert (off[3:] < 0.02).all()
    assert calibration.sensor_frame == 'leg_ft'
    assert abs(float(calibration.mass) - insitu_leg.BODY_MASS) < 4 * calibration.mass.std


@pytest.mark.long
def test_several_sensors_share_one_accelerometer(tables):
    content = document()
    content['sensors']['foot'] = {'columns': [f's{k}' for k in range(6)], 'unit': 'N or N m'}
    for one, load_ in zip(content['data_sets'], PROTOCOL):
        at = np.array(load_.position)
        one['position'] = {'leg': at.tolist(), 'foot': (at - FOOT_SHIFT).tolist()}
    out = tables / 'two'
    assert main(['insitu', str(write_spec(tables, content)), '-o', str(out)]) == 0
    foot = load(out / 'foot' / 'calibration.yaml')
    assert (np.abs(foot.matrix.value - np.eye(6)) < 4.5 * foot.matrix.std).all()
    assert (np.abs(foot.com.value - (insitu_leg.BODY_COM - FOOT_SHIFT)) < 4 * foot.com.std).all()
    assert (out / 'leg' / 'calibration.yaml').exists()
    (out / 'elsewhere').mkdir()
    (out / 'elsewhere' / 'calibration.yaml').write_text("somebody's")
    alone = write_spec(tables, document(data_sets=[{'file': 'set1.csv'}]))
    assert main(['insitu', str(alone), '-o', str(out)]) == 0
    # the offset alone needs no added mass, and is no calibration
    assert {str(path.relative_to(out)) for path in out.rglob('*.yaml')} == {
        'elsewhere/calibration.yaml'}
    found = json.loads((out / 'insitu.json').read_text())['sensors']['leg']['offset']
    assert np.abs((np.array(found['value']) - OFFSET) / found['std']).max() < 4
    assert {path.name for path in out.glob('foot*~')} == {
        'foot_forces.png~', 'foot_subspace.png~', 'foot_singular_values.png~'}


@pytest.mark.long
def test_recordings_give_what_tables_give(tables, done, tmp_path):
    for k, load_ in enumerate(PROTOCOL):
        rows = table_of(load_, LEG, 700 + k)
        t = rows[:, 0]
        write_signals(tmp_path / f'set{k + 1}.bag', {
            'wrench': Stream(t, rows[:, 1:7], 'leg'),
            'imu': Stream(t, rows[:, 13:19], 'imu')}, 10**18)
    content = document()
    content.pop('time')
    content['accelerometer'] = {'topic': 'imu/data_raw'}
    content['sensors']['leg'].pop('columns')
    content['sensors']['leg']['topic'] = 'wrench'
    for one in content['data_sets']:
        one['file'] = one['file'].replace('.csv', '.bag')
    out = tmp_path / 'out'
    assert main(['insitu', str(write_spec(tmp_path, content)), '-o', str(out)]) == 0
    mine, other = load(out / 'calibration.yaml'), load(done / 'calibration.yaml')
    np.testing.assert_allclose(mine.matrix.value, other.matrix.value, rtol=1e-4, atol=1e-7)


def test_arrays_are_read_by_column_number_and_json_prints_what_is_written(
        tables, done, tmp_path, capsys):
    for k, load_ in enumerate(PROTOCOL):
        np.save(tmp_path / f'set{k + 1}.npy', table_of(load_, LEG, 700 + k))
    content = document(time={'column': 0, 'unit': 's'}, accelerometer={'columns': [13, 14, 15]})
    content['sensors']['leg']['columns'] = list(range(1, 7))
    for one in content['data_sets']:
        one['file'] = one['file'].replace('.csv', '.npy')
    out = tmp_path / 'out'
    assert main(['insitu', str(write_spec(tmp_path, content)), '-o', str(out), '--json']) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / 'insitu.json').read_text())
    sensor = printed['sensors']['leg']
    assert sensor['rank']['rank'] == 40
    assert len(sensor['data_sets']['set5']['semi_axes']['value']) == 3
    assert sensor['data_sets']['set5']['stated']['added_mass'] == 0.51
    mine, other = load(out / 'calibration.yaml'), load(done / 'calibration.yaml')
    np.testing.assert_allclose(mine.matrix.value, other.matrix.value, rtol=1e-4, atol=1e-7)


def test_motion_is_read_from_the_gyros_columns(tmp_path):
    write_tables(tmp_path, leg=Leg(inertial=True, speed=8.0, duration=20.0))
    content = document(motion=True, accelerometer={
        'columns': ['ax', 'ay', 'az'], 'gyro': {'columns': ['wx', 'wy', 'wz'], 'unit': 'rad/s'}})
    content['sensors']['leg']['accelerometer_position'] = insitu_leg.ACCELEROMETER.tolist()
    for one, load_ in zip(content['data_sets'], PROTOCOL):
        one['position'] = {'leg': list(load_.position)}
    out = tmp_path / 'out'
    assert main(['insitu', str(write_spec(tmp_path, content)), '-o', str(out)]) == 0
    calibration = load(out / 'calibration.yaml')
    assert calibration.inertia is not None
    assert abs(float(calibration.mass) - insitu_leg.BODY_MASS) < 0.03


def test_a_failure_is_one_line_and_exit_one(tables, capsys):
    spec = write_spec(tables, document(data_sets=document()['data_sets'][:2]))
    assert main(['insitu', str(spec), '-o', str(tables / 'none')]) == 1
    complaint = capsys.readouterr().err.strip().splitlines()
    assert len(complaint) == 1
    assert 'rank 33 of 40' in complaint[0]
    assert not (tables / 'none').exists()


@pytest.mark.parametrize('path', sorted(EXAMPLES.glob('insitu_*.yaml')), ids=lambda p: p.stem)
def test_the_examples_can_be_read(path):
    spec = load_spec(path)
    assert spec.sensors and spec.data_sets


@pytest.mark.long
def test_the_example_of_the_foot_works_on_its_recording(icub_data, tmp_path):
    for path in (EXAMPLES / 'insitu_icub_foot.yaml',
                 icub_data / 'right_foot_in_air.csv'):
        (tmp_path / path.name).symlink_to(path)
    out = tmp_path / 'out'
    assert main(['insitu', str(tmp_path / 'insitu_icub_foot.yaml'), '-o', str(out)]) == 0
    sensor = json.loads((out / 'insitu.json').read_text())['sensors']['foot']
    assert sensor['excitation']['weakest'] == 'y'
    (start, end), = sensor['data_sets']['right_foot_in_air']['kept']
    assert abs(start - 21) < 2 and abs(end - 57) < 2


@pytest.mark.parametrize('change, words', [
    ({'format': 'other'}, "format is 'other', expected forcecal-insitu/1"),
    ({'filtre': 'off'}, r'unknown key filtre; did you mean filter\?'),
    ({'sensors': {}}, 'one or more sensors'),
    ({'sensors': {'leg': {'columns': ['a', 'b']}}},
     r'sensors.leg.columns is .*, expected a list of 6 or more'),
    ({'accelerometer': {'columns': ['a', 'b', 'c'], 'unit': 'mile'}},
     "accelerometer.unit is 'mile', expected one of m/s"),
    ({'data_sets': []}, r'data_sets is \[\], expected a list of entries with file'),
    ({'data_sets': [{'file': 'a.csv', 'added_mass': 0.5}]},
     r'data_sets\[1: a.csv\].position is None, expected the position of the added'),
    ({'data_sets': [{'file': 'a.csv', 'window': [5, 2]}]},
     r'window is \(5.0, 2.0\), expected a start before the end'),
    ({'data_sets': [{'file': 'a.csv'}, {'file': 'a.csv'}]},
     r"data_sets is \['a'\], expected unique names"),
    ({'rate': 50.0}, 'rate is 50.0, expected either time or rate, not both'),
    ({'accelerometer': {'unit': 'g'}}, r'expected columns \(of tables\) or a topic'),
    ({'motion': True, 'accelerometer': {'columns': ['a', 'b', 'c']}},
     'accelerometer.gyro is None, expected columns'),
    ({'motion': True, 'accelerometer': {'topic': 'imu', 'gyro': {'fields': ['x', 'y', 'z']}}},
     'gyro.fields .* expected the fields of both'),
    ({'sensors': {'leg': {'topic': 'ft', 'R_sensor_accelerometer': [
        [2, 0, 0], [0, 1, 0], [0, 0, 1]]}}},
     'sensors.leg.R_sensor_accelerometer is .*, expected a rotation matrix'),
    ({'sensors': {'leg': {'topic': 'ft', 'manufacturer_matrix': [[1, 2], [3, 4]]}}},
     'manufacturer_matrix is .*, expected 6 rows of equally many numbers'),
    ({'data_sets': [{'file': 'a.csv', 'added_mass': 0.5, 'position': {'arm': [0, 0, 0]}}]},
     r'position is .*, expected one for each sensor: leg'),
])
def test_a_wrong_spec_is_refused_with_the_key(tmp_path, change, words):
    with pytest.raises(ConfigError, match=words):
        load_spec(write_spec(tmp_path, document(**change)))


def test_a_missing_column_is_named(tables):
    content = document(accelerometer={'columns': ['ax', 'ay', 'nope']})
    spec = load_spec(write_spec(tables, content))
    with pytest.raises(DataError, match="no column 'nope'; there are t, r0"):
        read_table(spec, tables / 'set1.csv', spec.sensors['leg'].columns)


def test_rows_without_numbers_or_out_of_order_are_left_out(tmp_path):
    rows = table_of(PROTOCOL[0], LEG, 1)
    rows[100, 3] = np.nan
    rows[200, 0] = rows[199, 0]
    rows[300, 0] -= 1.0
    save_table(tmp_path / 'a.csv', rows)
    (t, *_), notes = read(tmp_path)
    assert notes[0].startswith('a.csv: 3 rows ')
    assert len(t) == len(rows) - 3
    assert (np.diff(t) > 0).all()


@pytest.mark.parametrize('keys, change', [
    ({'delimiter': ';', 'decimal': ','}, lambda text: text.replace(',', ';').replace('.', ',')),
    ({'header': 3}, lambda text: 'A logger\nof 2019\n' + text),
    ({'comment': '#', 'skip': 1}, lambda text: '# a logger\n' + text.replace(
        '\n', '\n' + ','.join(['s'] * len(COLUMNS)) + '\n', 1))])
def test_tables_of_other_programs_hold_the_same_numbers(tmp_path, keys, change):
    rows = table_of(PROTOCOL[0], LEG, 1)[:50]
    save_table(tmp_path / 'a.csv', rows)
    (tmp_path / 'a.csv').write_text(change((tmp_path / 'a.csv').read_text()))
    chunk, _ = read(tmp_path, **keys)
    np.testing.assert_array_equal(chunk.raw, rows[:, 1:7])


@pytest.mark.parametrize('old, new, words', [
    ('\n3,', '\n3,three,', 'line 4: more cells than the 10 columns of the header'),
    ('\n3,3', '\n3,three', "a.csv line 4: 'three' in column 'r0' is not a number"),
    ('\n3,3', '\n3,', "line 4: '' in column 'r0' is not a number; remove rows with empty")])
def test_a_cell_that_is_no_number_is_named_with_its_line(tmp_path, old, new, words):
    text = '\n'.join([','.join(OF_ONE), *(
        ','.join([str(k)] * len(OF_ONE)) for k in range(1, 9))])
    (tmp_path / 'a.csv').write_text(text.replace(old, new))
    with pytest.raises(DataError, match=words):
        read(tmp_path)


def test_milliseconds_taken_for_seconds_are_questioned(tmp_path):
    rows = table_of(PROTOCOL[0], LEG, 1)
    rows[:, 0] *= 1000
    save_table(tmp_path / 'a.csv', rows)
    for unit, said in (('s', ('2000 rows over 5.6 h', 'not in s')), ('ms', ())):
        _, notes = read(tmp_path, time={'column': 't', 'unit': unit})
        assert len(notes) == bool(said)
        assert all(words in notes[0] for words in said)


def test_units_in_the_names_of_columns_hold(tmp_path):
    for change, words in (
            ({'accelerometer': {'columns': ['ax [g]', 'ay', 'az']}}, 'accelerometer.unit .*g, as'),
            ({'time': {'column': 'time [ms]', 'unit': 's'}}, "time.unit is 's', expected ms")):
        with pytest.raises(ConfigError, match=words):
            load_spec(write_spec(tmp_path, document(**change)))

@pytest.mark.parametrize('spoil, said', [
    (lambda rows: rows[:0], 'set2.csv: no rows'),
    pytest.param(lambda rows: np.where(np.arange(len(rows))[:, None] > 1000, rows[1000], rows)
                 * (np.arange(10) == 8) + rows * (np.arange(10) != 8),
                 r'gravity along y is stuck at \S+ from 10.0', marks=pytest.mark.long),
    (lambda rows: np.where(np.arange(10) == 8, 0.0, rows), 'gravity along y of the sensor never'),
    pytest.param(
        lambda rows: np.where((np.arange(len(rows))[:, None] % 10 == 0) & (np.arange(10) == 3),
                              np.nan, rows),
        r'10.0 % of the samples are not finite', marks=pytest.mark.long)])
def test_a_spoilt_table_among_sound_ones_is_refused_by_cause(tables, tmp_path, capsys, spoil,
                                                            said):
    write_tables(tmp_path, names=OF_ONE, change=lambda k, rows: spoil(rows) if k == 1 else rows)
    spec = write_spec(tmp_path, document())
    assert main(['insitu', str(spec), '-o', str(tmp_path / 'out'), '--quiet']) == 1
    complaint = capsys.readouterr().err.strip().splitlines()[-1]
    assert re.search(said, complaint) and 'set2' in complaint
    assert not (tmp_path / 'out').exists()


def test_time_that_runs_back_and_rows_that_are_repeated_leave_the_result_alone(
        tables, done, tmp_path, capsys):
    write_tables(tmp_path, names=OF_ONE, change=lambda k, rows: np.vstack(
        [rows[:1000], rows[500:]]) if k == 1 else np.repeat(rows, 1 + (k == 2), axis=0))
    spec = write_spec(tmp_path, document())
    assert main(['insitu', str(spec), '-o', str(tmp_path / 'out'), '--quiet']) == 0
    said = capsys.readouterr().err
    assert 'set2.csv: 500 rows' in said and 'set3.csv: 2000 rows' in said
    mine, other = load(tmp_path / 'out/calibration.yaml'), load(done / 'calibration.yaml')
    np.testing.assert_allclose(mine.matrix.value, other.matrix.value, rtol=1e-9)


def test_names_of_an_earlier_run_lead_nowhere_else(tmp_path):
    (tmp_path / 'insitu.json').write_text(json.dumps({'sensors': {'leg': 0, '../x': 0, '*': 0}}))
    assert not [name for name in earlier(tmp_path) if '..' in name or '*' in name]
    assert 'leg/calibration.yaml' in earlier(tmp_path)
