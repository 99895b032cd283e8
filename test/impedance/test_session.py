"""A contact task within its limits and its way out, with a force of the test's making."""

from forcecal_ros.core.errors import ConfigError, MotionError
from forcecal_ros.impedance.law import Measurement
from forcecal_ros.impedance.session import (
    Bounds,
    LineMotion,
    Program,
    Session,
    Stage,
    Task,
    to_rest,
)
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

PERIOD = 0.004
WALL = 0.08
STIFFNESS = 3000.0
BOUNDS = Bounds()
TASK = Task(swings=1, hold=0.3)


class Follow:
    """Gives way to the force by a spring, and is where the reference is otherwise."""

    def __call__(self, reference, heard):
        return reference.position + heard.force / 1000.0

    def sent(self, command):
        self.last = command


class RunAway(Follow):
    """Swings ever wider about the reference."""

    def __init__(self):
        self.swing = 1e-4

    def __call__(self, reference, heard):
        self.swing *= -1.03
        return reference.position + self.swing


class Broken(Follow):
    """Commands what is no number."""

    def __call__(self, reference, heard):
        return float('nan')


class Bench:
    """A session against a wall that pushes back as a spring, behind a lag that keeps it calm."""

    def __init__(self, program=None, controller=None, wall=WALL, bounds=BOUNDS):
        self.session = Session(PERIOD)
        self.controller = controller or Follow()
        self.session.start(program or TASK.program(), WALL, self.controller, bounds)
        self.wall, self.x, self.force = wall, 0.0, 0.0

    @property
    def status(self):
        return self.session.status

    def drive(self, seconds=60.0):
        """Go on, and return the commands."""
        commands = []
        for _ in range(round(seconds / PERIOD)):
            command = self.session.step(Measurement(self.x, 0.0, self.force))
            if command is None:
                break
            commands.append(command)
            self.x = command
            self.force += 0.2 * (-STIFFNESS * max(0.0, command - self.wall) - self.force)
        return np.array(commands)


def pressing():
    """Return a session that presses on its wall, and its last command."""
    bench = Bench()
    while bench.force > -14.0:
        last = bench.drive(PERIOD)[-1]
    return bench, last


def speeds(commands):
    return np.diff(commands) / PERIOD


def test_a_task_is_idle_until_it_is_started():
    session = Session(PERIOD)
    assert session.step(Measurement(0.0, 0.0, 0.0)) is None
    assert not session.running and not session.abort('nothing there')


def test_a_task_visits_the_wall_as_often_as_it_says_and_ends_at_rest_where_it_began():
    bench = Bench(TASK.program(cycles=2))
    commands = bench.drive()
    assert bench.status.phase == 'done'
    assert (bench.status.contacts, bench.status.missed) == (2, 0)
    assert not bench.session.streaming
    assert abs(commands[-1]) < 1e-3 and commands[-1] == commands[-2]


def test_a_wall_that_is_not_there_is_counted_as_missed():
    bench = Bench(wall=1.0)
    bench.drive()
    assert (bench.status.contacts, bench.status.missed) == (0, 1)


def test_a_second_start_is_refused():
    bench = Bench()
    bench.drive(0.1)
    with pytest.raises(MotionError, match='under way'):
        bench.session.start(TASK.program(), WALL, Follow(), BOUNDS)


def test_a_wall_where_none_was_expected_ends_the_task_away_from_it_within_100_ms():
    bench = Bench(wall=0.04)
    commands = bench.drive()
    assert bench.status.phase == 'aborted'
    assert bench.status.reason.startswith('contact force 1')
    assert 'before the wall is expected; limits.free_force is 10 N' in bench.status.reason
    turned = np.argmax(commands)
    still = turned + 1 + np.flatnonzero(np.abs(speeds(commands[turned + 1:])) < 5e-3)[0]
    assert (still - turned) * PERIOD < 0.1
    assert commands[-1] < 0.04 + 1e-3


def test_too_much_force_in_contact_ends_the_task():
    bench = Bench(bounds=Bounds(force=12.0))
    bench.drive()
    assert bench.status.reason.startswith('contact force 12.')
    assert bench.status.reason.endswith('exceeds limits.force 12 N')


def test_a_controller_that_runs_away_ends_the_task():
    bench = Bench(controller=RunAway())
    commands = bench.drive()
    assert 'the loop is unstable here' in bench.status.reason
    assert np.abs(commands).max() < BOUNDS.deviation


def test_a_command_that_is_no_number_ends_the_task():
    bench = Bench(controller=Broken())
    commands = bench.drive(1.0)
    assert bench.status.phase == 'aborted' and np.isfinite(commands).all()


def test_an_abort_in_contact_rests_within_100_ms_and_then_leaves_the_wall():
    bench, before = pressing()
    assert bench.status.phase in ('approach', 'contact')
    assert bench.session.abort('asked to')
    commands = bench.drive(1.0)
    rest = round(BOUNDS.stop_duration / PERIOD)
    assert commands[rest - 1] == pytest.approx(before - BOUNDS.retract, abs=1e-3)
    assert abs(commands[rest] - commands[rest - 1]) < 1e-4
    assert commands[-1] == pytest.approx(commands[rest - 1] - BOUNDS.withdraw, abs=1e-6)
    assert (np.diff(commands) <= 1e-4).all() and bench.force > -BOUNDS.touch
    assert bench.status.phase == 'aborted' and not bench.session.streaming


@pytest.mark.parametrize('force', [0.0, -14.0])
def test_a_force_that_shows_no_wall_or_fell_silent_leads_away_once(force):
    bench, before = pressing()
    bench.session.abort('asked to')
    commands = []
    while bench.session.streaming:
        commands.append(bench.session.step(Measurement(bench.x, 0.0, force)))
    assert commands[-1] == pytest.approx(before - BOUNDS.retract - BOUNDS.withdraw, abs=1e-3)


@pytest.mark.parametrize('nearer, ends', [(0.05, 0.02), (1.0, 0.0)])
def test_a_tool_that_presses_on_is_led_away_as_far_as_where_it_began(nearer, ends):
    bench, _ = pressing()
    bench.wall = bench.x - nearer  # the command ran far ahead of what was measured
    bench.session.abort('asked to')
    commands = bench.drive(10.0)
    assert (np.diff(commands) <= 1e-4).all() and not bench.session.streaming
    assert ends - 1e-9 <= commands[-1] <= max(ends, bench.wall + 1e-3) + 1e-9


def test_an_abort_in_free_space_stops_gently_on_its_way():
    bench = Bench()
    bench.drive(0.4)
    assert bench.status.phase == 'free'
    moving = bench.drive(2 * PERIOD)
    velocity = speeds(moving)[-1]
    bench.session.abort('asked to')
    commands = bench.drive(1.0)
    way = commands[-1] - moving[-1]
    assert way == pytest.approx(0.5 * velocity * BOUNDS.stop_duration, rel=0.05)


def test_a_robot_that_stands_already_is_not_set_in_motion_by_the_stop():
    bench = Bench()
    bench.drive(0.4)
    last = bench.drive(2 * PERIOD)[-1]
    assert bench.session.moving
    bench.session.abort('the stream stalled', at_once=True)
    np.testing.assert_allclose(bench.drive(1.0), last, atol=1e-12)


def test_commands_are_held_to_speed_and_acceleration():
    jump = Program((Stage('free', 0.05, 0.012), Stage('free', 0.05, 1.0)))
    bench = Bench(jump, bounds=Bounds(deviation=1.0))
    commands = bench.drive(0.1)
    assert bench.controller.last == commands[-1] != 0.05  # it learns what was really sent
    commands = np.append(commands, bench.drive(0.9))
    assert bench.status.limited > 0
    assert np.abs(speeds(commands)).max() <= BOUNDS.speed * (1 + 1e-9)
    assert np.abs(np.diff(speeds(commands))).max() <= BOUNDS.acceleration * PERIOD * (1 + 1e-9)


def test_after_a_silence_the_command_takes_up_speed_from_rest():
    bench = Bench()
    moving = bench.drive(0.4)
    bench.session.restart()
    commands = np.append(moving[-1], bench.drive(0.02))
    assert abs(speeds(moving)[-1]) > 0.1
    ramp = BOUNDS.acceleration * PERIOD * np.arange(1, 6)
    assert (np.abs(speeds(commands)) <= ramp + 1e-9).all()


def test_a_pause_lets_the_reference_stand():
    bench = Bench()
    bench.drive(0.4)
    bench.session.pause(True)
    standing = bench.drive(0.2)
    bench.session.pause(False)
    assert np.ptp(standing[30:]) < 1e-9
    assert np.ptp(bench.drive(0.1)) > 1e-3


@settings(max_examples=40)
@given(st.floats(-0.25, 0.25), st.floats(-3.0, 3.0), st.floats(0.0, 0.01))
def test_a_stop_begins_as_the_motion_is_and_ends_at_rest(velocity, acceleration, retract):
    motion = LineMotion(0.3, velocity, acceleration)
    stop = to_rest(motion, 0.062, retract, 8.0)
    assert stop.at(0.0) == pytest.approx(motion, abs=1e-9)
    end = stop.at(0.062 - 1e-9)
    assert end == pytest.approx((stop.goal, 0.0, 0.0), abs=1e-5)
    assert stop.at(1.0) == (stop.goal, 0.0, 0.0)


@settings(max_examples=40)
@given(st.floats(-0.1, 0.1), st.floats(0.001, 0.05))
def test_a_retract_is_shortened_until_its_acceleration_is_within_the_limit(velocity, retract):
    stop = to_rest(LineMotion(0.0, velocity), 0.062, retract, 8.0)
    peak = max(abs(stop.at(t).acceleration) for t in np.linspace(0.0, 0.062, 200))
    assert peak < 8.0 * 1.05
    assert stop.goal <= 0.5 * velocity * 0.062 + 1e-12


def test_bounds_want_positive_numbers():
    with pytest.raises(ConfigError, match='free_force'):
        Bounds(free_force=-1.0)
