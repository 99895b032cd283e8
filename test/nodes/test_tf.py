"""Poses from /tf, live: the motion they lead, a stop when they stay away, a line without them."""

import subprocess
import sys

from forcecal_ros.nodes.inputs import STATIC
from forcecal_ros.nodes.runtime import OUTPUT
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from live import Live, Robot
import numpy as np
import pytest
from rclpy.time import Time
from scipy.spatial.transform import RigidTransform, Rotation
from std_msgs.msg import Header

WITHOUT = """
import sys
sys.modules['tf2_msgs'] = None
from forcecal_ros.nodes import observer
sys.exit(observer.main(['observer', '--ros-args', *sys.argv[1:]]))
"""
TF = ['-p', 'pose.base:=base', '-p', 'pose.frame:=ft_sensor']
ON_WRIST = RigidTransform.from_components(
    [0.0, 0.02, 0.11], Rotation.from_rotvec([0.3, -0.2, 1.0]))
ON_RAIL = RigidTransform.from_translation([0.0, 0.4, 0.0])


def test_a_node_that_cannot_hear_tf_says_so_in_one_line(ros_domain):
    ended = subprocess.run([sys.executable, '-c', WITHOUT, *TF], capture_output=True, text=True,
                           timeout=60, check=False)
    assert ended.returncode == 1
    assert 'apt install ros-jazzy-tf2-msgs' in ended.stderr.splitlines()[-1]
    assert 'Traceback' not in ended.stderr


class Joints:
    """What robot_state_publisher makes of a robot: a rail, a wrist, the sensor fixed to it."""

    def __init__(self, live, robot):
        messages = pytest.importorskip('tf2_msgs.msg', reason='wants ros-jazzy-tf2-msgs')
        self._message, self._robot = messages.TFMessage, robot
        self.lost = False
        robot.silent.add('current_pose')
        self._out = live.node.create_publisher(self._message, '/tf', OUTPUT)
        static = live.node.create_publisher(self._message, '/tf_static', STATIC)
        static.publish(self._message(transforms=[
            stamped(0, 'wrist', 'ft_sensor', ON_WRIST)]))
        live.node.create_timer(0.004, self._tick)

    def _tick(self):
        pose, now = self._robot.pose, self._robot.now()
        sensor = RigidTransform.from_components(pose[:3], Rotation.from_quat(pose[3:]))
        transforms = [stamped(now, 'base', 'rail', ON_RAIL)]
        if not self.lost:
            wrist = ON_RAIL.inv() * sensor * ON_WRIST.inv()
            noise = self._robot.rng.normal(0.0, 2e-5, 3)
            transforms.append(stamped(now, 'rail', 'wrist', RigidTransform.from_components(
                wrist.translation + noise, wrist.rotation)))
        self._out.publish(self._message(transforms=transforms))


def stamped(stamp, parent, child, transform):
    x, y, z = transform.translation
    a, b, c, d = transform.rotation.as_quat()
    return TransformStamped(
        header=Header(stamp=Time(nanoseconds=stamp).to_msg(), frame_id=parent),
        child_frame_id=child, transform=Transform(
            translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=a, y=b, z=c, w=d)))


def test_tf_leads_a_motion_and_ends_it_when_a_transform_stays_away(ros_domain):
    with Live() as live:
        robot = Robot(live)
        joints = Joints(live, robot)
        live.start('sequencer', pose__base='base', pose__frame='ft_sensor',
                   watch__pause_timeout=0.5, watch__lost_timeout=2.0, watch__max_age=2.0)

        def moving():
            if live.phases[-1:] in ([], ['idle'], ['aborted']):
                live.call('sequencer/start')
            return robot.moving()

        live.until(moving, 'motion')
        first = robot.commands[0][1]
        assert np.abs(np.subtract(first[:3], robot.pose[:3])).max() < 1e-4
        joints.lost = True
        live.until(lambda: live.phases[-1] == 'aborted', 'the end')
    assert live.reasons[-1].startswith('/tf (base to ft_sensor): silent')
