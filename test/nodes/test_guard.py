"""The watch over clocks: real rclpy clocks whose time the test sets."""

from types import SimpleNamespace

from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import Monitor, WatchSettings
from forcecal_ros.nodes.motion_node import Guard
import pytest
from rclpy.clock import ROSClock
from rclpy.time import Time

MS = 1_000_000
START = 1_700_000_000 * 1000 * MS


class Hand:
    """An rclpy clock whose time a test sets; ``taken`` goes by between two of its readings."""

    def __init__(self, nanoseconds):
        self.ros, self.nanoseconds, self.taken = ROSClock(), nanoseconds, iter(())
        self.ros._set_ros_time_is_active(True)

    def now(self):
        self.ros.set_ros_time_override(
            Time(nanoseconds=self.nanoseconds, clock_type=self.ros.clock_type))
        next(self.taken, None)
        return self.ros.now()

    def move(self, ms):
        self.nanoseconds += round(ms * MS)


class Clocks:
    """A guard, the clock of the stamps, and the steady one that only goes forward."""

    def __init__(self, simulated):
        self.stamp, self.steady = Hand(START), Hand(10**12)
        monitor = Monitor(WatchSettings(max_age=0.0, frozen_timeout=0.0), Limits(),
                          {'pose': 'current_pose'})
        monitor.pose(0.0, (1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0))
        heard = SimpleNamespace(monitor=monitor, deadman=SimpleNamespace(fault=lambda steady: ''))
        self.guard = Guard(heard, SimpleNamespace(foreign=0, topic='target_frame'),
                           SimpleNamespace(pause=lambda paused: None), self.stamp,
                           self.steady, simulated)
        self.guard.begin()

    def go(self, steady_ms, stamp_ms):
        self.steady.move(steady_ms)
        self.stamp.move(stamp_ms)

    def pass_by(self, steady_ms, stamp_ms):
        """Let time go by on both clocks, and return what the guard says to it."""
        self.go(steady_ms, stamp_ms)
        if self.guard._simulated:
            return self.guard.clock_fault()
        return self.guard.check(moving=True)


@pytest.mark.parametrize('jump', [500, -500, 86_400_000, 150])
def test_a_system_clock_that_is_set_ends_the_motion(jump):
    clocks = Clocks(simulated=False)
    for _ in range(100):
        assert clocks.pass_by(4, 4) is None
    fault = clocks.pass_by(4, 4 + jump)
    assert fault.reason == f'the system clock jumped by {jump / 1000:.2f} s'


def test_a_processor_that_is_taken_away_between_two_readings_is_no_jump():
    clocks = Clocks(simulated=False)
    assert clocks.pass_by(4, 4) is None
    clocks.steady.taken = (clocks.go(150, 150) for _ in range(3))
    assert clocks.pass_by(4, 4) is None
    assert clocks.pass_by(4, 154).reason == 'the system clock jumped by 0.15 s'


def test_a_command_stream_that_stalls_is_not_resumed():
    clocks = Clocks(simulated=False)
    assert clocks.pass_by(100, 100) is None
    fault = clocks.pass_by(600, 600)
    assert 'stalled for 0.60 s' in fault.reason and fault.at_once


@pytest.mark.parametrize('speed', [0.1, 1.0, 20.0])
@pytest.mark.parametrize('jump', [-500, 2000])
def test_a_simulated_clock_that_jumps_ends_the_motion_whatever_its_speed(speed, jump):
    clocks = Clocks(simulated=True)
    for _ in range(100):
        assert clocks.pass_by(20, 20 * speed) is None
    fault = clocks.pass_by(20, 20 * speed + jump)
    assert fault.reason.startswith('/clock jumped by') and fault.at_once


def test_half_a_second_is_a_jump_of_a_clock_of_real_time_and_lateness_is_none():
    clocks = Clocks(simulated=True)
    for late in (20, 40, 20, 120, 20, 20):
        assert clocks.pass_by(late, late) is None
    assert clocks.pass_by(20, 520).reason == '/clock jumped by 0.52 s'


def test_looks_in_quick_succession_do_not_hide_a_jump():
    clocks = Clocks(simulated=True)
    for _ in range(20):
        assert clocks.pass_by(38, 20) is None
        assert clocks.pass_by(2, 20) is None
    assert clocks.pass_by(20, 520).reason == '/clock jumped by 0.52 s'


def test_a_simulated_clock_that_stands_ends_the_motion():
    clocks = Clocks(simulated=True)
    assert clocks.pass_by(20, 20) is None
    faults = [clocks.pass_by(20, 0) for _ in range(50)]
    assert any(fault and fault.reason == '/clock has stopped' for fault in faults)
