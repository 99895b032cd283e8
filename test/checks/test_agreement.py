"""A calibration of other axes, another unit or another tool than a recording's is told."""

from dataclasses import replace
import re

from changed import with_values
from forcecal_ros.checks.gravity import refuse_disagreeing
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from longer import first
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from whole_calibration import whole_calibration

T = np.arange(0.0, 60.0, 0.02)
G = 9.80665
C = replace(whole_calibration(), gravity=G, gravity_direction=None, sensor_rotation=None,
            wrench_sign=1)
C = replace(C, accelerometer=replace(C.accelerometer, coupling='dc', cutoff=None))


def recorded(mass=float(C.mass), bias=0.0, contact=0.0, seed=0, accelerometer=None):
    """Return a minute of reorientations with a push every six seconds."""
    rng = np.random.default_rng(seed)
    ways = rng.standard_normal((21, 3)).repeat(2, axis=0)
    times = np.sort(np.concatenate([3.0 * np.arange(21) - 0.8, 3.0 * np.arange(21) + 0.8]))
    R = rotation_from_vector(np.stack([np.interp(T, times, way) for way in ways.T], axis=1))
    force = -mass * G * R[:, 2] + C.wrench_bias.value[:3] + bias
    force += 0.3 * rng.standard_normal((len(T), 3))
    force[T % 6.0 < 1.5] += contact
    pose = PoseStream(T, np.zeros((len(T), 3)), R)
    specific = None
    if accelerometer is not None:
        a = C.accelerometer
        specific = Stream(T, (a.offset.value + G * R[:, 2] @ a.matrix.T) @ accelerometer)
    torque = np.cross(C.com.value, -mass * G * R[:, 2]) + C.wrench_bias.value[3:]
    torque += 0.03 * rng.standard_normal((len(T), 3))
    return Recording(wrench=Stream(T, np.hstack([force, torque])), pose=pose,
                     accelerometer=specific, accelerometer_unit=C.accelerometer.unit)


@pytest.mark.parametrize('seed', first(range(3)))
@pytest.mark.parametrize('contact', [0.0, np.array([30.0, -20.0, 60.0])])
def test_the_tool_that_was_calibrated_passes_with_or_without_pushes(contact, seed):
    assert refuse_disagreeing(recorded(contact=contact, seed=seed, accelerometer=np.eye(3)),
                              C) == ()


def test_a_push_all_along_or_a_sensor_that_hardly_turns_says_nothing():
    always = recorded()
    wander = 20.0 * np.sin(T / 3.0)[:, None] * [1.0, 0.5, -1.0]
    pushed = with_values(always, lambda w: w + np.hstack([wander, wander]))
    assert refuse_disagreeing(pushed, C) == ()
    still = replace(always, pose=replace(always.pose, R_base_sensor=np.broadcast_to(
        np.eye(3), (len(T), 3, 3))))
    assert refuse_disagreeing(still, C) == ()


def leaning(seed):
    """Return a recording in which gravity turns in a plane, and little."""
    whole = recorded(seed=seed)
    tilt = 0.25 * np.sin(T / 2.0)[:, None] * [1.0, 0.0, 0.0]
    tilt += 0.2 * np.sin(T / 3.1)[:, None] * [0.0, 1.0, 0.0]
    R = rotation_from_vector(tilt)
    force = -float(C.mass) * G * R[:, 2]
    noise = np.random.default_rng(seed).standard_normal((len(T), 6)) * np.repeat([0.3, 0.03], 3)
    values = np.hstack([force, np.cross(C.com.value, force)]) + C.wrench_bias.value + noise
    return replace(whole, wrench=Stream(T, values), pose=replace(whole.pose, R_base_sensor=R))


@pytest.mark.parametrize('make, said', [
    (recorded, r'\+10 % from force\.z to force\.x'),
    (leaning, r'-6(\.\d)? % from force\.x to force\.y')])  # as z is all but constant
def test_crosstalk_of_a_calibrated_sensor_is_noted_with_its_size_and_is_no_rotation(make, said):
    matrix = np.eye(6)
    matrix[0, 2], matrix[1, 0], matrix[3, 1] = 0.1, -0.06, 0.005
    notes = refuse_disagreeing(with_values(make(seed=1), lambda w: w @ matrix.T), C)
    assert re.search(f'wrench: it has crosstalk of {said}', notes[0]), notes
    turn = np.kron(np.eye(2), rotation_from_vector(np.radians([10.0, -25.0, 15.0])))
    with pytest.raises(DataError, match=r'axes are rotated by|axes are mirrored'):
        refuse_disagreeing(with_values(make(seed=1), lambda w: w @ turn.T), C)


@pytest.mark.parametrize('fault', [
    np.kron(np.eye(2), rotation_from_vector(np.radians([0.0, 0.0, 30.0]))),
    np.eye(6)[[1, 0, 2, 4, 3, 5]], np.eye(6)[[0, 1, 2, 4, 3, 5]],
    np.diag([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])])
def test_other_axes_are_no_crosstalk_where_gravity_turns_little_and_residuals_are_slow(fault):
    slow = gaussian_filter1d(np.random.default_rng(3).standard_normal((len(T), 6)), 100, axis=0)
    slow *= np.repeat([2.0, 0.2], 3) / slow.std(axis=0)
    with pytest.raises(DataError, match='axes'):
        refuse_disagreeing(with_values(leaning(1), lambda w: (w + slow) @ fault.T), C)


def test_another_tool_and_a_sensor_tared_since_are_said_with_their_size():
    note, = refuse_disagreeing(recorded(mass=float(C.mass) + 2.0), C)
    assert 'carries 15.00' in note and '± 0.0' in note and 'tool or payload changed' in note
    note, = refuse_disagreeing(recorded(bias=np.array([40.0, 0.0, -60.0])), C)
    assert 'bias differs by +40 ' in note and ' -60 N: ' in note


def test_a_tare_and_a_payload_half_way_are_told_with_time_and_size():
    recording = recorded(contact=5.0)
    after = T[:, None] > 31.0
    tared = np.pad(after * [40.0, 0.0, -60.0], ((0, 0), (0, 3)))
    note, = refuse_disagreeing(with_values(recording, lambda w: w + tared), C)
    assert '(a tare, ' in note and ' +40 ' in note and ' -60 N in all' in note
    assert abs(float(note.split()[1]) - 31.0) <= 1.5
    weight = np.pad(after * -3.0 * G * recording.pose.R_base_sensor[:, 2], ((0, 0), (0, 3)))
    note, = refuse_disagreeing(with_values(recording, lambda w: w + weight), C)
    assert ' kg more' in note and abs(float(note.split(' carries ')[1].split()[0]) - 3.0) < 0.1


def test_an_accelerometer_in_another_unit_or_mount_is_refused():
    for change in (np.eye(3) / G, np.diag([-1.0, -1.0, 1.0])):
        with pytest.raises(DataError, match='its unit or mounting has changed'):
            refuse_disagreeing(recorded(accelerometer=change), C)
