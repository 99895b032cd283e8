"""Motion safety over DDS: the sequencer as a process, the robot and its faults played here."""

import re
import signal
import time

from forcecal_ros.motion.limits import Limits
from forcecal_ros.nodes.runtime import OUTPUT
from geometry_msgs.msg import PoseStamped
from live import Live, Robot
from longer import first
from nav_msgs.msg import Path
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

LIMITS = Limits()


@pytest.fixture(scope='module')
def bench(ros_domain_of_module):
    """One sequencer for all tests of this module that leave it alive, and a robot for it."""
    with Live() as live:
        robot = Robot(live)
        start(live)
        yield live, robot


def start(live, name='sequencer', remap=(), **parameters):
    live.start('sequencer', name, remap, timing__measure=0.3, timing__ring=0.2,
               settle__window=0.1, **parameters)


@pytest.fixture
def ready(bench):
    """Sequencer idle, robot healthy and known to it for long enough to start."""
    live, robot = bench
    robot.silent.clear()
    robot.override.clear()
    robot.commands.clear()
    live.phases.clear()
    live.reasons.clear()
    return live, robot


def begin(live):
    """Start, again and again until the sequencer has heard enough."""
    answers = []

    def started():
        answers.append(live.call('sequencer/start'))
        return answers[-1].success

    live.until(started, 'start')
    return answers


def until_moving(live, robot):
    """Start, and again where this machine is so busy that it ended the motion by itself."""
    begin(live)

    def moving():
        if not robot.moving() and live.phases and live.phases[-1] == 'aborted':
            live.phases.clear()
            live.reasons.clear()
            begin(live)
        return robot.moving()

    live.until(moving, 'motion')


def assert_came_to_rest(live, robot, since_ns=None, sensors=False):
    """
    From then on commands moved for a tenth of a second at most, and never again.

    Time is counted in commands, on the stream's own stamps: a machine that lets the sequencer
    wait commands nothing meanwhile. Sensors that this process says late are no fault of it.
    """
    live.until(lambda: live.phases and live.phases[-1] == 'aborted', 'aborted')
    live.spin(0.15)
    since_ns = since_ns or live.entered['aborted']
    stamps, speed, spin = robot.speeds()
    moving = ((speed > 0) | (spin > 0))[stamps > since_ns * 1e-9]
    slack = robot.late(since_ns) if sensors else 0.0
    assert moving.sum() * 0.004 <= 0.1 + slack
    assert not moving[-10:].any()
    assert np.count_nonzero(np.diff(moving.astype(int)) == 1) == 0
    heard = len(robot.commands)
    live.spin(0.3)
    assert len(robot.commands) == heard
    assert_no_jump(robot)


def assert_no_jump(robot):
    stamps, speed, spin = robot.speeds()
    assert speed.max() <= LIMITS.speed and spin.max() <= LIMITS.angular_speed
    regular = np.isclose(np.diff(stamps), 0.004)
    assert (np.abs(np.diff(spin))[regular] / 0.004 <= LIMITS.angular_acceleration).all()


def now(live):
    return live.node.get_clock().now().nanoseconds


def test_nothing_is_commanded_before_start(ready):
    live, robot = ready
    live.until(lambda: live.phases == ['idle'], 'the first word')
    live.until(lambda: live.call('sequencer/preview').success, 'a preview')
    assert not live.call('sequencer/abort').success
    assert not live.call('sequencer/save_calibration').success
    for sequence in ('contact', 'calibrate'):
        assert live.set('sequencer', sequence=sequence)[0].successful
    robot.silent.add('wrench')  # for longer than a pause, and back again
    live.spin(0.5)
    robot.silent.clear()
    live.spin(0.5)
    assert not robot.commands
    assert live.phases == ['idle']


def test_abort_brings_the_commands_to_rest_within_a_tenth_of_a_second(ready):
    live, robot = ready
    until_moving(live, robot)
    assert np.linalg.norm(np.subtract(robot.commands[0][1][:3], [1.0, 0.0, 1.0])) < 2e-5
    again = live.call('sequencer/start')
    assert not again.success and 'under way already' in again.message
    assert 'a motion is under way (move' in live.call('sequencer/save_calibration').message
    assert robot.moving()
    assert live.call('sequencer/abort').success
    assert_came_to_rest(live, robot)
    assert live.reasons[-1] == 'requested by sequencer/abort'  # an earlier state may be said again
    assert not live.call('sequencer/abort').success


@pytest.mark.parametrize('topic', list(Robot.TOPICS))
def test_a_lost_sensor_brings_the_commands_to_rest_and_is_named(ready, topic):
    live, robot = ready
    until_moving(live, robot)
    robot.silent.add(topic)
    assert_came_to_rest(live, robot, robot.healthy, sensors=True)
    assert live.reasons[-1].startswith(f'{topic}: silent')


@pytest.mark.parametrize('topic, values, reason', [
    ('wrench', (0.0, 0.0, 300.0, 0.0, 0.0, 0.0), 'limits.force 250 N'),
    ('accelerometer/raw', (np.inf, 0.0, 0.0), 'accelerometer/raw: a reading is not finite')])
def test_a_sensor_that_says_something_else_is_named(ready, topic, values, reason):
    live, robot = ready
    until_moving(live, robot)
    robot.override[topic] = values
    assert_came_to_rest(live, robot, robot.healthy, sensors=True)
    assert reason in live.reasons[-1]


def test_a_sensor_that_comes_back_lets_the_motion_go_on(ready):
    live, robot = ready
    until_moving(live, robot)
    robot.silent.add('wrench')
    live.until(lambda: not robot.speeds(-3)[2].any(), 'rest')
    robot.silent.clear()
    live.until(robot.moving, 'motion again')
    assert live.phases[-1] == 'move'
    live.call('sequencer/abort')
    assert_came_to_rest(live, robot)


def test_someone_else_commanding_ends_the_motion(ready):
    live, robot = ready
    until_moving(live, robot)
    other = live.node.create_publisher(PoseStamped, 'target_frame', OUTPUT)
    own = len(robot.commands)
    # said again until the two have discovered each other
    live.until(lambda: other.publish(PoseStamped()) or live.phases[-1] == 'aborted', 'aborted')
    assert 'target_frame: another node commands the robot' in live.reasons[-1]
    assert len(robot.commands) > own
    assert_came_to_rest(live, robot)
    live.node.destroy_publisher(other)


def test_a_start_is_refused_with_the_topic_that_is_missing(ready):
    live, robot = ready
    begin(live)
    live.call('sequencer/abort')
    robot.silent.add('current_pose')
    live.until(lambda: 'current_pose: silent' in live.call('sequencer/start').message, 'refusal')


def test_limits_are_checked_on_the_plan_and_refused_with_the_number(ready):
    live, robot = ready
    assert live.set('sequencer', limits__speed=0.15)[0].successful
    try:
        live.until(lambda: 'limits.speed is 0.15' in live.call('sequencer/start').message,
                   'refusal')
    finally:
        live.set('sequencer', limits__speed=0.25)
    assert not robot.commands


def test_a_preview_shows_the_path_and_a_start_may_require_it(ready):
    live, robot = ready
    paths = live.latched(Path, 'sequencer/planned_path')
    drawn = live.latched(MarkerArray, 'sequencer/markers')
    assert live.set('sequencer', motion__require_preview=True)[0].successful
    try:
        live.until(lambda: 'check sequencer/planned_path' in live.call(
            'sequencer/start').message, 'refusal')
        shown = []

        def previewed():
            shown.append(live.call('sequencer/preview'))
            return shown[-1].success

        live.until(previewed, 'a robot at rest')
        assert re.match(
            r'calibrate: 7 moves in .* at most 0.18[78] m/s and 1.45 rad/s; ft_sensor stays '
            r'within 1.000 -?0.000 1.000 to 1.010 0.000 1.000 m, the tip within ',
            shown[-1].message)
        live.until(lambda: paths, 'the path')
        places = np.array([[getattr(pose.pose.position, axis) for axis in 'xyz']
                           for pose in paths[-1].poses])
        assert paths[-1].header.frame_id == 'base' and len(places) > 100
        live.until(lambda: drawn, 'the box and the path')
        assert [(marker.ns, len(marker.points), marker.header.frame_id)
                for marker in drawn[-1].markers] == [
            ('workspace', 24, 'base'), ('planned path', len(places), 'base')]
        assert not (robot.commands or live.phases[-1:] not in ([], ['idle'], ['aborted']))
        live.set('sequencer', pace__speed=0.1)
        live.until(lambda: live.call('sequencer/start').message.startswith(
            'pace.speed changed since the preview'), 'refusal of what was not shown')
        assert not robot.commands
        live.set('sequencer', pace__speed=0.2)
        robot.pose = (*np.add(robot.pose[:3], [0.0, 0.002, 0.0]), *robot.pose[3:])
        live.spin(0.5)  # until the sequencer has heard of it
        live.until(lambda: 'the robot has moved by 0.002 m since the preview' in live.call(
            'sequencer/start').message, 'refusal')
        live.until(lambda: live.call('sequencer/preview').success
                   and live.call('sequencer/start').success, 'start of what was shown')
        live.until(robot.moving, 'motion')
        live.call('sequencer/abort')
        live.until(lambda: live.phases[-1] == 'aborted', 'the end')
    finally:
        live.set('sequencer', motion__require_preview=False, pace__speed=0.2)


@pytest.mark.parametrize('change, reason', [
    ({'limits__speed': 1.0}, 'stops within limits.stop_duration'),
    ({'poses__values': [1.0, 2.0]}, 'got 2 numbers'),
    ({'limits__tip': [0.0, 0.0, float('nan')]}, 'limits.tip is [0.0, 0.0, nan], expected'),
])
def test_a_setting_that_makes_no_sense_is_refused_with_a_reason(ready, change, reason):
    live, _ = ready
    (answer,) = live.set('sequencer', **change)
    assert not answer.successful and reason in answer.reason


@pytest.mark.parametrize('signals', [
    (signal.SIGINT, signal.SIGINT), pytest.param((signal.SIGTERM,), marks=pytest.mark.long)])
def test_a_sequencer_that_is_told_to_go_stops_the_robot_first(ros_domain, signals):
    with Live() as live:
        robot = Robot(live)
        start(live)
        until_moving(live, robot)
        asked = now(live)
        for number in signals[:-1]:
            live.processes['sequencer'].send_signal(number)
            time.sleep(0.01)  # signals that wait together count as one
        assert live.end('sequencer', signals[-1]) == 0
        assert_came_to_rest(live, robot, asked)
        assert live.reasons == ['the sequencer node received a signal to end']


@pytest.mark.parametrize('executor, where', first([
    ('single', 'subscription'), ('events', 'timer')]))
def test_a_sequencer_that_fails_stops_the_robot_first(ros_domain, executor, where):
    with Live() as live:
        robot = Robot(live)
        live.run('defective_sequencer', 'sequencer', ['-p', f'executor:={executor}'])
        broken = live.node.create_publisher(Header, 'break', OUTPUT)
        until_moving(live, robot)
        process = live.processes.pop('sequencer')
        broken.publish(Header(frame_id=where))
        live.until(lambda: process.poll() is not None, 'its end')
        assert_came_to_rest(live, robot)
        assert process.returncode == 1
        assert live.reasons == ['the sequencer node terminates after an error']
        assert 'RuntimeError: a mistake' in live.said('sequencer')


class Time:
    """A /clock of the test's own, on a grid of 4 ms, that can stop and jump."""

    def __init__(self, live):
        self.live = live
        self.offset = 10**9 - now(live)
        self.stopped_at = None
        self.publisher = live.node.create_publisher(Clock, '/clock', OUTPUT)
        self.timer = live.node.create_timer(0.004, self.tick)

    def now(self):
        return self.stopped_at or now(self.live) + self.offset

    def tick(self):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(self.now(), 10**9)
        self.publisher.publish(message)


def test_a_clock_that_stops_or_jumps_ends_the_motion(ros_domain):
    with Live() as live:
        clock = Time(live)
        clock.timer.cancel()
        robot = Robot(live, now=clock.now)
        start(live, use_sim_time='true')
        live.until(lambda: '/clock: nothing received' in live.call('sequencer/start').message,
                   'refusal')
        clock.timer.reset()
        until_moving(live, robot)
        clock.stopped_at = clock.now()
        stopped = clock.stopped_at
        assert_came_to_rest(live, robot, stopped)
        assert live.reasons[-1] == '/clock has stopped'

        clock.stopped_at = None
        robot.commands.clear()
        until_moving(live, robot)
        clock.offset -= 500_000_000
        live.until(lambda: live.phases[-1] == 'aborted', 'aborted')
        assert live.reasons[-1].startswith(
            ('/clock jumped by -', 'current_pose: the same reading'))
        count = len(robot.commands)
        live.spin(0.5)
        assert len(robot.commands) - count < 30


def test_a_dead_man_switch_let_go_ends_the_motion(ros_domain):
    with Live() as live:
        robot = Robot(live)
        start(live, motion__deadman_timeout=0.2)
        live.until(lambda: 'deadman: nothing received' in live.call('sequencer/start').message,
                   'refusal')
        deadman = live.node.create_publisher(Header, 'deadman', OUTPUT)
        pressed = live.node.create_timer(0.02, lambda: deadman.publish(Header()))
        until_moving(live, robot)
        live.node.destroy_timer(pressed)
        assert_came_to_rest(live, robot)
        assert live.reasons[-1].startswith('deadman: silent for 0.2')
        assert live.end('sequencer', signal.SIGTERM) == 0


def test_commands_are_in_the_frame_of_the_poses_and_refused_in_another(ros_domain):
    with Live() as live:
        robot = Robot(live, frame='base_link')
        frames = []
        live.node.create_subscription(
            PoseStamped, 'target_frame', lambda message: frames.append(message.header.frame_id),
            OUTPUT)
        start(live)
        start(live, 'other', ['__node:=other'], motion__frame='base')
        live.until(lambda: "current_pose is in 'base_link', but motion.frame is 'base'"
                   in live.call('other/start').message, 'refusal')
        assert live.end('other', signal.SIGTERM) == 0
        live.spin(0.3)
        assert not robot.commands and set(live.phases) <= {'idle'}
        until_moving(live, robot)
        live.call('sequencer/abort')
        assert_came_to_rest(live, robot)
        assert set(frames) == {'base_link'}
