"""An arm whose base is not level: the observer says what it says on a level one."""

from dataclasses import replace

from forcecal_ros.core.axes import level_from_base, levelled
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.observe import design, ObserverSettings, replay
from forcecal_ros.observe.live import LiveObserver
from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
from observing import answers_of, calibration, record, Swing
import pytest

TILT = rotation_from_vector([1.2, -0.4, 0.7])
DOWN = tuple(TILT @ [0.0, 0.0, -1.0])
TURNED = (0.2, -0.3, 0.6)


@pytest.fixture(scope='module')
def level():
    return record(3.0, Swing(place=(0.012, 0.004, 0.006), turn=0.2, axis=(0.3, 1.0, 0.2)))


@pytest.fixture(scope='module')
def tilted(level):
    pose = level.pose
    return replace(level, pose=replace(pose, position=pose.position @ TILT.T,
                                       R_base_sensor=TILT @ pose.R_base_sensor))


@pytest.mark.parametrize('filter_', ['kalman', 'static'])
def test_a_replay_is_that_on_a_level_base(level, tilted, filter_):
    c, settings = calibration(), ObserverSettings(filter=filter_)
    wanted = replay(level, c, settings).contact
    on_wall = replay(tilted, replace(c, gravity_direction=DOWN), settings).contact
    np.testing.assert_allclose(on_wall, wanted, atol=1e-6)
    assert np.abs(replay(tilted, c, settings).contact - wanted).max() > 1.0


@pytest.fixture(scope='module')
def turned(tilted):
    """Return the same from a sensor that is turned on its flange, too."""
    R = np.kron(np.eye(2), rotation_from_vector(TURNED))
    return replace(tilted, wrench=replace(tilted.wrench, values=tilted.wrench.values @ R))


def test_a_replay_of_a_turned_sensor_is_that_of_one_that_is_not(level, turned):
    c = replace(calibration(), gravity_direction=DOWN, sensor_rotation=TURNED)
    np.testing.assert_allclose(replay(turned, c).contact, replay(level, calibration()).contact,
                               atol=1e-6)


@pytest.mark.parametrize('rotation', [pytest.param(None, marks=pytest.mark.long), TURNED])
def test_the_live_observer_says_the_same_as_the_replay(tilted, turned, rotation):
    c = replace(calibration(), gravity_direction=DOWN, sensor_rotation=rotation)
    live = LiveObserver(1.0, 0.0)
    live.take_over(design(c), c.wrench_sign, c.gravity_direction, c.sensor_rotation)
    tilted = tilted if rotation is None else turned
    found = answers_of(live, tilted)
    estimate = replay(tilted, c)
    replayed = dict(zip(estimate.t.tolist(), estimate.contact))
    assert len(found) > 0.9 * len(replayed)
    np.testing.assert_allclose([one.contact for one in found], [replayed[one.t] for one in found],
                               atol=1e-6)


@example((0.0, 0.0, 5.0))
@given(st.tuples(*[st.floats(-5.0, 5.0)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_a_base_is_turned_until_gravity_points_down(direction):
    R = level_from_base(direction)
    down = np.array(direction) / np.linalg.norm(direction)
    R = np.eye(3) if R is None else R
    np.testing.assert_allclose(R @ down, [0.0, 0.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0


def test_a_level_base_is_left_alone(level):
    assert levelled(level, None) is level
    assert levelled(level, (0.0, 0.0, -2.0)) is level
