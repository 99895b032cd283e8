"""Poses from joint states or /tf, live: wrenches, a motion, its end, a line without."""

import re
import subprocess
import sys

from drivers import gantry, joints_at, NAMES, states
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.io.calibration_file import save
from forcecal_ros.io.urdf import Description
from forcecal_ros.nodes.inputs import POSE_PARAMETERS, pose_source, STATIC
from forcecal_ros.nodes.runtime import declare, OUTPUT
from forcecal_ros.nodes.wire import JointsReader
from forcecal_ros.observe.pose_sources import JointPose
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from lifecycle_msgs.srv import GetState
from live import Live, Robot
import numpy as np
from observing import calibration, record, Swing
from playing import Player
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rclpy.time import Time
from scipy.spatial.transform import RigidTransform, Rotation
from sensor_msgs.msg import JointState
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


@pytest.fixture
def urdf(tmp_path):
    (tmp_path / 'gantry.urdf').write_text(gantry())
    return str(tmp_path / 'gantry.urdf')


class BothPoses:
    """Publishes a pose on its topic and as joint states."""

    def __init__(self, live, topic):
        self._topic = topic
        self._joints = live.node.create_publisher(JointState, 'joint_states', OUTPUT)

    def get_subscription_count(self):
        return min(2 * self._topic.get_subscription_count(),
                   2 * self._joints.get_subscription_count())

    def publish(self, both):
        for publisher, message in zip((self._topic, self._joints), both):
            publisher.publish(message)


def test_contact_wrenches_are_those_of_a_topic(ros_domain, tmp_path, urdf):
    path = tmp_path / 'calibration.yaml'
    save(calibration(), path)
    recording = record(1.5, seed=1, rates=(500.0, 500.0, 250.0),
                       swing=Swing(place=(0.02, 0.0, 0.01), turn=0.3))
    with Live() as live:
        player = Player(live, ('topic', 'joints'))
        topic, write = player.out['pose']
        player.out['pose'] = (BothPoses(live, topic), lambda stamp, pose: (
            write(stamp, pose), states(stamp, joints_at(pose))))
        for name, given in (('topic', {}), ('joints', {
                'pose__urdf': urdf, 'pose__base': 'base', 'pose__frame': 'ft_sensor'})):
            live.start('observer', name, [f'__node:={name}'], calibration__file=path, **given)
        player.until_heard()
        for name in player.heard:
            live.until(lambda name=name: live.call(f'{name}/get_state', GetState)
                       .current_state.label == 'active', 'active')
        stamps = player.play(recording)
        live.until(lambda: all(len(answers) >= len(stamps) - 30
                               for answers in player.heard.values()), 'all answers')
    both = player.heard['topic'].keys() & player.heard['joints'].keys()
    by_topic, by_joints = (np.array([player.heard[name][stamp] for stamp in sorted(both)])
                           for name in ('topic', 'joints'))
    assert len(both) > 0.9 * len(stamps)
    assert np.ptp(recording.wrench.values[:, :3], axis=0).max() > 5.0
    assert np.abs(by_topic - by_joints).max() < 0.02


class States:
    """What a joint state broadcaster says of a robot, and another of its gripper."""

    def __init__(self, live, robot):
        self._robot, self.lost = robot, False
        self._out = live.node.create_publisher(JointState, 'joint_states', OUTPUT)
        live.node.create_timer(0.004, self._tick)

    def _tick(self):
        pose, now = self._robot.pose, self._robot.now()
        noise = self._robot.rng.normal(0.0, 2e-5, 3)
        self._out.publish(states(now, [0.1], ['gripper']))
        if not self.lost:
            self._out.publish(states(now, joints_at((*(pose[:3] + noise), *pose[3:]))))


class Frames:
    """What robot_state_publisher makes of a robot: a rail, a wrist, the sensor fixed to it."""

    def __init__(self, live, robot):
        messages = pytest.importorskip('tf2_msgs.msg', reason='wants ros-jazzy-tf2-msgs')
        self._message, self._robot = messages.TFMessage, robot
        self.lost = False
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


@pytest.mark.parametrize('source, name', [(States, 'joint_states'), (Frames, '/tf')])
def test_poses_lead_a_motion_and_end_it_when_they_stay_away(ros_domain, urdf, source, name):
    with Live() as live:
        robot = Robot(live)
        robot.silent.add('current_pose')
        poses = source(live, robot)
        live.start('sequencer', pose__base='base', pose__frame='ft_sensor',
                   **({'pose__urdf': urdf} if source is States else {}),
                   watch__pause_timeout=0.5, watch__lost_timeout=2.0, watch__max_age=2.0)

        def moving():
            if live.phases[-1:] in ([], ['idle'], ['aborted']):
                live.call('sequencer/start')
            return robot.moving()

        live.until(moving, 'motion')
        assert np.abs(np.subtract(robot.commands[0][1][:3], robot.pose[:3])).max() < 1e-4
        poses.lost = True
        live.until(lambda: live.phases[-1] == 'aborted', 'the end')
    assert live.reasons[-1].startswith(f'{name} (base to ft_sensor): silent')


def test_a_node_that_cannot_hear_tf_says_so_in_one_line(ros_domain):
    ended = subprocess.run([sys.executable, '-c', WITHOUT, *TF], capture_output=True, text=True,
                           timeout=60, check=False)
    assert ended.returncode == 1
    assert 'apt install ros-jazzy-tf2-msgs' in ended.stderr.splitlines()[-1]
    assert 'Traceback' not in ended.stderr


@pytest.mark.parametrize('given, why', [
    ({'urdf': 'nowhere.urdf', 'base': 'base', 'frame': 'ft_sensor'},
     'pose.urdf nowhere.urdf: cannot be read'),
    ({'urdf': gantry(), 'base': 'base'}, 'pose.frame is empty, but pose.urdf is given'),
    ({'urdf': gantry(), 'base': 'base', 'frame': 'tool0'},
     "no frame 'tool0' in the text of pose.urdf; frames are base, ft_sensor"),
    ({'urdf': gantry(), 'base': 'roll', 'frame': 'ft_sensor'},
     'no joint between roll and ft_sensor in'),
    ({'urdf': '<robot/>', 'base': 'a', 'frame': 'b'}, 'not a URDF with joints')])
def test_a_urdf_that_gives_no_pose_is_refused_in_one_line(given, why):
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('asks', context=context, parameter_overrides=[
        Parameter(f'pose.{key}', value=text) for key, text in given.items()])
    try:
        declare(node, POSE_PARAMETERS)
        with pytest.raises(ConfigError, match=re.escape(why)) as refused:
            pose_source(node)
    finally:
        node.destroy_node()
        context.try_shutdown()
    assert '\n' not in str(refused.value)


def poses_of():
    return JointPose(Description(gantry().encode(), 'gantry'), 'base', 'ft_sensor', 'pose',
                     'gantry')


def test_what_is_no_pose_says_why():
    poses = poses_of()
    read = JointsReader(poses.drivers)

    def take(*message):
        return poses.take(*read(bytes(serialize_message(states(*message)))))

    assert take(10**9, [0.1], ['gripper']) is None
    assert re.match('no position of joint pitch, roll, x, y, yaw, z', poses.why_not)
    assert take(10**9, [0.0] * 5, NAMES[:5]) is None
    assert poses.why_not == 'no position of joint roll'
    assert take(10**9, [0.0] * 5, NAMES) is None, 'fewer positions than names'
    assert take(10**9, [0.0] * 5 + [np.nan]) is None
    assert poses.why_not == 'the position of joint roll is not a finite number'
    assert take(2 * 10**9, [0.5] * 6).stamp_ns == 2 * 10**9 and not poses.why_not


def test_joints_of_two_publishers_make_a_pose_when_both_know_the_instant():
    poses, found = poses_of(), []
    for k in range(20):
        slides = [0.01 * k, 0.0, 0.0]
        for stamp, told in ((4_000_000 * k, dict(zip(NAMES, slides))),
                            (4_000_000 * k + 1_000_000, dict.fromkeys(NAMES[3:], 0.0))):
            found.append(poses.take(stamp, [told.get(name) for name in poses.drivers]))
    kept = [one for one in found if one is not None]
    assert len(kept) == len(found) - 2
    np.testing.assert_allclose([one.values[0] for one in kept],
                               [2.5e-9 * one.stamp_ns for one in kept], atol=1e-12)
