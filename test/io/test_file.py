"""The calibration file gives back what was written, and says what is wrong with what was not."""

from dataclasses import replace
import math

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.io import calibration_file
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
import numpy as np
import pytest
from whole_calibration import whole_calibration
import yaml


def assert_same(a, b):
    assert calibration_file.to_document(a) == calibration_file.to_document(b)


def test_what_was_saved_is_what_is_loaded(tmp_path):
    path = tmp_path / 'calibration.yaml'
    calibration_file.save(whole_calibration(), path)
    assert_same(calibration_file.load(path), whole_calibration())


def test_parts_that_were_not_identified_come_back_as_none():
    c = whole_calibration()
    bare = Calibration(mass=c.mass, com=c.com, wrench_bias=c.wrench_bias)
    text = calibration_file.dump(bare)
    assert yaml.safe_load(text)['inertia'] == 'not identified'
    back = calibration_file.parse(text)
    assert back.inertia is None and back.accelerometer is None and back.observer is None
    assert_same(back, bare)


def test_a_share_directory_is_refused(tmp_path):
    with pytest.raises(ConfigError, match='share directory'):
        calibration_file.save(whole_calibration(), tmp_path / 'share/forcecal_ros/c.yaml')


@pytest.mark.parametrize(('path', 'value', 'message'), [
    (('format',), 'forcecal-calibration/9', 'format'),
    (('mass', 'value'), -1.0, 'mass.value is -1.0, expected a number above 0 [kg]'),
    (('mass', 'value'), 'heavy', "mass.value is 'heavy', expected a number"),
    (('mass', 'unit'), 'lb', "mass.unit is 'lb', expected kg"),
    (('com',), {'value': [1, 2], 'unit': 'm'},
     'com.value is [1, 2], expected a list of 3 numbers [m]'),
    (('wrench_bias', 'value'), [math.nan] * 6, 'wrench_bias.value'),
    (('accelerometer', 'coupling'), 'wireless', 'accelerometer.coupling'),
    (('accelerometer', 'map', 'value'), np.zeros((3, 3)).tolist(), 'singular'),
    (('sensor', 'sign'), 2, 'sensor.sign is 2, expected one of 1, -1'),
    (('matrix', 'value'), [[1.0] * 7 for _ in range(5)], 'matrix.value'),
    (('matrix', 'offset', 'value'), [1.0] * 6, 'matrix.offset'),
    (('mass', 'std'), [0.1], 'mass.std is [0.1], expected a number of at least 0 [kg]'),
    (('comm',), 'a key of somebody else', 'unknown key comm; did you mean com?'),
    (('tool',), 3, 'tool is 3, expected the keys stiffness, damping'),
])
def test_a_wrong_entry_is_named_with_what_was_expected(path, value, message):
    document = calibration_file.to_document(whole_calibration())
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    if path == ('comm',):
        del document['com']
    with pytest.raises(ConfigError) as caught:
        calibration_file.parse(yaml.safe_dump(document), 'cal.yaml')
    text = str(caught.value)
    assert message in text and text.startswith('cal.yaml: ') and '\n' not in text


@pytest.mark.parametrize('data', [b'\xff\xfe\x00', b'x' * 400_000])
def test_files_that_are_no_calibration_are_refused(tmp_path, data):
    path = tmp_path / 'c.yaml'
    path.write_bytes(data)
    with pytest.raises(ConfigError, match=r'c\.yaml'):
        calibration_file.load(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match='cannot be read'):
        calibration_file.load(tmp_path / 'none.yaml')


finite = st.floats(allow_nan=False, allow_infinity=False, width=64)


@given(npst.arrays(float, (6,), elements=finite), st.floats(1e-300, 1e300))
def test_numbers_survive_to_the_last_digit(bias, mass):
    c = Calibration(mass=Estimate(mass, math.nan, 'kg'), com=Estimate(bias[:3], 0, 'm'),
                    wrench_bias=Estimate(bias, np.abs(bias), 'N, N m'))
    back = calibration_file.parse(calibration_file.dump(c))
    assert float(back.mass) == mass
    np.testing.assert_array_equal(back.wrench_bias.value, bias)
    np.testing.assert_array_equal(back.wrench_bias.std, np.abs(bias))


def test_the_direction_of_gravity_is_kept_and_absent_where_it_is_down():
    c = whole_calibration()
    assert 'gravity_direction' not in yaml.safe_load(calibration_file.dump(c))
    on_wall = replace(c, gravity_direction=(0.0, 0.6, -0.8))
    assert_same(calibration_file.parse(calibration_file.dump(on_wall)), on_wall)
    document = calibration_file.to_document(on_wall) | {'gravity_direction': [0.0, 0.6, -0.7]}
    with pytest.raises(ConfigError, match='gravity_direction.*unit vector'):
        calibration_file.from_document(document, 'c.yaml')
