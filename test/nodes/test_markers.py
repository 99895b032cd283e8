"""What RViz and Foxglove are shown: markers, frames, the rig's URDF and the layout."""

from pathlib import Path
import sys
from xml.etree import ElementTree as ET

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import matrix_from_quaternion
from forcecal_ros.nodes import messages
from forcecal_ros.nodes.messages import (
    contact_markers,
    LARGEST,
    METRES_PER_NEWTON,
    plan_markers,
    transform_of,
)
from forcecal_ros.nodes.observer_outputs import SensorTransform
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest
from rclpy.time import Time
from rig_urdf import urdf
from visualization_msgs.msg import Marker

ROOT = Path(__file__).resolve().parents[2]
NOW = Time(nanoseconds=1_700_000_000_250_000_000)
WRENCH = np.array([0.0, 0.0, -20.0, 0.0, 4.0, 0.0])
"""20 N down at x = 0.2 m."""


def of(array):
    return {marker.ns: marker for marker in array.markers}


def test_an_arrow_ends_where_the_force_acts():
    shown = of(contact_markers(WRENCH, np.diag([0.01] * 3 + [1e-4] * 3), 'ft_sensor', NOW))
    arrow = shown['contact force']
    tail, tip = (np.array([p.x, p.y, p.z]) for p in arrow.points)
    np.testing.assert_allclose(tip, [0.2, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(tip - tail, METRES_PER_NEWTON * WRENCH[:3], atol=1e-12)
    assert arrow.header.frame_id == 'ft_sensor' and arrow.action == Marker.ADD
    assert arrow.header.stamp.nanosec == 250_000_000 and arrow.lifetime.nanosec > 0


def test_ellipsoids_have_the_axes_of_the_covariance():
    J = np.array([[0.04, 0.01, 0.0], [0.01, 0.02, 0.0], [0.0, 0.0, 0.01]])
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = J, 1e-4 * np.eye(3)
    ball = of(contact_markers(WRENCH, covariance, 'ft_sensor', NOW))['force uncertainty']
    q, s = ball.pose.orientation, ball.scale
    R = matrix_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
    half = np.diag([s.x, s.y, s.z]) / (2 * messages.SIGMAS * METRES_PER_NEWTON)
    np.testing.assert_allclose(R @ half @ half @ R.T, J, atol=1e-9)
    assert max(s.x, s.y, s.z) <= LARGEST


def test_a_force_within_its_noise_is_taken_away_and_an_unknown_noise_is_not_drawn():
    gone = contact_markers(0.001 * WRENCH, np.eye(6), 'ft_sensor', NOW).markers
    assert {marker.action for marker in gone} == {Marker.DELETE} and len(gone) == 3
    unknown = contact_markers(WRENCH, np.full((6, 6), np.nan), 'ft_sensor', NOW)
    assert set(of(unknown)) == {'contact force'}


def test_the_box_is_drawn_by_its_twelve_edges_with_the_path_in_it():
    path = np.array([[0.5, 0.0, 1.0], [0.6, 0.1, 1.1], [0.7, 0.0, 1.0]])
    shown = of(plan_markers([0.0, -1.0, 0.5], [1.0, 1.0, 2.1], path, 'base', NOW))
    ends = np.array([[p.x, p.y, p.z] for p in shown['workspace'].points]).reshape(12, 2, 3)
    lengths = np.abs(ends[:, 1] - ends[:, 0])
    assert ((lengths > 0).sum(axis=1) == 1).all()
    assert sorted(lengths.sum(axis=1).round(9).tolist()) == [1.0] * 4 + [1.6] * 4 + [2.0] * 4
    assert len(shown['planned path'].points) == 3
    nothing = plan_markers([0] * 3, [1] * 3, np.empty((0, 3)), 'base', NOW)
    assert {marker.action for marker in nothing.markers} == {Marker.DELETE}


def test_a_pose_becomes_the_transform_of_the_sensor():
    message = transform_of(NOW.nanoseconds, (1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8), 'base',
                           'ft_sensor')
    assert (message.header.frame_id, message.child_frame_id) == ('base', 'ft_sensor')
    assert message.transform.translation.y == 2.0 and message.transform.rotation.z == 0.6


def test_the_urdf_is_that_of_the_nominal_rig():
    text = (ROOT / 'layouts' / 'rig.urdf').read_text()
    assert text == urdf(load_rig()), 'python test/helpers/rig_urdf.py > layouts/rig.urdf'
    robot = ET.fromstring(text)
    links = {link.get('name') for link in robot.iter('link')}
    children = {joint.find('child').get('link') for joint in robot.iter('joint')}
    assert links - children == {'ft_sensor'}
    assert robot.find('.//mass').get('value') == '13'
    rigid = ET.fromstring(urdf(load_rig('rigid_tool.yaml')))
    assert rigid.find('joint').get('type') == 'fixed'


def test_without_tf2_msgs_a_transform_is_refused_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)
    with pytest.raises(ConfigError, match='apt install ros-jazzy-tf2-msgs') as error:
        SensorTransform(None, 'current_pose')
    assert '\n' not in str(error.value)
    with pytest.raises(ConfigError, match='already come from /tf'):
        SensorTransform(None, '/tf')
