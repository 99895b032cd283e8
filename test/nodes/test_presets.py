"""Presets: their names and values are those of the nodes, and they lead what they are for."""

from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

from drivers import FrameTransforms, gantry, joints_at, Servo, states
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.topics import CONTROLLERS, preset_file, read_preset, ROBOTS, topic_of
from forcecal_ros.io.calibration_file import save
from forcecal_ros.nodes.config import TABLES
from forcecal_ros.nodes.impedance import settings_of as impedance_settings
from forcecal_ros.nodes.observer import settings_of as observer_settings
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.sequencer import settings_of as sequencer_settings
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live, Robot
import numpy as np
from observing import calibration
import pytest
from rclpy.qos import qos_profile_sensor_data, qos_profile_system_default
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'how-to' / 'robots.md'
CHECKS = {'sequencer': sequencer_settings, 'observer': observer_settings,
          'impedance': impedance_settings}
ARGUMENTS = {'wrench', 'current_pose', 'target_frame', 'joint_states', 'joint_trajectory',
             'delta_twist_cmds', 'contact_wrench'}


def test_there_is_no_file_that_is_not_offered():
    files = {path.stem for path in preset_file('ur').parent.iterdir()}
    assert files == {*ROBOTS, *CONTROLLERS}


@pytest.mark.parametrize('name', [*ROBOTS, *CONTROLLERS])
def test_a_preset_fits_the_nodes_and_the_page_shows_its_topics(name):
    preset = dict(read_preset(name))
    topics, page = preset.pop('topics'), PAGE.read_text()
    assert set(topics) <= ARGUMENTS
    assert f'`{name}`' in page and all(topic in page for topic in topics.values())
    for node, parameters in preset.items():
        rows = {row.name: row for row in TABLES[node][0]}
        assert set(parameters) <= set(rows)
        for key, value in parameters.items():
            assert type(value) is type(rows[key].default), key
            if rows[key].choices or isinstance(value, float):
                rows[key].row.take(type(rows[key].default), value, key)
        values = {key: row.default for key, row in rows.items()} | parameters
        if values.get('motion.backend') == 'joint_trajectory':
            with pytest.raises(ConfigError, match=r'numbers in joints\.values'):
                CHECKS[node](values)
            values |= {'joints.names': ['a'], 'joints.values': [0.1, 0.2, 0.3, 0.4],
                       'joints.away': [0.0]}
        CHECKS[node](values)


def test_robots_ask_for_a_preview_and_the_controller_counts_before_the_robot():
    for robot in ROBOTS:
        cautious = read_preset(robot)['sequencer']
        assert cautious['motion.require_preview'] and not any(cautious['limits.tip'])
        assert cautious['limits.force'] <= 60.0 and cautious['limits.speed'] <= 0.1
    both = ('ur', 'cartesian_controllers')
    assert topic_of('current_pose', 'x', *both) == '/cartesian_motion_controller/current_pose'
    assert topic_of('current_pose', 'x', 'ur', '') == '/tcp_pose_broadcaster/pose'
    assert topic_of('wrench', 'x', *both) == '/force_torque_sensor_broadcaster/wrench'
    assert topic_of('optidrive', 'x', *both) == 'x'
    assert topic_of('joint_trajectory', 'x', 'kuka_fri', 'joint_trajectory_controller') == (
        '/lbr/joint_trajectory_controller/joint_trajectory')
    assert topic_of('joint_trajectory', 'x', 'ur', 'admittance_controller') == (
        '/joint_trajectory_controller/joint_trajectory')


QUICK = {'watch__pause_timeout': 2.0, 'watch__lost_timeout': 5.0, 'timing__measure': 0.2,
         'timing__ring': 0.2, 'settle__window': 0.1, 'pace__angular_speed': 0.4,
         'limits__force': 250.0}
"""A cell of one's own, of a machine that may be busy."""

JOINTS = [f'joint_{i}' for i in range(1, 7)]


class Driven:
    """
    What moves a robot by the presets, and what its drivers say meanwhile.

    Attributes
    ----------
    moving : list of bool
        Of every command that was heard.
    """

    def __init__(self, live, topics, settings, period, qos):
        self.live, self.moving, self._last = live, [], None
        self.robot = Robot(live, commands=False, names=topics, qos=qos, period=period)
        self.robot.silent.add('accelerometer/raw')
        self._base = settings['pose.base']
        self._names = settings['joints.names']
        self._states = live.node.create_publisher(
            JointState, topics.get('joint_states', 'joint_states'), qos_profile_system_default)
        self.positions = [0.1] * len(self._names)
        if self._base:
            self.robot.silent.add('current_pose')
            self._transforms = FrameTransforms(live, self._base, settings['pose.frame']) if (
                find_spec('tf2_msgs')) else None
        live.node.create_timer(period, self._say)
        {'target_frame': self._follow_poses, 'joint_trajectory': self._follow_joints,
         'delta_twist_cmds': self._follow_twists}[settings['motion.backend']](
            topics[settings['motion.backend']])

    def stopped_in_motion(self):
        """Start, abort in the midst of a move; return how many commands came before the answer."""
        live, calls = self.live, ('sequencer/preview', 'sequencer/start')

        def moving():
            if live.phases[-1:] in ([], ['idle'], ['aborted']):  # or too busy to go on
                live.phases.clear()
                live.until(lambda: all(live.call(name).success for name in calls), 'start')
            return len(self.moving) > 5 and all(self.moving[-5:])

        live.until(moving, 'motion')
        assert live.call('sequencer/abort').success
        asked = len(self.moving)
        live.until(lambda: live.phases[-1] == 'aborted' and not any(self.moving[-5:]), 'rest')
        live.spin(0.3)
        return asked

    def _say(self):
        now, pose = self.robot.now(), self.robot.pose
        self._states.publish(states(now, self.positions, self._names))
        if not self._base:
            return
        pose = (*(pose[:3] + self.robot.rng.normal(0.0, 2e-5, 3)), *pose[3:])
        if self._transforms is None:
            self._states.publish(states(now, joints_at(pose)))
        else:
            self._transforms.say(now, pose)

    def _follow_poses(self, topic):
        def take(stamp, pose):
            self.moving.append(self._last not in (None, pose))
            self._last = self.robot.pose = pose
        self.live.hear(PoseStamped, topic, take)

    def _follow_twists(self, topic):
        servo = Servo(self.live, self.robot, topic)
        self.live.hear(servo.message_type, topic,
                       lambda stamp, twist: self.moving.append(any(twist)))

    def _follow_joints(self, topic):
        def take(message):  # what joint_trajectory_controller takes, and nothing else
            first, last = message.points
            assert list(message.joint_names) == list(self._names) and not any(last.velocities)
            self.positions = list(first.positions)
            self.moving.append(any(first.velocities))
        self.live.node.create_subscription(JointTrajectory, topic, take, 2000)


def cell(robot, controller, folder):
    """Return parameter files and settings of the presets, topics, and what one's own cell adds."""
    files = [preset_file(name) for name in (robot, controller) if name]
    settings = {row.name: row.default for row in TABLES['sequencer'][0]}
    for file in files:
        settings |= read_preset(file.stem)['sequencer']
    usual = {name: name for name in ARGUMENTS} | {'contact_wrench': 'observer/contact_wrench'}
    topics = {name: topic_of(argument, name, robot, controller)
              for argument, name in usual.items()}
    own: dict[str, Any] = dict(QUICK)
    poses = {}
    if settings['motion.backend'] == 'joint_trajectory':
        if settings['joints.names'] == ['']:
            settings['joints.names'] = JOINTS
            own['joints__names'] = f'[{", ".join(JOINTS)}]'
        home = np.full(len(settings['joints.names']), 0.1)
        own |= {'poses__names': '[v, tilted]', 'joints__away': home.tolist(),
                'poses__values': [1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0] * 2,
                'joints__values': [*home.tolist(), *(home + 0.4).tolist()]}
    if settings['pose.base'] and not find_spec('tf2_msgs'):
        urdf = gantry(settings['pose.base'], settings['pose.frame'])
        (folder / 'robot.urdf').write_text(urdf)
        poses['pose__urdf'] = str(folder / 'robot.urdf')
    return files, settings, topics, own, poses


@pytest.mark.parametrize('robot, controller, rate, qos', [
    ('kuka_fri', '', 100, qos_profile_system_default),
    pytest.param('ur', 'moveit_servo', 500, qos_profile_system_default, marks=pytest.mark.long),
    pytest.param('franka', 'cartesian_controllers', 1000, qos_profile_sensor_data,
                 marks=pytest.mark.long)])
def test_presets_lead_a_robot_on_the_topics_of_its_drivers_and_stop_it(
        ros_domain, tmp_path, robot, controller, rate, qos):
    files, settings, topics, own, poses = cell(robot, controller, tmp_path)
    save(calibration(), tmp_path / 'c.yaml')
    remap, contact = [f'{name}:={topic}' for name, topic in topics.items()], []
    with Live() as live:
        driven = Driven(live, topics, settings, 1.0 / rate, qos)
        live.node.create_subscription(
            WrenchStamped, topics['observer/contact_wrench'], contact.append, OUTPUT)
        live.start('sequencer', remap=remap, files=files, **own, **poses)
        live.start('observer', remap=remap, files=files, calibration__file=tmp_path / 'c.yaml',
                   **poses)
        live.until(lambda: 'no preview' in live.call('sequencer/start').message, 'refusal')
        live.until(lambda: live.call('sequencer/preview').success, 'a robot at rest')
        live.until(lambda: len(contact) > 20, 'contact wrenches')
        assert not driven.moving  # nothing is commanded before a start
        asked = driven.stopped_in_motion()
    after = driven.moving[asked:]
    assert sum(after) / settings['motion.rate'] <= 0.1
    assert not any(after[-5:]) and (False, True) not in pairwise(after)
