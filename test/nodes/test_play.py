"""forcecal play in a robot's domain: no motion, no second voice, unless asked for."""

from collections import Counter
import subprocess
import sys

from bag_samples import START_NS
from forcecal_ros.cli.main import main
from forcecal_ros.core.streams import PoseStream, Stream
from forcecal_ros.core.topics import Topic
from forcecal_ros.io.bags import write_signals
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live
import numpy as np
import pytest

SAMPLES = 200
DISCOVERY = '3.5'
"""DDS takes that long at worst until all know each other [s]."""
ALL = {'/wrench', '/current_pose', '/target_frame', '/observer/contact_wrench'}
QUIET = {'/wrench', '/current_pose'}


@pytest.mark.parametrize('name, type_, command, output', [
    ('/target_frame', 'geometry_msgs/msg/PoseStamped', True, False),
    ('/left/target_frame', 'geometry_msgs/msg/PoseStamped', True, False),
    ('/servo_node/delta_twist_cmds', 'geometry_msgs/msg/TwistStamped', True, False),
    ('/arm/joint_trajectory', 'trajectory_msgs/msg/JointTrajectory', True, False),
    ('/position_controller/commands', 'std_msgs/msg/Float64MultiArray', True, False),
    ('/cmd_vel', 'geometry_msgs/msg/Twist', True, False),
    ('/observer/contact_wrench', 'geometry_msgs/msg/WrenchStamped', False, True),
    ('/left/sequencer/calibration', 'std_msgs/msg/String', False, True),
    ('/impedance/phase', 'diagnostic_msgs/msg/DiagnosticArray', False, True),
    ('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', False, True),
    ('/wrench', 'geometry_msgs/msg/WrenchStamped', False, False),
    ('/accelerometer/raw', 'geometry_msgs/msg/Vector3Stamped', False, False),
    ('/sim/contact_wrench', 'geometry_msgs/msg/WrenchStamped', False, False),
    ('/commanded_pose', 'geometry_msgs/msg/PoseStamped', False, False),
    ('/joint_states', 'sensor_msgs/msg/JointState', False, False)])
def test_commands_and_outputs_are_told_from_what_sensors_say(name, type_, command, output):
    topic = Topic(name, type_)
    assert (topic.is_command, topic.is_output) == (command, output)


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
        self.heard = Counter()
        for topic in topics:
            self.listen(topic)

    def listen(self, topic):
        self.node.create_subscription(
            self.TYPES[topic], topic, lambda message: self.heard.update([topic]), 1000)

    def play(self, bag, *options, **where):
        """Start forcecal play."""
        return subprocess.Popen(
            [sys.executable, '-m', 'forcecal_ros.cli.main', 'play', str(bag),
             *([] if '--delay' in options else ['--delay', DISCOVERY]),
             *options],
            **{'stdin': subprocess.DEVNULL, 'stdout': subprocess.PIPE,
               'stderr': subprocess.PIPE, **where}, text=True)

    def played(self, bag, *each):
        """Play the bag with several options at a time; return status, stdout, stderr of each."""
        players = [self.play(bag, *options) for options in each]
        self.until(lambda: all(player.poll() is not None for player in players), 'the end')
        self.spin(0.3)
        said = [player.communicate() for player in players]
        return [(player.returncode, *both) for player, both in zip(players, said)]


def test_a_recording_moves_no_robot_and_speaks_for_no_observer_unless_told_to(
        ros_domain, capfd, bag):
    with Robot(ALL) as robot:
        assert main(['play', str(bag), '--with-commands', '--delay', '0']) == 1
        said = capfd.readouterr()
        assert said.out == '' and '--yes' in said.err
        assert 'nodes subscribe to /target_frame (bench)' in said.err
        assert not robot.heard
        plain, outputs, elsewhere, told = robot.played(
            bag, [], ['--with-outputs', '--only', '/observer/contact_wrench'],
            ['--with-commands', '--namespace', 'recorded'],
            ['--with-commands', '--only', 'target_frame', '--yes'])
    status, out, err = plain
    assert status == 0, err
    assert '/target_frame (commands that a robot follows: --with-commands)' in err
    assert '/observer/contact_wrench (outputs of nodes' in err and '/target_frame' not in out
    assert '/observer/contact_wrench' not in out
    assert outputs[0] == 0
    # a prefix leads them away from the robot
    assert elsewhere[0] == 0 and f'{SAMPLES} /recorded/target_frame' in elsewhere[1]
    assert told[0] == 0 and f'{SAMPLES} /target_frame' in told[1]
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
        process = robot.play(bag, '--with-commands', '--rate', '0.1')
        robot.until(lambda: robot.heard['/wrench'] > 10, 'the first of it')
        robot.listen('/target_frame')
        _, err = process.communicate(timeout=30)
        robot.spin(0.3)
        assert process.returncode == 1 and 'a node has subscribed to the commands' in err
        assert robot.heard['/wrench'] < SAMPLES and robot.heard['/target_frame'] <= 1
