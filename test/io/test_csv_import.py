"""Tables become recordings: exact stamps, SI units, and one clear line where that cannot be."""

import argparse
import json
from pathlib import Path
import re
import struct

from forcecal_ros.cli import import_csv
from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError
from forcecal_ros.core.streams import Phase
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.csv_import import assemble, load_specification
from forcecal_ros.io.csv_import.specification import ORIENTATIONS, UNITS
from forcecal_ros.io.csv_import.table import read_table
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import scipy
from scipy.io import loadmat, savemat
from scipy.spatial.transform import Rotation
import yaml

WRENCH = {'frame': 'ft', 'force': {'columns': ['fx', 'fy', 'fz'], 'unit': 'N'},
          'torque': {'columns': ['tx', 'ty', 'tz'], 'unit': 'N m'}}
HEADER = 't,fx,fy,fz,tx,ty,tz\n'
ROWS = HEADER + '1,1,2,3,4,5,6\n2,7,8,9,10,11,12\n'


def specify(folder, *tables):
    path = folder / 'spec.yaml'
    path.write_text(json.dumps({'format': 'forcecal-import/1', 'tables': list(tables)}))
    return path


def table(text, folder, name='log.csv', unit='s', signals=None, **more):
    (folder / name).write_text(text)
    time = {} if 'rate' in more else {'time': {'column': 't', 'unit': unit}}
    return {'file': name, 'signals': {'wrench': WRENCH} if signals is None else signals,
            **time, **more}


def run_import(specification, bag, *options, topics=None):
    parser = argparse.ArgumentParser()
    import_csv.add_parser(parser.add_subparsers())
    args = parser.parse_args(['import', str(specification), '-o', str(bag), *map(str, options)])
    assert import_csv.run(args) == 0
    return read_recording(bag, topics)


def imported(folder, *tables):
    return assemble(load_specification(specify(folder, *tables)))


def example(name):
    return Path(__file__).parents[2] / 'config' / 'examples' / f'kuka_{name}.yaml'


def test_table_of_poses_gives_one_measurement_a_row(tmp_path, kuka_data):
    recording = run_import(example('poses'), tmp_path / 'bag',
                           '--tables', kuka_data)
    rows = np.loadtxt(kuka_data / '0-calibration_fts-accel.csv',
                      delimiter=',', skiprows=1)
    np.testing.assert_array_equal(recording.wrench.values, rows[:, :6])
    np.testing.assert_allclose(recording.accelerometer.values, 9.80665 * rows[:, 6:9], rtol=1e-15)
    assert recording.accelerometer_unit == 'm/s^2'
    np.testing.assert_allclose(recording.pose.R_base_sensor.reshape(-1, 9), rows[:, 12:],
                               atol=5e-4)
    assert not recording.pose.has_position
    measures = [phase for phase in recording.phases if phase.name == 'measure']
    assert [len(recording.wrench.between(one.start, one.end)) for one in measures] == [1] * 24
    between = [phase for phase in recording.phases if phase.name == 'move']
    assert [len(recording.wrench.between(one.start, one.end)) for one in between] == [0] * 23


@pytest.mark.parametrize('name, part', [
    ('baseline', '1-baseline'),
    pytest.param('contact', '3-vibrations-contact', marks=pytest.mark.long)])
def test_tables_of_one_trajectory_keep_their_stamps(tmp_path, kuka_data, name, part):
    folder = kuka_data
    recording = run_import(example(name), tmp_path / 'bag', '--tables', folder)
    for stream, file in ((recording.wrench, 'wrench'), (recording.accelerometer, 'accel'),
                         (recording.pose, 'orientations')):
        with (folder / f'{part}_{file}.csv').open() as lines:
            next(lines)
            stamps = np.array([int(line.partition(',')[0]) for line in lines])
        read = np.rint(stream.t * 1e9).astype(int) + recording.start_ns
        np.testing.assert_array_equal(read, 1000 * stamps)
    assert recording.notes == ()


@given(st.lists(st.integers(1, 10**15), min_size=1, max_size=20, unique=True),
       st.sampled_from([('us', 1000), ('ns', 1), ('ms', 10**6)]))
@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
def test_integer_times_are_exact(tmp_path, times, unit):
    name, size = unit
    start = 1_600_000_000 * 10**9 // size
    times = [start + time % (10**13 // size) for time in times]
    times = sorted(set(times))
    text = HEADER + ''.join(f'{time},0,0,0,0,0,0\n' for time in times)
    result = imported(tmp_path, table(text, tmp_path, unit=name))
    stamps = np.rint(result.signals['wrench'].t * 1e9).astype(int) + result.start_ns
    assert stamps.tolist() == [size * time for time in times]


def test_decimal_times_are_exact(tmp_path):
    text = HEADER + ''.join(f'1708857503.{i:06d},0,0,0,0,0,0\n' for i in (1, 7, 999_999))
    result = imported(tmp_path, table(text, tmp_path))
    stamps = np.rint(result.signals['wrench'].t * 1e9).astype(int) + result.start_ns
    assert stamps.tolist() == [1708857503_000_001_000, 1708857503_000_007_000,
                               1708857503_999_999_000]


def test_times_from_zero_are_shifted_together(tmp_path):
    accel = {'accel': {'frame': 'a', 'acceleration': {
        'columns': ['ax', 'ay', 'az'], 'unit': 'm/s^2'}}}
    recording = run_import(specify(
        tmp_path, table(ROWS.replace('\n1,', '\n0,'), tmp_path),
        table('t,ax,ay,az\n-0.5,1,2,3\n', tmp_path, 'a.csv', signals=accel)), tmp_path / 'bag')
    assert recording.accelerometer.t.tolist() == [0.0]
    assert recording.wrench.t.tolist() == [0.5, 2.5]
    assert recording.start_ns > 0


def test_forces_become_newtons_with_their_signs(tmp_path):
    for unit, one in (('mN', 1e-3), ('kN', 1e3), ('lbf', 4.4482216), ('kgf', 9.80665)):
        wrench = {**WRENCH, 'force': {'columns': ['fx', 'fy', 'fz'], 'unit': unit,
                                      'signs': [1, 1, -1]}}
        result = imported(tmp_path, table(ROWS, tmp_path, signals={'wrench': wrench}))
        np.testing.assert_allclose(result.signals['wrench'].values[0],
                                   [one, 2 * one, -3 * one, 4, 5, 6], rtol=1e-7)


@pytest.mark.parametrize('role, part, quantity, width', [
    ('accelerometer', 'voltage', 'voltage', 3), ('accel', 'acceleration', 'acceleration', 3),
    ('optidrive', 'displacement', 'length', 1)])
def test_every_unit_of_a_quantity_is_converted(tmp_path, role, part, quantity, width):
    names = [f'c{i}' for i in range(width)]
    for unit, size in UNITS[quantity].items():
        result = imported(tmp_path, table(
            f't,{",".join(names)}\n1,{",".join(["2.5"] * width)}\n', tmp_path,
            signals={role: {'frame': 'f', part: {'columns': names, 'unit': unit}}}))
        np.testing.assert_array_equal(result.signals[role].values, np.full((1, width), 2.5) * size)


def test_gyro_in_degrees_becomes_radians(tmp_path):
    imu = {'imu': {'frame': 'imu',
                   'acceleration': {'columns': ['ax', 'ay', 'az'], 'unit': 'g'},
                   'angular_velocity': {'columns': ['wx', 'wy', 'wz'], 'unit': 'deg/s'}}}
    recording = run_import(specify(tmp_path, table(
        't,ax,ay,az,wx,wy,wz\n1,0,0,1,180,0,-90\n', tmp_path, signals=imu)), tmp_path / 'bag')
    np.testing.assert_allclose(recording.accelerometer.values, [[0, 0, 9.80665]])
    np.testing.assert_allclose(recording.angular_velocity.values, [[np.pi, 0, -np.pi / 2]])


@pytest.mark.parametrize('convention', ORIENTATIONS)
def test_every_way_to_write_an_orientation_is_the_same_rotation(tmp_path, convention):
    rotations = Rotation.from_quat(np.random.default_rng(4).normal(size=(5, 4)))
    written = {
        'R_base_sensor': rotations.as_matrix().reshape(5, 9),
        'R_sensor_base': rotations.inv().as_matrix().reshape(5, 9),
        'quaternion_xyzw': rotations.as_quat(),
        'rpy': rotations.as_euler('xyz', degrees=True),
        'euler_xyz': rotations.as_euler('XYZ', degrees=True),
        'rotation_vector': rotations.as_rotvec(degrees=True),
    }[convention]
    names = [f'q{i}' for i in range(written.shape[1])]
    columns = {'columns': names, 'unit': 'deg'} if len(names) == 3 else names
    rows = ''.join(f'{i + 1},{1000 * i},0,0,{",".join(map(repr, row.tolist()))}\n'
                   for i, row in enumerate(written))
    result = imported(tmp_path, table(
        f't,x,y,z,{",".join(names)}\n{rows}', tmp_path, signals={'pose': {
            'frame': 'base', convention: columns,
            'position': {'columns': ['x', 'y', 'z'], 'unit': 'mm'}}}))
    poses = result.signals['pose']
    np.testing.assert_allclose(poses.R_base_sensor, rotations.as_matrix(), atol=1e-14)
    np.testing.assert_array_equal(poses.position[:, 0], np.arange(5.0))


def pose_of(folder, header, row, **pose):
    return imported(folder, table(f't,{header}\n1,{row}\n', folder, signals={
        'pose': {'frame': 'base', **pose}})).signals['pose']


@pytest.mark.parametrize('names', [
    ['qw', 'qx', 'qy', 'qz'], ['q_w', 'q_x', 'q_y', 'q_z'], ['W', 'X', 'Y', 'Z'],
    ['pose.orientation.w', 'pose.orientation.x', 'pose.orientation.y', 'pose.orientation.z']])
def test_quaternion_that_begins_with_w_is_not_read_as_xyzw(tmp_path, names):
    with pytest.raises(ConfigError, match='quaternion_xyzw.*x, y, z and w in this order'):
        pose_of(tmp_path, ','.join(names), '1,0,0,0', quaternion_xyzw=names)
    poses = pose_of(tmp_path, ','.join(names), '1,0,0,0', quaternion_xyzw=names[1:] + names[:1])
    np.testing.assert_array_equal(poses.R_base_sensor[0], np.eye(3))


def test_degrees_stated_as_radians_are_refused(tmp_path):
    names = ['r', 'p', 'y']
    with pytest.raises(DataError, match='line 2.*more than 4 pi.*rpy in degrees'):
        pose_of(tmp_path, 'r,p,y', '10,0,-90', rpy={'columns': names, 'unit': 'rad'})


@pytest.mark.parametrize('column, right, wrong', [
    ('fx [mN]', 'mN', 'N'), ('fx (N)', 'N', 'kgf'), ('fx_kN', 'kN', 'N'), ('fx_g', 'N', None)])
def test_unit_in_the_name_of_a_column_holds(tmp_path, column, right, wrong):
    def read(unit):
        force = {'columns': [column, 'fy', 'fz'], 'unit': unit}
        return imported(tmp_path, table(ROWS.replace('fx', column), tmp_path, signals={
            'wrench': {**WRENCH, 'force': force}}))
    assert read(right).signals['wrench'].values.shape == (2, 6)
    if wrong is not None:
        with pytest.raises(ConfigError, match=f'force.unit is {wrong!r}, expected {right}, as'):
            read(wrong)
    one = table(ROWS.replace('t,', 'time [ms],', 1), tmp_path)
    one['time'] = {'column': 'time [ms]', 'unit': 's'}
    with pytest.raises(ConfigError, match="time.unit is 's', expected ms"):
        imported(tmp_path, one)


def test_phases_from_a_column_change_where_the_word_does(tmp_path):
    words = ['settle', 'measure', 'measure', 'move']
    text = 't,fx,fy,fz,tx,ty,tz,state\n' + ''.join(
        f'{i + 1},0,0,0,0,0,0,{word}\n' for i, word in enumerate(words))
    recording = run_import(specify(tmp_path, table(
        text, tmp_path, phases={'column': 'state'})), tmp_path / 'bag')
    assert recording.phases == (
        Phase('settle', 0.0, 1.0), Phase('measure', 1.0, 3.0), Phase('move', 3.0, 4.0),
        Phase('done', 4.0, 4.0))


def test_whole_table_is_one_phase(tmp_path):
    text = ROWS.replace('t,', '').replace('\n1,', '\n').replace('\n2,', '\n')
    recording = run_import(specify(tmp_path, table(
        text, tmp_path, rate=10, phases={'whole': 'measure'})), tmp_path / 'bag')
    assert recording.phases[0] == Phase('measure', 0.0, 0.2)
    assert len(recording.wrench.between(0.0, 0.2)) == 2


def test_topic_and_frame_are_the_ones_named(tmp_path):
    signals = {'wrench': {**WRENCH, 'topic': '/jr3/wrench_raw'}}
    recording = run_import(specify(tmp_path, table(ROWS, tmp_path, signals=signals)),
                           tmp_path / 'bag', topics={'wrench': 'jr3/wrench_raw'})
    assert recording.wrench.frame == 'ft'
    assert len(recording.wrench) == 2


@pytest.mark.parametrize('text, dialect', [
    (ROWS.replace(',', ';').replace('7', '7,5'), {'delimiter': ';', 'decimal': ','}),
    ('\ufeff' + ROWS.replace(',', '\t').replace('7', '7.5'), {'delimiter': '\t'}),
    ('# a robot, of 2019\n' + ROWS.replace('7', '7.5') + '# end\n', {'comment': '#'}),
    ('Some sensor\nserial,12\n' + ROWS.replace('7', '7.5'), {'header': 3}),
    (ROWS.replace('7', '7.5').replace(HEADER, HEADER + 's,N,N,N,Nm,Nm,Nm\n'), {'skip': 1}),
    (ROWS.replace('7', '7.5').replace(',', '   ').replace('\n', ' \n '), {'delimiter': ' '}),
    (ROWS.replace('7', '7.5').replace('\n', ',\n'), {}),
    (ROWS.replace('7', '7.5') + '3,1,2', {}),
    ('# ' + ROWS.replace('7', '7.5').replace(',', ' '), {'delimiter': ' '})])
def test_tables_of_other_programs_hold_the_same_numbers(tmp_path, text, dialect):
    wrench = imported(tmp_path, table(text, tmp_path, **dialect)).signals['wrench']
    assert wrench.values.tolist() == [[1, 2, 3, 4, 5, 6], [7.5, 8, 9, 10, 11, 12]]


@pytest.mark.parametrize('text, message', [
    (ROWS.replace('8', '"8,5"'), "line 3: '8,5' in column 'fy' is not a number.*decimal: ','"),
    (ROWS.replace('\n2,', '\n2024-05-06T07:08:09Z,'), 'if the times are dates, set unit: date'),
    ('# 2019\n' + ROWS, 'line 2: more cells than the 1 columns of the header.*comment'),
    (ROWS.replace('\n2,', '\n1,'), "line 3: time 1 in column 't' is not after 1"),
    (ROWS.replace('\n2,', '\nnoon,'), "line 3: 'noon' in column 't' is not a number"),
    (ROWS.replace('\n2,', '\n1e400,'), 'out of range; check the unit'),
    (ROWS.replace(',12', ''), "line 3: '' in column 'tz' is not a number"),
    (ROWS.replace(',12', ',12,13'), 'line 3: more cells than the 7 columns of the header'),
    (ROWS.replace('fx,fy', 'fx,fx'), "several columns 'fx'|no column 'fy'"),
    (ROWS[len(HEADER):], "no column 't': the header line contains numbers; set header"),
    ('', 'no rows'),
    ('t,"fx\n1,2', 'not a text table'),
])
def test_faulty_table_is_one_line_that_says_where(tmp_path, text, message):
    with pytest.raises(DataError, match=message) as error:
        run_import(specify(tmp_path, table(text, tmp_path)), tmp_path / 'bag')
    assert '\n' not in str(error.value)
    assert not (tmp_path / 'bag').exists()


def test_a_table_without_names_has_columns_by_number(tmp_path):
    signals = {'wrench': {'frame': 'ft', 'force': {'columns': ['1', '2', '3'], 'unit': 'N'},
                          'torque': {'columns': ['4', '5', '6'], 'unit': 'N m'}}}
    one = table(ROWS[len(HEADER):], tmp_path, signals=signals, header=0)
    one['time']['column'] = '0'
    result = imported(tmp_path, one)
    assert result.signals['wrench'].values.tolist() == [[1, 2, 3, 4, 5, 6],
                                                        [7, 8, 9, 10, 11, 12]]


def test_rows_that_are_none_of_their_own_are_told(tmp_path):
    twice = ROWS + ROWS.splitlines()[-1] + '\n3,7,8'
    result = imported(tmp_path, table(twice, tmp_path))
    assert len(result.signals['wrench']) == 2
    cut, repeated = result.notes
    assert '1 rows repeat stamp and' in repeated and 'line 5: the last line is incomplete' in cut
    of_rate = imported(tmp_path, table(twice[:-6], tmp_path, rate=10))
    assert len(of_rate.signals['wrench']) == 3 and not of_rate.notes


def stamped(folder, fraction, rows=100):
    """Import rows 20 ms apart whose time is in two columns."""
    lines = (f'{5 + k // 50},{fraction(k % 50)},{k},0,0,0,0,0' for k in range(rows))
    one = table('sec,nsec' + HEADER[1:] + '\n'.join(lines) + '\n', folder)
    one['time'] = {'column': 'sec', 'unit': 's', 'nanoseconds': 'nsec'}
    return imported(folder, one)


def test_seconds_and_nanoseconds_in_two_columns_are_one_time(tmp_path):
    result = stamped(tmp_path, lambda k: 20_000_000 * k)
    np.testing.assert_allclose(np.diff(result.signals['wrench'].t), 0.02, atol=1e-12)


@pytest.mark.parametrize('fraction, message', [
    (lambda k: 20_000 * k, 'never exceeds 980000: these are microseconds; multiply them by 1000'),
    (lambda k: 20 * k, 'these are milliseconds; multiply them by 1000000'),
    (lambda k: 10**9 + k, 'expected nanoseconds from 0')])
def test_parts_of_a_second_in_another_unit_are_refused(tmp_path, fraction, message):
    with pytest.raises(DataError, match=message):
        stamped(tmp_path, fraction)


def test_nanoseconds_do_not_come_on_top_of_fractions(tmp_path):
    one = table(ROWS.replace('\n2,', '\n2.5,'), tmp_path)
    one['time']['nanoseconds'] = 'fx'
    with pytest.raises(DataError, match="'t' has fractions of a second"):
        imported(tmp_path, one)


@pytest.mark.parametrize('times, message', [
    ((86399, 0.5), 'passes midnight; add 24 h'),
    ((5, 1), 'sort the table, or import each part'),
    (('5.80000000', '5.90000000', '5.100000000'), 'no leading zeros'),
    ((1, 1), 'as in 1 rows: the resolution .* set rate')])
def test_times_that_do_not_grow_are_told_by_their_kind(tmp_path, times, message):
    text = HEADER + ''.join(f'{t},{k},2,3,4,5,6\n' for k, t in enumerate(times))
    with pytest.raises(DataError, match=message):
        imported(tmp_path, table(text, tmp_path))


def test_rows_of_merged_streams_count_where_a_signal_has_cells(tmp_path):
    signals = {'wrench': WRENCH, 'pose': {'frame': 'base', 'rpy': {
        'columns': ['a', 'b', 'c'], 'unit': 'rad'}}}
    text = (HEADER.strip() + ',a,b,c\n1,1,2,3,4,5,6,,,\n2,,,,,,,0,0,1\n'
            '3,7,8,9,10,11,12,,, \n4,,,,,,,0,0,2\n')
    result = imported(tmp_path, table(text, tmp_path, signals=signals))
    assert result.signals['wrench'].t.tolist() == [0, 2]
    assert result.signals['pose'].t.tolist() == [1, 3]
    assert [note.split(': ')[1] for note in result.notes] == [
        '2 of 4 rows have values of wrench', '2 of 4 rows have values of pose']
    with pytest.raises(DataError, match="line 2: '' in column 'fy' is not a number.*empty cells"):
        imported(tmp_path, table(text.replace('1,1,2,', '1,1,,'), tmp_path, signals=signals))


def test_angles_about_other_axes_do_not_turn_as_the_weight_does(tmp_path):
    R = weighed()[1]
    assert moved(tmp_path, R.as_euler('XYZ'), euler_xyz='rad').notes == ()
    for written, key, said in (
            (R.as_euler('xyz')[:, ::-1], 'rpy', 'in the order yaw, pitch, roll'),
            (R.as_euler('XYZ'), 'rpy', 'if it is euler_xyz'),
            (R.as_euler('xyz'), 'euler_xyz', 'if it is rpy'),
            (R.as_euler('ZYZ'), 'rpy', 'about the moving axes z, y, z'),
            (R.as_rotvec(), 'rpy', 'if it is rotation_vector')):
        with pytest.raises(DataError, match=said):
            moved(tmp_path, written, **{key: 'rad'})


def test_binary_and_missing_files_are_one_line(tmp_path):
    specification = specify(tmp_path, table(ROWS, tmp_path))
    (tmp_path / 'log.csv').write_bytes(b'\xff\xfe\x00t,\x80')
    with pytest.raises(DataError, match='not a text table'):
        assemble(load_specification(specification))
    with pytest.raises(ConfigError, match='log.csv: binary data, expected YAML'):
        load_specification(tmp_path / 'log.csv')
    (tmp_path / 'log.csv').unlink()
    with pytest.raises(DataError, match='log.csv: cannot be read .*No such file'):
        assemble(load_specification(specification))


@pytest.mark.parametrize('matrix, message', [
    ('1,0,0,0,1,0,0,0,2', 'line 2: the orientation is not a rotation matrix'),
    ('1,0,0,0,1,0,0,0,-1', 'line 2: the orientation is a reflection'),
    ('1,0,0,0,nan,0,0,0,1', 'line 2: the orientation is not a rotation matrix')])
def test_matrix_that_is_no_rotation_is_refused(tmp_path, matrix, message):
    names = [f'r{i}' for i in range(9)]
    poses = {'pose': {'frame': 'base', 'R_base_sensor': names}}
    with pytest.raises(DataError, match=message):
        imported(tmp_path, table(f't,{",".join(names)}\n1,{matrix}\n', tmp_path, signals=poses))


def changed(**keys):
    return {key: value for key, value in {**WRENCH, **keys}.items() if value is not None}


@pytest.mark.parametrize('change, message', [
    ({'signals': {'wrench': changed(force={'columns': ['fx', 'fy', 'fz'], 'unit': 'V'})}},
     r"signals.wrench.force.unit is 'V', expected a unit of force: N, mN"),
    ({'signals': {'wrench': changed(force={'columns': ['fx', 'fy'], 'unit': 'N'})}},
     r'force.columns is .*, expected a list of 3 columns'),
    ({'signals': {'wrench': changed(torque=None)}}, 'signals.wrench: missing key torque'),
    ({'signals': {'force': WRENCH}},
     'signals: unknown key force; expected one of wrench, contact_truth'),
    ({'signals': {'pose': {'frame': 'base'}}},
     r'signals.pose is \[\], expected one of R_base_sensor'),
    ({'signals': {'wrench': changed(force={
        'columns': ['fx', 'fy', 'fz'], 'unit': 'N', 'signs': [1, 1, 0]})}},
     'force.signs is .*, expected 3 numbers, each 1 or -1'),
    ({'signals': {}}, 'log.csv has neither signals nor phases'),
    ({'time': {'column': 't', 'unit': 'h'}}, "time.unit is 'h', expected one of s, ms, us, ns"),
    ({'time': None}, 'time is None, expected either time .column and unit. or rate'),
    ({'start': 1.0}, 'start is for tables without time'),
    ({'phases': {'each_row': 'measure'}},
     r"phases is \['each_row'\], expected column, or each_row and between"),
    ({'phases': {'each_row': 'move', 'between': 'move'}},
     'phases.between is .*, expected a phase other than each_row'),
    ({'decimal': ','}, "delimiter is ',', expected a character other than decimal"),
])
def test_faulty_specification_names_the_key(tmp_path, change, message):
    with pytest.raises(ConfigError, match=message) as error:
        imported(tmp_path, {**table(ROWS, tmp_path), **change})
    assert 'spec.yaml' in str(error.value)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize('text, message', [
    ('', 'the file is None, expected the keys tables'),
    ('format: other/1', "format is 'other/1', expected forcecal-import/1")])
def test_file_that_is_no_specification_is_refused(tmp_path, text, message):
    (tmp_path / 'spec.yaml').write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_specification(tmp_path / 'spec.yaml')


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
                    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(
                        st.sampled_from(['file', 'time', 'rate', 'signals', 'wrench', 'force',
                                         'columns', 'unit', 'frame', 'phases', 'pose', 'start']),
                        inner, max_size=6), max_leaves=25))
@settings(deadline=None, suppress_health_check=list(HealthCheck))
def test_any_document_is_read_or_refused(tmp_path, value):
    path = tmp_path / 'spec.yaml'
    path.write_text(yaml.safe_dump({'format': 'forcecal-import/1', 'tables': [value]}))
    try:
        assemble(load_specification(path))
    except ForcecalError as error:
        assert '\n' not in str(error)


def test_same_signal_twice_and_strange_time_bases_are_refused(tmp_path):
    first, second = table(ROWS, tmp_path, 'a.csv'), table(ROWS, tmp_path, 'b.csv')
    with pytest.raises(ConfigError, match='wrench in more than one table'):
        imported(tmp_path, first, second)
    accel = {'accel': {'frame': 'a', 'acceleration': {
        'columns': ['ax', 'ay', 'az'], 'unit': 'm/s^2'}}}
    late = table('t,ax,ay,az\n1708857503,1,2,3\n', tmp_path, 'c.csv', signals=accel)
    with pytest.raises(DataError, match='c.csv begins 19778 days after .*a.csv ends'):
        imported(tmp_path, first, late)


def weighed(seed=0, n=400, spread=0.6):
    """Poses of a robot that points down and tilts, and the force of a tool of 1 kg there."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 100.0
    angles = spread * np.stack([np.sin((k + 1) * t + k) for k in range(3)], axis=1)
    R = Rotation.from_euler('xyz', angles)
    force = R.inv().apply([0.0, 0.0, -9.81]) + 0.05 * rng.normal(size=(n, 3)) + [3.0, -2.0, 1.0]
    return t, R, force


def moved(folder, written, spread=0.6, in_base=False, **orientation):
    t, R, force = weighed(spread=spread)
    force = R.apply(force) if in_base else force
    names = [f'o{i}' for i in range(written.shape[1])]
    rows = np.column_stack([t, force, 0 * force, written])
    text = ','.join(['t', 'fx', 'fy', 'fz', 'tx', 'ty', 'tz', *names]) + '\n' + '\n'.join(
        ','.join(map(repr, row)) for row in rows.tolist()) + '\n'
    (key, unit), = orientation.items()
    columns = {'columns': names, 'unit': unit} if unit else names
    return imported(folder, table(text, folder, signals={
        'wrench': WRENCH, 'pose': {'frame': 'base', key: columns}}))


@pytest.mark.parametrize('key', ['rpy', 'rotation_vector'])
@pytest.mark.parametrize('unit, other, spread', [('rad', 'deg', 0.6), ('deg', 'rad', 0.1)])
def test_angles_in_another_unit_do_not_turn_as_the_weight_does(tmp_path, key, unit, other, spread):
    R = weighed(spread=spread)[1]
    angles = R.as_euler('xyz') if key == 'rpy' else R.as_rotvec()
    angles = {'rad': angles, 'deg': np.rad2deg(angles)}
    assert moved(tmp_path, angles[unit], spread, **{key: unit}).notes == ()
    with pytest.raises(DataError, match=rf'{key}.*(\(unit: {unit}\)|its unit is {unit} )'):
        moved(tmp_path, angles[unit], spread, **{key: other})


def test_a_wrench_in_base_is_not_blamed_on_the_orientation(tmp_path):
    R = weighed()[1].as_euler('xyz')
    assert len(moved(tmp_path, R, in_base=True, rpy='rad').signals['pose']) == 400


def rows_at(times, cell='1'):
    return HEADER + ''.join(f'{t!r},{cell},2,3,4,5,6\n' for t in times)


def test_a_rate_that_no_sensor_has_is_questioned(tmp_path):
    milliseconds = [float(k) for k in range(1, 2001)]
    assert imported(tmp_path, table(rows_at(milliseconds), tmp_path, unit='ms')).notes == ()
    note, = imported(tmp_path, table(rows_at(milliseconds), tmp_path)).notes
    assert "column 't': 2000 rows over 0.56 h, 1 per second" in note and 'not in s' in note
    seconds = [k / 1000 for k in range(1, 2001)]
    note, = imported(tmp_path, table(rows_at(seconds), tmp_path, unit='us')).notes
    assert 'more than any sensor sends' in note


def test_cells_that_are_nan_are_counted_and_their_line_is_named(tmp_path):
    text = rows_at(range(1, 1001)).replace('\n7,1,', '\n7,nan,')
    note, = (one for one in imported(tmp_path, table(text, tmp_path, unit='ms')).notes)
    assert '1 of 1000 rows of wrench are not finite' in note and 'log.csv line 8;' in note


def test_lines_that_skip_leaves_out_are_counted(tmp_path, capsys):
    text = ROWS.replace(HEADER, HEADER + 's,N,N,N,Nm,Nm,Nm\n')
    run_import(specify(tmp_path, table(text, tmp_path, skip=2)), tmp_path / 'bag')
    assert re.search('skip ignores 2 lines; .*log.csv line 3 contains numbers',
                     capsys.readouterr().err)
    note, = imported(tmp_path, table(text, tmp_path, skip=1)).notes
    assert note.endswith('skip ignores 1 line')


def test_the_example_of_a_universal_robot_is_imported(tmp_path):
    t, R, _ = weighed(1)
    names = ['timestamp', *(f'actual_TCP_pose_{k}' for k in range(6)),
             *(f'actual_TCP_force_{k}' for k in range(6))]
    place = np.stack([0.4 + 0.1 * np.sin(t), 0.1 * np.cos(t), 0.3 + 0 * t], axis=1)
    contact = 0.2 * np.random.default_rng(2).normal(size=(len(t), 6))
    rows = np.hstack([5000.0 + t[:, None], place, R.as_rotvec(), contact])
    np.savetxt(tmp_path / 'robot_data.csv', rows, header=' '.join(names), comments='', fmt='%.9f')
    recording = run_import(Path(example('poses')).with_name('ur_rtde.yaml'), tmp_path / 'bag',
                           '--tables', tmp_path)
    np.testing.assert_allclose(recording.wrench.values, contact, atol=1e-8)
    np.testing.assert_allclose(recording.pose.R_base_sensor, R.as_matrix(), atol=1e-8)
    np.testing.assert_allclose(recording.pose.position, place, atol=1e-8)
    assert recording.wrench.frame == 'base'


@pytest.mark.parametrize('cell', [
    '2018-01-25T10:47:34.25Z', '2018/01/25/10:47:34.25', '2018-01-25 04:17:34,25-0630'])
def test_dates_are_times(tmp_path, cell):
    rows = HEADER + f'"{cell}",1,2,3,4,5,6\n2018-01-25 10:47:35.250000001,7,8,9,1,2,3\n'
    found = imported(tmp_path, table(rows, tmp_path, unit='date'))
    assert found.start_ns == 1516877254250000000
    np.testing.assert_allclose(found.signals['wrench'].t, [0.0, 1.000000001], rtol=1e-15)


@pytest.mark.parametrize('cell, why', [
    *((cell, "line 2: .* in column 't' is not a") for cell in (
        '25/01/2018 10:47:34', '2018-13-01 00:00:00', '10:47:34', '3.5')),
    ('9018-01-25 10:47:34', "'t' are out of range")])
def test_what_is_no_date_is_told(tmp_path, cell, why):
    rows = HEADER + f'{cell},1,2,3,4,5,6\n9031-01-01 00:00:00,7,8,9,1,2,3\n'
    with pytest.raises(DataError, match=why):
        imported(tmp_path, table(rows, tmp_path, unit='date'))


def test_messages_that_were_not_renewed_are_left_out(tmp_path):
    rows = ('t,u,fx,fy,fz,tx,ty,tz,x,y,z,w\n'
            '1,1,1,2,3,4,5,6,0,0,0,1\n1,2,1,2,3,4,5,6,0,0,1,0\n2,3,7,8,9,1,2,3,1,0,0,0\n')
    pose = {'frame': 'base', 'quaternion_xyzw': ['x', 'y', 'z', 'w']}
    one = table(rows, tmp_path)
    other = {'file': 'log.csv', 'time': {'column': 'u', 'unit': 's'}, 'signals': {'pose': pose}}
    found = imported(tmp_path, one, other)
    assert (len(found.signals['wrench']), len(found.signals['pose'])) == (2, 3)
    assert any('1 rows repeat stamp and values' in note for note in found.notes)
    together = table(rows, tmp_path, signals={'wrench': WRENCH, 'pose': pose})
    with pytest.raises(DataError, match='merges streams, list it once for each'):
        imported(tmp_path, together)


URDF = """<robot name="r"><link name="base"/><link name="hand"/><joint name="a" type="revolute">
<parent link="base"/><child link="hand"/><origin xyz="0 0 0.5"/><axis xyz="0 1 0"/></joint></robot>
"""


def test_joints_and_a_urdf_make_poses(tmp_path):
    (tmp_path / 'robot.urdf').write_text(URDF)
    joints = {'names': ['other', 'a'], 'position': {'columns': ['q0', 'q1'], 'unit': 'deg'}}
    rows = 't,q0,q1,fx,fy,fz,tx,ty,tz\n' + ''.join(
        f'{k},{k},{30 * k},1,{k},3,4,5,6\n' for k in range(4))
    recording = run_import(
        specify(tmp_path, table(rows, tmp_path, signals={
            'wrench': WRENCH, 'joint_states': joints})), tmp_path / 'bag',
        topics={'pose': f'urdf:{tmp_path}/robot.urdf:base:hand'})
    np.testing.assert_allclose(
        recording.pose.R_base_sensor,
        Rotation.from_euler('y', 30.0 * np.arange(4)[:, None], degrees=True).as_matrix(),
        atol=1e-12)
    np.testing.assert_allclose(recording.pose.position, [[0.0, 0.0, 0.5]] * 4)


@pytest.mark.parametrize('names', [['a'], ['a', 'a'], ['a', 'b', 'c']])
def test_joints_have_a_name_each(tmp_path, names):
    joints = {'names': names, 'position': {'columns': ['fx', 'fy'], 'unit': 'rad'}}
    with pytest.raises(ConfigError, match='names.*2 different names, one per column'):
        imported(tmp_path, table(ROWS, tmp_path, signals={'joint_states': joints}))


LONG = {'time': {'column': 't', 'unit': 's'}, 'long': {'name': 'signal', 'value': 'v'}}


def test_a_table_with_one_row_a_signal_is_the_same_as_one_with_a_column_a_signal(tmp_path):
    # signal by signal, so that times begin again with each
    names = HEADER.strip().split(',')[1:]
    rows = ['t,signal,v', *(f'{k}.5,{name},{10 * k + j}' for j, name in enumerate(names)
                            for k in (9, 10)), '9.75,q,180']
    joint = {'joint_states': {'names': ['a'], 'position': {'columns': ['q'], 'unit': 'deg'}}}
    one = {**table('\n'.join(rows) + '\n', tmp_path, signals={'wrench': WRENCH, **joint}), **LONG}
    found = imported(tmp_path, one)
    wrench, q = found.signals['wrench'], found.signals['joint_states']
    assert wrench.t.tolist() == [0.0, 1.0] and q.t.tolist() == [0.25]
    assert wrench.values.tolist() == [[90, 91, 92, 93, 94, 95], [100, 101, 102, 103, 104, 105]]
    assert q.values.tolist() == [[np.pi]]
    np.testing.assert_array_equal(
        run_import(tmp_path / 'spec.yaml', tmp_path / 'bag').wrench.values, wrench.values)


@pytest.mark.parametrize('row, message', [
    ('1,fx,2', "line 9: 'fx' at time 1 appears twice"),
    ('2,fx,two', "line 9: 'two' in column 'fx' is not a number"),
    ('noon,fx,2', "line 9: 'noon' in column 't' is not a number")])
def test_a_faulty_row_of_one_signal_is_named(tmp_path, row, message):
    names = HEADER.strip().split(',')[1:]
    text = 't,signal,v\n' + ''.join(f'1,{name},1\n' for name in names) + '3,other,4\n' + row + '\n'
    with pytest.raises(DataError, match=message):
        imported(tmp_path, {**table(text, tmp_path), **LONG})


def matlab(folder, unit='s', **variables):
    savemat(folder / 'log.mat', variables)
    wrench = {'frame': 'ft', 'force': {'columns': [f'log.f({k})' for k in (1, 2, 3)], 'unit': 'N'},
              'torque': {'columns': ['tx', 'ty', 'tz'], 'unit': 'N m'}}
    return imported(folder, {'file': 'log.mat', 'time': {'column': 't', 'unit': unit},
                             'signals': {'wrench': wrench}})


def test_variables_of_a_matlab_file_are_columns(tmp_path):
    rng = np.random.default_rng(1)
    force, torque, t = rng.normal(size=(5, 3)), rng.normal(size=(3, 5)), 5.0 + np.arange(5) / 3.0
    found = matlab(tmp_path, t=t[:, None], log={'f': force}, tx=torque[0], ty=torque[1],
                   tz=torque[2], other=np.zeros((2, 2, 2)))
    wrench = found.signals['wrench']
    np.testing.assert_array_equal(wrench.values, np.hstack([force, torque.T]))
    np.testing.assert_allclose(wrench.t, t - 5.0, atol=1e-9)  # stamps are whole nanoseconds
    np.testing.assert_array_equal(
        run_import(tmp_path / 'spec.yaml', tmp_path / 'bag').wrench.values, wrench.values)


def test_a_matlab_file_that_lacks_a_variable_is_refused_by_name(tmp_path):
    ramp = np.arange(4.0)
    with pytest.raises(DataError, match=r"no column 'log.f\(1\)'; there are t, tx, ty, tz"):
        matlab(tmp_path, t=ramp, tx=ramp, ty=ramp, tz=ramp)
    with pytest.raises(DataError, match='expected one length'):
        matlab(tmp_path, t=ramp, log={'f': np.ones((4, 3))}, tx=ramp, ty=ramp, tz=ramp[1:])
    (tmp_path / 'log.mat').write_bytes(b'MATLAB 7.3 MAT-file, but damaged' * 9)
    spec = json.loads((tmp_path / 'spec.yaml').read_text())
    with pytest.raises(DataError, match='log.mat: .*MATLAB'):
        imported(tmp_path, *spec['tables'])


def test_a_matlab_file_with_numbers_of_an_unknown_type_is_refused(tmp_path):
    """scipy.io.loadmat ends the process over such a file."""
    ramp = np.arange(1.0, 5.0)
    matlab(tmp_path, t=ramp, log={'f': np.ones((4, 3))}, tx=ramp, ty=ramp, tz=ramp)
    path = tmp_path / 'log.mat'
    content, tag = path.read_bytes(), struct.pack('<2I', 9, 8 * len(ramp))
    path.write_bytes(content.replace(tag, struct.pack('<2I', 0x4009, 8 * len(ramp)), 1))
    assert path.read_bytes() != content
    spec = json.loads((tmp_path / 'spec.yaml').read_text())
    with pytest.raises(DataError, match='not an intact MATLAB file of version 5 to 7'):
        imported(tmp_path, *spec['tables'])


@pytest.mark.parametrize('name', ['big_endian', 'testdouble_6.1_SOL2', 'testmulti_7.4_GLNX86',
                                  'teststruct_7.4_GLNX86'])
def test_files_by_matlab_hold_what_scipy_reads(name):
    path = Path(scipy.io.__file__).parent / f'matlab/tests/data/{name}.mat'
    if not path.exists():
        pytest.skip('SciPy is installed without its tests')
    known = {}
    for key, value in loadmat(path, simplify_cells=True).items():
        fields = {f'{key}.{k}': v for k, v in value.items()} if isinstance(value, dict) else {
            key: value}
        for field, one in fields.items():
            if isinstance(one, np.ndarray) and one.dtype.kind in 'fiu':
                known |= {field: one} if one.ndim == 1 else {
                    f'{field}({k})': column for k, column in enumerate(one.T, 1)}
    assert known
    for column, values in known.items():
        assert read_table(path, None, [column]).numbers([column])[:, 0].tolist() == values.tolist()
