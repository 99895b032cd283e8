"""forcecal play in a robot's domain: no motion, no second voice, unless asked for."""

from collections import Counter
import os
import tempfile

from bag_samples import START_NS
from forcecal_ros.cli.main import main
from forcecal_ros.core.streams import PoseStream, Stream
from forcecal_ros.core.topics import Topic
from forcecal_ros.io.bags import write_signals
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live
from node_process import NodeProcess
import numpy as np
import pytest

SAMPLES = 200
DISCOVERY = '3.5'
"""DDS takes that long at worst until all know each other [s]."""
ALL = {'/wrench', '/current_pose', '/target_frame', '/observer/contact_wrench'}
QUIET = {'/wrench', '/current_pose'}


COMMANDS = {
    '/target_frame': 'geometry_msgs/msg/PoseStamped',
    '/left/target_frame': 'geometry_msgs/msg/PoseStamped',
    '/servo_node/delta_twist_cmds': 'geometry_msgs/msg/TwistStamped',
    '/arm/joint_trajectory': 'trajectory_msgs/msg/JointTrajectory',
    '/position_controller/commands': 'std_msgs/msg/Float64MultiArray',
    '/cmd_vel': 'geometry_msgs/msg/Twist'}
OUTPUTS = {
    '/observer/contact_wrench': 'geometry_msgs/msg/WrenchStamped',
    '/left/sequencer/calibration': 'std_msgs/msg/String',
    '/impedance/phase': 'diagnostic_msgs/msg/DiagnosticArray',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray'}
SENSORS = {
    '/wrench': 'geometry_msgs/msg/WrenchStamped',
    '/accelerometer/raw': 'geometry_msgs/msg/Vector3Stamped',
    '/sim/contact_wrench': 'geometry_msgs/msg/WrenchStamped',
    '/commanded_pose': 'geometry_msgs/msg/PoseStamped',
    '/joint_states': 'sensor_msgs/msg/JointState'}


def test_commands_and_outputs_are_told_from_what_sensors_say():
    topics = [Topic(*one) for group in (COMMANDS, OUTPUTS, SENSORS) for one in group.items()]
    assert {topic.name for topic in topics if topic.is_command} == {*COMMANDS}
    assert {topic.name for topic in topics if topic.is_output} == {*OUTPUTS}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('play') / 'bag'
    t = np.arange(SAMPLES) * 0.005
    wrench = Stream(t, np.ones((SAMPLES, 6)), 'ft_sensor')
    pose = PoseStream(t, np.ones((SAMPLES, 3)), np.tile(np.eye(3), (SAMPLES, 1, 1)), 'base')
    write_signals(path, {'wrench': wrench, 'pose': pose, 'target': pose,
                         'contact_wrench': wrench}, START_NS)
    return path


class Robot(Live):
    """Who listens where a robot and its observer would, with the QoS of controllers."""

    TYPES = {'/wrench': WrenchStamped, '/current_pose': PoseStamped,
             '/target_frame': PoseStamped, '/observer/contact_wrench': WrenchStamped}

    def __init__(self, topics):
        super().__init__()
        self.heard, self.players = Counter(), {}
        for topic in topics:
            self.listen(topic)

    def listen(self, topic):
        self.node.create_subscription(
            self.TYPES[topic], topic, lambda message: self.heard.update([topic]), 1000)

    def play(self, bag, *each):
        """Start ``forcecal play`` with several options at a time."""
        for options in each:
            name = ' '.join(options)
            self.output[name] = tempfile.NamedTemporaryFile()  # noqa: SIM115 - until the end
            self.players[name] = NodeProcess('forcecal_ros.cli.main', [
                'play', str(bag), '--delay', DISCOVERY, *options], self.output[name].name,
                os.environ)

    def ended(self):
        """Wait for all; return status and words of each."""
        self.until(lambda: all(one.poll() is not None for one in self.players.values()), 'the end')
        self.spin(0.3)
        return [(one.returncode, self.said(name)) for name, one in self.players.items()]


def test_a_recording_moves_no_robot_and_speaks_for_no_observer_unless_told_to(ros_domain, bag):
    with Robot(ALL) as robot:
        robot.play(bag, ['--with-commands'], [],
                   ['--with-outputs', '--only', '/observer/contact_wrench'],
                   ['--with-commands', '--namespace', 'recorded'],
                   ['--with-commands', '--only', 'target_frame', '--yes'])
        refused, plain, outputs, elsewhere, told = robot.ended()
    assert refused[0] == 1 and '--yes' in refused[1]
    assert 'nodes subscribe to /target_frame (bench' in refused[1]
    assert [status for status, _ in (plain, outputs, elsewhere, told)] == [0] * 4, plain[1]
    assert '/target_frame (commands that a robot follows: --with-commands)' in plain[1]
    assert '/observer/contact_wrench (outputs of nodes' in plain[1]
    assert f'{SAMPLES} /wrench' in plain[1] and f'{SAMPLES} /target_frame' not in plain[1]
    # a prefix leads them away from the robot
    assert f'{SAMPLES} /recorded/target_frame' in elsewhere[1]
    assert f'{SAMPLES} /target_frame' in told[1]
    # outputs and commands once: of the player that was told to
    assert robot.heard == dict.fromkeys(ALL, SAMPLES)


@pytest.mark.parametrize('options, said', [
    (['--only', 'wrenc'], ('/wrenc is not in', '(did you mean /wrench?); it has /current_pose')),
    (['--only', '/target_frame'], ('--with-commands',)),
    (['--start', '60'], ('nothing to publish from 60 s on',))])
def test_what_leaves_nothing_to_play_is_refused(ros_domain, capfd, bag, options, said):
    assert main(['play', str(bag), *options]) == 1
    err = capfd.readouterr().err
    assert all(words in err for words in said), err


def test_commands_end_when_somebody_begins_to_listen(ros_domain, bag):
    with Robot(QUIET) as robot:
        robot.play(bag, ['--with-commands', '--rate', '0.1'])
        robot.until(lambda: robot.heard['/wrench'] > 10, 'the first of it')
        robot.listen('/target_frame')
        (status, said), = robot.ended()
        assert status == 1 and 'a node has subscribed to the commands' in said
        assert robot.heard['/wrench'] < SAMPLES and robot.heard['/target_frame'] <= 1
