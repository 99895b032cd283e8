"""The other sides of the motion back ends, played as those controllers ask for it."""

from drivers import Servo
from forcecal_ros.core.geometry import (
    rotation_from_vector,
)
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.profiles import flatten_poses, nominal_poses, Pose
from forcecal_ros.nodes.runtime import OUTPUT
from live import Live, Robot
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

HOME = nominal_poses()['v']
TILTED = Pose(HOME.position, HOME.R_base_sensor @ rotation_from_vector([0.3, 0.1, 0.0]))
QUICK = {'watch__pause_timeout': 2.0, 'watch__lost_timeout': 5.0, 'timing__measure': 0.2,
         'timing__ring': 0.2, 'settle__window': 0.1,
         'poses__names': '[v, tilted]',
         'poses__values': flatten_poses({'v': HOME, 'tilted': TILTED})}


FROM_POSE = [0.03, -0.02, 0.1, 0.1, 0.7, -0.1, 0.7]
FROM_POSE[3:] = (np.array(FROM_POSE[3:]) / np.linalg.norm(FROM_POSE[3:])).tolist()
FLANGE = RigidTransform.from_components(FROM_POSE[:3], Rotation.from_quat(FROM_POSE[3:])).inv()


def flange_of(pose):
    """Return where the flange is, x y z qx qy qz qw, where the sensor has a pose."""
    flange = RigidTransform.from_components(
        pose.position, Rotation.from_matrix(pose.R_base_sensor)) * FLANGE
    return np.array([*flange.translation, *flange.rotation.as_quat()])


def run(live):
    """Run a sequence to the end of its motion; the played sensors give nothing to identify."""
    live.until(lambda: live.call('sequencer/start').success, 'start')
    live.until(lambda: live.phases[-1] in ('done', 'aborted'), 'the end')
    assert 'step' in live.phases, live.reasons
    assert live.phases[:9] in (
        ['idle', 'move', 'settle', 'measure', 'move', 'settle', 'measure', 'move', 'settle'],
        ['move', 'settle', 'measure', 'move', 'settle', 'measure', 'move', 'settle', 'step'])


def test_a_controller_of_the_flange_is_commanded_and_heard_as_such(ros_domain):
    with Live() as live:
        robot = Robot(live)
        robot.pose = start = flange_of(HOME)
        live.start('sequencer', sensor__from_pose=FROM_POSE, **QUICK)
        run(live)
    commanded = np.array([values for _, values in robot.commands])
    assert np.abs(commanded[0] - start).max() < 1e-4  # as noisy as the pose that is measured
    for pose in (HOME, TILTED):
        goal = flange_of(pose)
        same = goal * np.sign(commanded[:, 3:] @ goal[3:])[:, None] ** [0, 0, 0, 1, 1, 1, 1]
        assert np.abs(commanded - same).max(axis=1).min() < 1e-9


def test_servo_gets_fresh_velocities_that_lead_to_the_poses_and_zeros_at_the_end(ros_domain):
    with Live() as live:
        robot = Robot(live, commands=False)
        robot.pose = flange_of(HOME)
        servo = Servo(live, robot)
        live.start('sequencer', motion__backend='delta_twist_cmds', sensor__from_pose=FROM_POSE,
                   **QUICK)
        run(live)
        assert not live.node.get_publishers_info_by_topic('/target_frame')
    ages = np.array([age for _, age, _ in servo.heard])
    twists = np.array([values for *_, values in servo.heard])
    assert np.median(ages) < 0.1
    assert len(twists) > 500 and not twists[0].any()
    assert not twists[-20:].any()
    limits = Limits()
    assert np.linalg.norm(twists[:, :3], axis=1).max() < 1.5 * limits.speed
    assert np.linalg.norm(twists[:, 3:], axis=1).max() < 1.5 * limits.angular_speed
    positions, turns = (np.array(each) for each in zip(*servo.visited))
    aside = (positions + turns @ FROM_POSE[:3] - HOME.position) @ HOME.R_base_sensor[:, 1:]
    assert np.linalg.norm(aside, axis=1).max() < 2e-3  # the step is along x
    for pose in (HOME, TILTED):
        goal = Rotation.from_quat(flange_of(pose)[3:])
        off = (goal.inv() * Rotation.from_matrix(turns)).magnitude()
        assert np.degrees(off.min()) < 1.0
    np.testing.assert_allclose(robot.pose[:3], flange_of(HOME)[:3], atol=2e-3)


def test_the_trajectory_controller_gets_every_joint_and_rest_at_each_end(ros_domain):
    names = [f'joint_{i}' for i in range(1, 7)]
    home = np.array([0.0, -0.5, 0.5, 0.0, 1.0, 0.0])
    poses = [home, home + [0.1, 0.0, 0.0, 0.6, -0.3, 0.0]]
    away = home + [0.0, 0.01, 0.01, 0.0, 0.0, 0.0]
    heard, joints, stuck = [], home + 0.05, []
    with Live() as live:
        Robot(live, commands=False)
        states = live.node.create_publisher(JointState, 'joint_states', OUTPUT)

        def report():
            at = joints if not heard else home if stuck else heard[-1].points[0].positions
            states.publish(JointState(name=names[::-1], position=[*at][::-1]))

        live.node.create_timer(0.01, report)
        live.start('sequencer', motion__backend='joint_trajectory',
                   joints__names=f'[{", ".join(names)}]',
                   joints__values=np.concatenate(poses).tolist(), joints__away=away.tolist(),
                   limits__workspace_max=[1.3, 0.4, 1.4], **QUICK)
        live.until(lambda: 'no other node subscribes to /joint_trajectory; start the' in live.call(
            'sequencer/start').message, 'refusal without a controller')
        live.node.create_subscription(JointTrajectory, 'joint_trajectory', heard.append, 2000)
        run(live)
        assert not live.node.get_publishers_info_by_topic('/target_frame')
        commanded = len(heard)
        stuck.append(True)  # joints that stay behind their commands end the motion
        answers = []

        def behind():  # started again where a busy machine has ended it by itself
            if live.reasons and live.reasons[-1].startswith('joint_states: joint_'):
                return True
            if live.phases[-1] in ('done', 'aborted'):
                answers.append(live.call('sequencer/start'))
            return False

        live.until(behind, 'joints that are named')
        live.spin(0.3)
    assert live.reasons[-1].startswith('joint_states: joint_4 is 0.2')
    assert any('limits.workspace' in answer.message for answer in answers if answer.success)
    late = np.array([message.points[0].positions for message in heard[commanded:]])
    assert 0.2 < np.abs(late - home)[:, 3].max() < 0.59
    assert not any(heard[-1].points[0].velocities)
    del heard[commanded:]
    positions = np.array([message.points[0].positions for message in heard])
    np.testing.assert_allclose(positions[0], home + 0.05, atol=1e-9)
    np.testing.assert_allclose(positions[-1], home, atol=1e-9)
    for goal in (*poses, away):
        assert np.abs(positions - goal).max(axis=1).min() < 1e-9
    for message in heard:
        assert message.joint_names == names
        assert all(len(point.positions) == len(point.velocities) == 6 for point in message.points)
        assert not any(message.points[-1].velocities)
        times = [p.time_from_start.sec + p.time_from_start.nanosec * 1e-9 for p in message.points]
        assert 0 < times[0] < times[1]
    velocities = np.array([message.points[0].velocities for message in heard])
    assert np.abs(np.diff(positions, axis=0) / 0.004 - velocities[1:]).max() < 0.1
    assert np.abs(velocities).max() <= Limits().joint_speed
    assert not velocities[-20:].any()
