"""The simulated rig as a process: its topics, its time, and that live equals offline."""

from importlib import import_module
from pathlib import Path
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.geometry import quaternion_from_matrix
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.io.bags import read_recording
from forcecal_ros.motion.profiles import Move, nominal_poses, Pose, step_goal
from forcecal_ros.nodes import observer, sim
from forcecal_ros.nodes.inputs import optidrive_input
from forcecal_ros.nodes.runtime import STREAM
from forcecal_ros.nodes.sequencer import Sequencer
from forcecal_ros.nodes.wire import Writer
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
from live import Live, RIG_TIME
import numpy as np
import pytest
import rclpy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState

PERIOD = 4_000_000
LATE = 200_000_000
HOME = nominal_poses()['v']


class Listener:
    """Everything the sim says, by topic: stamp [ns] -> values."""

    def __init__(self, live):
        self.heard = {}
        for topic, kind in (('wrench', WrenchStamped), ('sim/contact_wrench', WrenchStamped),
                            ('accelerometer/raw', Vector3Stamped), ('imu/data_raw', Imu),
                            ('current_pose', PoseStamped)):
            self.heard[topic] = {}
            live.hear(kind, topic, self.heard[topic].__setitem__)
        self.heard['optidrive'] = {}
        read = optidrive_input('optidrive').read
        live.node.create_subscription(
            JointState, 'optidrive', lambda raw: self.heard['optidrive'].update([read(raw)[:2]]),
            2000, raw=True)

    def __getitem__(self, topic):
        return self.heard[topic]

    def newest(self, topic):
        return max(self.heard[topic], default=0)


class RigTime:
    """The clock that the sim publishes, and commands in its time."""

    def __init__(self, live):
        self.live, self.ticks = live, []
        live.node.create_subscription(
            Clock, '/clock', lambda m: self.ticks.append(m.clock.sec * 10**9 + m.clock.nanosec),
            10)
        self.publisher = live.node.create_publisher(PoseStamped, 'target_frame', STREAM)

    @property
    def now(self):
        return self.ticks[-1]

    def until(self, stamp):
        self.live.until(lambda: self.now >= stamp, 'time')

    def command(self, poses, frame='base', stall=None):
        """Command poses, the first late, the sim stopped for a while before one; return stamps."""
        self.live.until(lambda: self.publisher.get_subscription_count() and self.ticks, 'a sim')
        write, stamps = Writer(PoseStamped, frame), []
        began = self.now - self.now % PERIOD + PERIOD
        for i, pose in enumerate(poses):
            stamps.append(began + i * PERIOD)
            self.until(stamps[-1] + (LATE if not i else 0))
            if i == stall:
                self.live.processes['sim'].send_signal(signal.SIGSTOP)
                time.sleep(0.3)
                self.live.processes['sim'].send_signal(signal.SIGCONT)
                time.sleep(0.05)
            self.publisher.publish(write(stamps[-1], (
                *pose.position, *quaternion_from_matrix(pose.R_base_sensor))))
        return stamps


def poses_of(move):
    """Return the setpoints of a move, and HOME before it until the sim waits for commands."""
    return [HOME] * 50 + [move.at(t).pose for t in np.arange(0.0, move.duration + 0.02, 0.004)]


def test_live_says_what_offline_says_of_the_same_commands(ros_domain):
    with Live() as live:
        heard, rig = Listener(live), RigTime(live)
        live.start('sim', noise='false', imu__publish='true', latency=0.1,
                   **RIG_TIME | {'clock__wait': 2.5})
        live.until(lambda: len(heard['current_pose']) > 20, 'poses')

        rig.command(poses_of(Move(HOME, step_goal(HOME, 0.03), 0.1)), frame='tool0')
        rig.until(rig.now + 200_000_000)
        positions = np.array(list(heard['current_pose'].values()))[:, :3]
        np.testing.assert_allclose(positions - HOME.position, 0, atol=1e-12)
        assert "target_frame is in 'tool0', the robot base is 'base'" in live.said('sim')

        poses = poses_of(Move(HOME, step_goal(HOME, 0.01), 0.1))
        stamps = rig.command(poses, stall=70)
        live.until(lambda: heard.newest('wrench') > stamps[-1] + 300_000_000, 'the end')
        assert live.end('sim', signal.SIGINT) == 0

    target = PoseStream((np.array(stamps) - stamps[0]) * 1e-9,
                        np.array([pose.position for pose in poses]),
                        np.array([pose.R_base_sensor for pose in poses]))
    offline = simulate(load_rig(), target, noise=False, duration=0.45)
    for topic, t, expected in (
            ('wrench', offline.wrench.t, offline.wrench.values),
            ('accelerometer/raw', offline.accelerometer.t, offline.accelerometer.values),
            ('optidrive', offline.optidrive.t, offline.optidrive.values),
            ('sim/contact_wrench', offline.contact_truth.t, offline.contact_truth.values),
            ('current_pose', offline.pose.t, offline.pose.position)):
        keys = stamps[0] + np.round(t * 1e9).astype(np.int64)
        got = np.array([heard[topic][key] for key in keys.tolist()])
        np.testing.assert_allclose(got[:, :expected.shape[1]], expected, atol=1e-9,
                                   err_msg=topic)
    assert np.ptp(offline.wrench.values[:, 0]) > 20
    force = np.array([heard['imu/data_raw'][key] for key in keys.tolist()])
    np.testing.assert_allclose(force[0], [0, 0, -9.80665], atol=1e-6)

    for topic, period in (('wrench', 10**6), ('sim/contact_wrench', 10**6),
                          ('accelerometer/raw', 10**6), ('optidrive', 10**6),
                          ('imu/data_raw', 10**6), ('current_pose', PERIOD)):
        grid = np.array(sorted(heard[topic]))
        assert (grid % 10**6 == 0).all(), topic
        assert (np.diff(grid) == period).mean() > 0.99, topic


def test_its_own_clock_runs_at_the_speed_asked_for(ros_domain):
    """Never faster than three times the wall's, and as fast wherever the machine lets it be."""
    with Live() as live:
        clock, stamps = [], []
        live.node.create_subscription(
            Clock, '/clock',
            lambda m: clock.append((live.node.get_clock().now().nanoseconds * 1e-9,
                                    m.clock.sec + m.clock.nanosec * 1e-9)), 10)
        live.hear(PoseStamped, 'current_pose', lambda stamp, _: stamps.append(stamp))
        said = []
        live.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda m: said.append(m.status[0]), 10)
        live.start('sim', speed=3.0, rig='forcecal_ros/config/rigid_tool.yaml')

        def undisturbed():
            """Whether the last half second passed at that speed."""
            newest = [tick for tick in clock[-2000:] if tick[0] > clock[-1][0] - 0.5]
            wall, simulated = np.array(newest).T
            return len(newest) > 50 and np.ptp(wall) > 0.4 and abs(
                np.polyfit(wall, simulated, 1)[0] - 3.0) < 0.15

        live.until(lambda: clock and clock[-1][1] - clock[0][1] > 6.0 and said, '6 s')
        live.until(undisturbed, 'half a second at three times the wall')
        wall, simulated = np.array(clock).T
        assert simulated[-1] - simulated[0] < 3.0 * (wall[-1] - wall[0]) + 1.0
        assert (np.diff(simulated) >= 0).all()
        assert (stamps[-1] - stamps[0]) * 1e-9 == pytest.approx(
            simulated[-1] - simulated[0], abs=1.0)
        assert not live.node.get_publishers_info_by_topic('/optidrive')
        assert said[-1].message == 'holding' and said[-1].name == 'sim'
        assert live.end('sim', signal.SIGTERM) == 0


def test_its_own_clock_waits_for_commands_that_come_late(ros_domain):
    with Live() as live:
        rig, said = RigTime(live), []
        live.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda m: said.append(m.status[0]), 10)
        live.start('sim', clock__publish=True, clock__wait=2.0)

        def stands():
            # the pose just sent may still be on its way, and the clock then goes on once more
            before = rig.now
            live.spin(0.3)
            return rig.now == before

        def dawdling():
            for i in range(60):
                yield Pose(HOME.position + [0, 0, 1e-5 * i], HOME.R_base_sensor)
                if i % 20 == 10:
                    assert any(stands() for _ in range(5)), 'the clock does not wait'

        rig.command(dawdling())
        live.until(lambda: said[-1].message == 'holding', 'holding')
        late = next(pair.value for pair in said[-1].values if pair.key == 'commands late')
        assert int(late) <= 1  # the first may be: nothing waits for a stream that has not begun
        assert (np.diff(rig.ticks) >= 0).all()


def test_a_rig_that_publishes_the_clock_waits_for_nobodys(ros_domain):
    with Live() as live:
        clock, poses = RigTime(live), {'first': {}, 'second': {}}
        for name, heard in poses.items():
            live.hear(PoseStamped, f'{name}/current_pose', heard.__setitem__)
        live.start('sim', 'first', ['__node:=first', 'current_pose:=first/current_pose'],
                   use_sim_time=True)
        live.until(lambda: 'waiting for /clock' in live.said('first'), 'a word')
        assert not (clock.ticks or poses['first'])

        began = live.node.get_clock().now().nanoseconds
        live.start('sim', 'second', ['__node:=second', 'current_pose:=second/current_pose'],
                   use_sim_time=True, clock__publish=True)
        live.until(lambda: all(poses.values()), 'poses of both')
        now = live.node.get_clock().now().nanoseconds
        assert all(began < stamp < now for heard in poses.values() for stamp in heard)
        assert 'publishes /clock' in live.said('second')
        assert 'waiting' not in live.said('second')


@pytest.mark.long
def test_a_recorder_that_is_kept_waiting_loses_no_sample(ros_domain, tmp_path, monkeypatch):
    """By shared memory, the transport that a user's own processes have."""
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE', raising=False)
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    sim, recorder = (subprocess.Popen([sys.executable, '-m', 'forcecal_ros.cli.main', *arguments])
                     for arguments in (['node', 'sim'], ['record', '-o', str(tmp_path / 'bag')]))
    try:
        time.sleep(10.0)
        for _ in range(8):
            recorder.send_signal(signal.SIGSTOP)
            time.sleep(0.15)
            recorder.send_signal(signal.SIGCONT)
            time.sleep(0.5)
    finally:
        for process in (recorder, sim):
            process.send_signal(signal.SIGINT)
            process.wait(60)
    recording = read_recording(tmp_path / 'bag')
    for stream in (recording.wrench, recording.accelerometer):
        lost = np.diff(stream.t[-5000:]) / 1e-3 - 1.0  # between one sample and the next
        assert len(stream) > 5000 and lost.sum() < 60.0


@pytest.mark.parametrize('module, arguments, message', [
    ('sim', ['-p', 'speed:=2'], 'parameter speed is 2, expected a float, with a decimal point'),
    ('sim', ['-p', 'clock.publsh:=true'],
     'unknown parameter clock.publsh; did you mean clock.publish?'),
    ('sim', ['-p', 'rig:=/nowhere.yaml'], '/nowhere.yaml'),
    ('sequencer', ['-p', 'sequence:=dance'], "sequence is 'dance', expected one of calibrate"),
    ('sequencer', ['-p', 'limits.speed:=2.0'], 'limits.acceleration'),
    ('observer', ['-p', 'calibration.file:=/nowhere.yaml'], '/nowhere.yaml'),
    ('observer', ['-p', 'calibration:=cal.yaml'],
     'unknown parameter calibration; did you mean calibration.file?'),
    ('gap', ['-p', 'zigzag:=3'], 'unknown parameter zigzag; config/gap.yaml lists all'),
    ('gap', ['-p', 'pose.base:=base'], "pose.frame is empty, but pose.base is 'base'"),
])
def test_what_cannot_work_is_said_in_one_line(ros_domain, capsys, module, arguments, message):
    main = import_module(f'forcecal_ros.nodes.{module}').main
    assert main([module, '--ros-args', *arguments]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'{module}: ') and message in line


def test_a_parameter_file_reaches_a_node_in_any_namespace(ros_domain, tmp_path):
    text = Path('config/sequencer.yaml').read_text()
    path = tmp_path / 'sequencer.yaml'
    path.write_text(text.replace('speed: 0.2\n', 'speed: 0.125\n', 1))
    rclpy.init(args=['--ros-args', '--params-file', str(path), '-r', '__ns:=/left/arm'])
    try:
        node = Sequencer()
        assert node.get_parameter('pace.speed').value == 0.125
        assert node.get_parameter('limits.workspace_max').value == [1.3, 0.4, 1.4]
        topics = dict(node.get_topic_names_and_types())
        assert '/left/arm/sequencer/phase' in topics and '/left/arm/target_frame' in topics
        assert 'Peak speed' in node.describe_parameter('pace.speed').description
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_a_node_that_cannot_hear_tf_says_so_in_one_line(ros_domain, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    given = ['-p', 'pose.base:=base', '-p', 'pose.frame:=ft_sensor']
    assert observer.main(['observer', '--ros-args', *given]) == 1
    assert 'apt install ros-jazzy-tf2-msgs' in capsys.readouterr().err.splitlines()[-1]


def test_arguments_that_are_no_parameters_are_wrong_usage(ros_domain, capsys):
    assert sim.main(['sim', '--fast']) == 2
    assert 'unknown argument --fast' in capsys.readouterr().err


@pytest.mark.parametrize('node', ['gap', 'impedance', 'observer', 'sequencer', 'sim'])
def test_help_lists_the_parameters_and_starts_nothing(node, capsys):
    module = import_module(f'forcecal_ros.nodes.{node}')
    assert module.main([node, '--help']) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f'usage: {node} [--ros-args')
    assert all(f'  {row.name} (default ' in shown for row in module.PARAMETERS)
