"""Poses from joint states or /tf, live: wrenches, a motion, its end, a line without."""

from importlib.util import find_spec
import re

from drivers import FrameTransforms, gantry, joints_at, NAMES, states
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.io.calibration_file import save
from forcecal_ros.io.urdf import Description
from forcecal_ros.nodes.inputs import POSE_PARAMETERS, pose_source
from forcecal_ros.nodes.runtime import declare, OUTPUT
from forcecal_ros.nodes.wire import JointsReader
from forcecal_ros.observe import replay
from forcecal_ros.observe.pose_sources import JointPose
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


def test_contact_wrenches_by_joint_states_are_those_by_poses(ros_domain, tmp_path, urdf):
    path = tmp_path / 'calibration.yaml'
    save(calibration(), path)
    recording = record(1.0, seed=1, rates=(500.0, 500.0, 250.0),
                       swing=Swing(place=(0.02, 0.0, 0.01), turn=0.3))
    with Live() as live:
        player = Player(live)
        player.out['pose'] = (live.node.create_publisher(JointState, 'joint_states', OUTPUT),
                              lambda stamp, pose: states(stamp, joints_at(pose)))
        live.start('observer', calibration__file=path, pose__urdf=urdf, pose__base='base',
                   pose__frame='ft_sensor')
        player.until_heard()
        live.until(lambda: live.state() == 'active', 'active')
        stamps = player.play(recording)
        live.until(lambda: len(player.answers) >= len(stamps) - 30, 'all answers')
    found = np.array([player.answers.get(stamp, [np.nan] * 6) for stamp in stamps])
    assert np.ptp(recording.wrench.values[:, :3], axis=0).max() > 5.0
    assert np.isfinite(found).all(axis=1).mean() > 0.9
    assert np.nanmax(np.abs(found - replay(recording, calibration()).contact)) < 0.02


@pytest.mark.parametrize('name', [
    'joint_states', pytest.param('/tf', marks=pytest.mark.skipif(
        not find_spec('tf2_msgs'), reason='requires ros-jazzy-tf2-msgs'))])
def test_poses_lead_a_motion_and_end_it_when_they_stay_away(ros_domain, urdf, name):
    with Live() as live:
        robot, lost = Robot(live), []
        robot.silent.add('current_pose')
        joints = live.node.create_publisher(JointState, 'joint_states', OUTPUT)
        frames = FrameTransforms(live, 'base', 'ft_sensor') if name == '/tf' else None

        def say():
            now, pose = robot.now(), robot.pose
            pose = (*(pose[:3] + robot.rng.normal(0.0, 2e-5, 3)), *pose[3:])
            joints.publish(states(now, [0.1], ['gripper']))
            if frames and not lost:
                frames.say(now, pose)
            elif not lost:
                joints.publish(states(now, joints_at(pose)))

        live.node.create_timer(0.004, say)
        live.start('sequencer', pose__base='base', pose__frame='ft_sensor',
                   **({} if frames else {'pose__urdf': urdf}),
                   watch__pause_timeout=0.5, watch__lost_timeout=2.0, watch__max_age=2.0)

        def moving():
            if live.phases[-1:] in ([], ['idle'], ['aborted']):
                live.call('sequencer/start')
            return robot.moving()

        live.until(moving, 'motion')
        assert np.abs(np.subtract(robot.commands[0][1][:3], robot.pose[:3])).max() < 1e-4
        lost.append(True)
        live.until(lambda: live.phases[-1] == 'aborted', 'the end')
    assert live.reasons[-1].startswith(f'{name} (base to ft_sensor): silent')


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
