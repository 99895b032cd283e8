"""Poses from joint states and a URDF, live: wrenches, a motion, its end, a line without."""

import re

from drivers import gantry, joints_at, NAMES, states
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.io.calibration_file import save
from forcecal_ros.io.urdf import Description
from forcecal_ros.nodes.inputs import POSE_PARAMETERS, pose_source
from forcecal_ros.nodes.runtime import declare, OUTPUT
from forcecal_ros.nodes.wire import JointsReader
from forcecal_ros.observe.pose_sources import JointPose
from lifecycle_msgs.srv import GetState
from live import Live, Robot
import numpy as np
from observing import calibration, record, Swing
from playing import Player
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState


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


def test_joint_states_lead_a_motion_and_end_it_when_they_stay_away(ros_domain, urdf):
    with Live() as live:
        robot = Robot(live)
        robot.silent.add('current_pose')
        out, lost = live.node.create_publisher(JointState, 'joint_states', OUTPUT), []

        def say():
            noise = robot.rng.normal(0.0, 2e-5, 3)
            out.publish(states(robot.now(), [0.1], ['gripper']))
            if not lost:
                pose = (*(robot.pose[:3] + noise), *robot.pose[3:])
                out.publish(states(robot.now(), joints_at(pose)))

        live.node.create_timer(0.004, say)
        live.start('sequencer', pose__base='base', pose__frame='ft_sensor', pose__urdf=urdf,
                   watch__pause_timeout=0.5, watch__lost_timeout=2.0, watch__max_age=2.0)

        def moving():
            if live.phases[-1:] in ([], ['idle'], ['aborted']):
                live.call('sequencer/start')
            return robot.moving()

        live.until(moving, 'motion')
        assert np.abs(np.subtract(robot.commands[0][1][:3], robot.pose[:3])).max() < 1e-4
        lost.append(True)
        live.until(lambda: live.phases[-1] == 'aborted', 'the end')
    assert live.reasons[-1].startswith('joint_states (base to ft_sensor): silent')


@pytest.mark.parametrize('given, why', [
    ({'urdf': 'nowhere.urdf', 'base': 'base', 'frame': 'ft_sensor'},
     'pose.urdf nowhere.urdf: cannot be read'),
    ({'urdf': gantry(), 'base': 'base'}, 'pose.frame is empty, and pose.urdf is given'),
    ({'urdf': gantry(), 'base': 'base', 'frame': 'tool0'},
     "there is no frame 'tool0' in the text of pose.urdf; frames are base, ft_sensor"),
    ({'urdf': gantry(), 'base': 'roll', 'frame': 'ft_sensor'},
     'no joint moves between roll and ft_sensor'),
    ({'urdf': '<robot/>', 'base': 'a', 'frame': 'b'}, 'it is no URDF of joints')])
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
    assert poses.why_not == 'the position of joint roll is no finite number'
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
