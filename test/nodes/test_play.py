"""forcecal play in a robot's domain: no motion, no second voice, unless asked for."""

from collections import Counter
from contextlib import suppress
import os
import pty
import subprocess
import sys
import time

from bag_samples import START_NS
from forcecal_ros.recording.bags import write_signals
from forcecal_ros.recording.streams import PoseStream, Stream
from forcecal_ros.recording.topics import Topic
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

    def play(self, bag, *options, until=lambda: False, **where):
        """Run forcecal play to its end, or until something is so, and listen meanwhile."""
        process = subprocess.Popen(
            [sys.executable, '-m', 'forcecal_ros.cli', 'play', str(bag), '--delay', DISCOVERY,
             *options],
            **{'stdin': subprocess.DEVNULL, 'stdout': subprocess.PIPE,
               'stderr': subprocess.PIPE, **where}, text=True)
        while process.poll() is None and not until():
            self.spin(0.05)
        return process

    def played(self, bag, *options):
        process = self.play(bag, *options)
        out, err = process.communicate()
        self.spin(0.3)
        return process.returncode, out, err


def test_a_recording_moves_no_robot_and_speaks_for_no_observer(ros_domain, bag):
    with Robot(ALL) as robot:
        status, out, err = robot.played(bag)
        assert status == 0, err
        assert robot.heard == dict.fromkeys(QUIET, SAMPLES)
        assert '/target_frame (commands that a robot follows: --with-commands)' in err
        assert '/observer/contact_wrench (outputs of nodes' in err and '/target_frame' not in out
        assert robot.played(bag, '--only', '/target_frame')[0] == 1
        assert robot.played(bag, '--with-outputs', '--only', '/observer/contact_wrench')[0] == 0
        assert robot.heard == {**dict.fromkeys(QUIET, SAMPLES),
                               '/observer/contact_wrench': SAMPLES}


def test_commands_are_refused_while_somebody_listens_and_nothing_else_is_said(ros_domain, bag):
    with Robot(ALL) as robot:
        for options in (['--delay', '0'], ['--only', 'target_frame']):
            status, out, err = robot.played(bag, '--with-commands', *options)
            assert status == 1 and out == '' and not robot.heard
            assert 'somebody listens on /target_frame (bench)' in err and '--yes' in err
        assert robot.played(bag, '--with-commands', '--yes')[0] == 0
        assert robot.heard == dict.fromkeys(ALL, SAMPLES)


def test_a_prefix_leads_commands_away_from_a_robot(ros_domain, bag):
    with Robot(ALL) as robot:
        status, out, _ = robot.played(bag, '--with-commands', '--prefix', 'recorded')
        assert status == 0 and f'{SAMPLES} /recorded/target_frame' in out
        assert not robot.heard


def test_commands_end_when_somebody_begins_to_listen(ros_domain, bag):
    with Robot(QUIET) as robot:
        process = robot.play(bag, '--with-commands', '--rate', '0.1',
                             until=lambda: robot.heard['/wrench'] > 10)
        robot.listen('/target_frame')
        _, err = process.communicate(timeout=30)
        robot.spin(0.3)
        assert process.returncode == 1 and 'somebody has begun to listen' in err
        assert robot.heard['/wrench'] < SAMPLES and robot.heard['/target_frame'] <= 1


@pytest.mark.parametrize('reply, heard', [('n\n', 0), ('\n', 0), ('y\n', SAMPLES)])
def test_on_a_terminal_the_question_is_asked(ros_domain, bag, reply, heard):
    ours, theirs = pty.openpty()
    os.set_blocking(ours, False)
    said = b''

    def asked():
        nonlocal said
        with suppress(OSError):
            said += os.read(ours, 4096)
        return b'[y/N]' in said

    with Robot(ALL) as robot:
        process = robot.play(bag, '--with-commands', until=asked, stdin=theirs, stderr=theirs)
        assert asked() and not robot.heard
        os.write(ours, reply.encode())
        end = time.monotonic() + 20.0
        while process.poll() is None and time.monotonic() < end:
            asked()
            robot.spin(0.05)
        robot.spin(0.3)
        assert process.returncode == (0 if heard else 1)
        assert robot.heard['/target_frame'] == heard
    process.stdout.close()
    os.close(ours)
    os.close(theirs)
