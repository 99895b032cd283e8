"""The sequencer's state machine and its watch over the sensors, without ROS."""

from copy import copy, deepcopy
from itertools import pairwise
import re

from forcecal_ros.core.errors import DataError, ForcecalError, MotionError
from forcecal_ros.core.geometry import (
    quaternion_from_matrix,
    rotation_from_vector,
    rotation_vector,
)
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import angle_between, Monitor, Stillness, WatchSettings
from forcecal_ros.motion.plan import calibration_plan, PlannedSegment, prepare, Segment, Timing
from forcecal_ros.motion.profiles import (
    JointMove,
    Move,
    nominal_poses,
    Pace,
    Pose,
    step_goal,
    twist_towards,
)
from forcecal_ros.motion.sequence import MotionSequence, next_in_phase, StreamClock, StreamSettings
from hypothesis import given, settings
from hypothesis import strategies as st
from longer import first
import numpy as np
import pytest

HOME = nominal_poses()['v']
STREAM = StreamSettings()
LIMITS = Limits()
PERIOD = 1 / STREAM.rate
STILL = Stillness(True, '')
TIMING = Timing(measure=0.5, ring=0.3)


def default_parts(timing=TIMING):
    plan = calibration_plan(nominal_poses(), step_goal(HOME, timing.step_distance), timing)
    return prepare(plan, HOME, Pace(), LIMITS)


def started(timing=TIMING):
    sequence = MotionSequence(STREAM)
    sequence.start(default_parts(timing), HOME)
    return sequence


def run(sequence, periods, stillness=STILL):
    """Step until the stream ends or the periods are over: commands and phase words."""
    commands, phases = [], []
    for _ in range(periods):
        command = sequence.step(stillness)
        if command is None:
            break
        commands.append(command)
        phases.append(sequence.status.phase)
    return commands, phases


def speeds(commands):
    """Return what a listener would compute from the poses: [m/s] and [rad/s] vectors."""
    p = np.array([c.pose.position for c in commands])
    R = np.array([c.pose.R_base_sensor for c in commands])
    turn = rotation_vector(R[1:] @ R[:-1].transpose(0, 2, 1))
    return np.diff(p, axis=0) / PERIOD, turn / PERIOD


def changes(words):
    return [w for i, w in enumerate(words) if i == 0 or words[i - 1] != w]


# The sequence -----------------------------------------------------------------------------------


def test_nothing_is_commanded_before_start():
    sequence = MotionSequence(STREAM)
    assert sequence.step(STILL) is None
    assert sequence.status.phase == 'idle' and not sequence.running
    assert not sequence.abort('asked to')


def test_phases_come_in_the_order_of_the_plan_and_end_in_done():
    sequence = started()
    _, phases = run(sequence, 5000)
    assert changes(phases) == ['move', 'settle', 'measure'] * 4 + ['move', 'settle', 'step',
                                                                  'settle']
    assert sequence.moved and sequence.running and not sequence.streaming
    aborted = copy(sequence)
    sequence.finish()
    assert sequence.status.phase == 'done' and sequence.status.progress == 1.0
    assert aborted.abort('while it identifies')
    aborted.finish()
    assert (aborted.status.phase, aborted.status.reason) == ('aborted', 'while it identifies')


def test_a_whole_stream_keeps_every_limit_and_ends_at_rest():
    commands, _ = run(started(), 5000)
    velocity, spin = speeds(commands)
    assert np.linalg.norm(velocity, axis=1).max() < 0.19
    assert np.linalg.norm(spin, axis=1).max() <= Pace().angular_speed * (1 + 1e-9)
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() / PERIOD < 5.78
    assert not velocity[-20:].any() and not spin[-20:].any()
    np.testing.assert_array_equal(commands[-1].pose.position, HOME.position)


def test_settling_waits_for_the_verdict_and_gives_up_with_its_numbers():
    sequence = started()
    shaking = Stillness(False, 'wrench: standard deviation of force.x is 1.2 > 0.31')
    commands, phases = run(sequence, 5000, shaking)
    assert sequence.status.phase == 'aborted'
    assert 'force.x is 1.2 > 0.31' in sequence.status.reason
    settled = phases.count('settle') * PERIOD
    assert settled == pytest.approx(STREAM.settle_timeout, abs=3 * PERIOD)
    velocity, spin = speeds(commands[-30:])
    assert not velocity.any() and not spin.any()


def test_a_verdict_too_early_does_not_end_settling():
    sequence = started()
    _, phases = run(sequence, 5000)
    first = phases.index('settle')
    assert phases.index('measure') - first >= STREAM.settle_minimum / PERIOD - 1


@pytest.fixture(scope='module')
def film():
    """Every instant of one run: a copy of the sequence, and the last commands before it."""
    sequence, frames, commands = started(), [], []
    while sequence.streaming:
        frames.append((copy(sequence), commands[-2:]))
        commands.append(sequence.step(STILL))
    return frames


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_abort_at_any_instant_is_at_rest_within_a_tenth_of_a_second(film, data):
    sequence, before = film[data.draw(st.integers(0, len(film) - 1))]
    sequence = copy(sequence)
    ending = sequence.moved
    assert sequence.abort('asked to')
    after, phases = run(sequence, 1000)
    velocity, spin = speeds(before + after)
    late = len(before) + int(0.1 / PERIOD)
    assert not velocity[late:].any() and not spin[late:].any()
    assert set(phases) == {'aborted'} and sequence.step() is None
    assert ending or len(after) >= STREAM.closing / PERIOD
    assert np.abs(np.diff(velocity, axis=0)).max(initial=0) / PERIOD <= LIMITS.acceleration
    assert (np.linalg.norm(np.diff(spin, axis=0), axis=1).max(initial=0) / PERIOD
            <= LIMITS.angular_acceleration)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.05, 0.95), st.floats(0.2, 2.0))
def test_a_stop_stays_on_the_path_and_never_turns_back(when, duration):
    goal = Pose(HOME.position + [0.02, 0.01, 0.0],
                HOME.R_base_sensor @ rotation_from_vector([0.1, 0.0, 0.05]))
    sequence = MotionSequence(STREAM)
    sequence.start(prepare([Segment('move', 'there', goal, duration)], HOME, Pace(), LIMITS), HOME)
    before, _ = run(sequence, max(1, int(when * duration / PERIOD)))
    sequence.abort('asked to')
    after, _ = run(sequence, 1000)
    line = goal.position - HOME.position
    points = np.array([c.pose.position for c in before + after]) - HOME.position
    along = points @ line / (line @ line)
    np.testing.assert_allclose(points, along[:, None] * line, atol=1e-12)
    assert (np.diff(along) >= -1e-12).all() and along[-1] <= 1.0


def untouched(sequence):
    return []


def between_two_parts(sequence):
    while sequence.status.phase != 'measure':
        sequence.step(STILL)
    while sequence.status.phase == 'measure':
        last = sequence.step(STILL)
    assert sequence.status.phase == 'move'
    return [last]


def paused(sequence):
    run(sequence, 700)
    sequence.pause(True)
    return run(sequence, 50)[0]


def under_way(sequence):
    commands = run(sequence, 700)[0]
    assert commands[-1].moving
    return commands


@pytest.mark.parametrize('lead, at_once', [
    (untouched, False), (between_two_parts, False), (paused, False), (under_way, True)])
def test_an_abort_at_rest_or_at_once_only_holds(lead, at_once):
    sequence = started()
    before = lead(sequence)
    sequence.abort('asked to', at_once=at_once)
    after, _ = run(sequence, 1000)
    velocity, spin = speeds(before[-1:] + after)
    assert not velocity.any() and not spin.any() and not sequence.streaming


def test_a_pause_comes_to_rest_within_the_stop_and_goes_on_along_the_same_path():
    reference, _ = run(started(), 5000)
    sequence = started()
    before, _ = run(sequence, 700)
    assert before[-1].moving
    sequence.pause(True)
    paused, _ = run(sequence, 200)
    sequence.pause(False)
    after, phases = run(sequence, 5000)
    commands = before + paused + after
    _, spin = speeds(commands)
    stop = len(before) + int(0.05 / PERIOD)
    assert not spin[stop:len(before) + 199].any()
    assert np.linalg.norm(np.diff(spin, axis=0), axis=1).max() / PERIOD < 60
    assert phases[-1] == 'settle' and sequence.moved
    assert len(commands) == pytest.approx(len(reference) + 200, abs=3)


def test_a_restart_takes_up_speed_from_rest():
    sequence = started()
    before, _ = run(sequence, 700)
    sequence.restart()
    after, _ = run(sequence, 100)
    _, spin = speeds(before[-1:] + after)
    assert np.linalg.norm(spin[0]) < 0.1 * np.linalg.norm(before[-1].angular_velocity)
    assert np.linalg.norm(np.diff(spin, axis=0), axis=1).max() / PERIOD < 60


def test_the_first_abort_counts_and_no_start_comes_before_the_stream_has_ended():
    sequence = started()
    sequence.step(STILL)
    for _ in range(2):
        with pytest.raises(MotionError, match='under way'):
            sequence.start(default_parts(), HOME)
        sequence.abort('first')
    assert not sequence.abort('second')
    assert sequence.status.reason == 'first'
    run(sequence, 1000)
    sequence.start(default_parts(), HOME)
    assert sequence.status.phase == 'move'


def test_joint_vectors_stream_and_stop_by_the_same_machine():
    start, goal = np.zeros(6), np.array([0.1, -0.5, 0.8, 0, 0, 0.2])
    sequence = MotionSequence(STREAM)
    move = JointMove(start, goal, 2.0)
    sequence.start([PlannedSegment(Segment('move', 'there', goal, 2.0), move, goal)], start)
    before, _ = run(sequence, 250)
    sequence.abort('asked to')
    after, _ = run(sequence, 1000)
    positions = np.array([c.positions for c in before[-1:] + after])
    rates = np.diff(positions, axis=0) / PERIOD
    assert rates[0].any() and not rates[int(0.1 / PERIOD):].any()
    assert np.abs(np.diff(rates, axis=0)).max() / PERIOD < LIMITS.joint_acceleration


# The watch --------------------------------------------------------------------------------------

TOPICS = {'wrench': 'wrench', 'accelerometer': 'accelerometer/raw', 'pose': 'current_pose'}
WATCH = WatchSettings()


class Bench:
    """Feeds a monitor with noisy sensors at 1 kHz and 250 Hz, and ticks it every 4 ms."""

    def __init__(self, seed=0, **limits):
        self.rng = np.random.default_rng(seed)
        self.monitor = Monitor(WATCH, Limits(**limits), TOPICS)
        self.ms = 0
        self.position = HOME.position.copy()
        self.force = np.array([4.0, -3, 135.5, 0.3, -0.2, 0.1])
        self.silent = set()
        self.frozen = {}
        self.quaternion = quaternion_from_matrix(HOME.R_base_sensor)

    def sample(self, name, values):
        return self.frozen.get(name, tuple(float(v) for v in values))

    def tick(self, moving=False):
        for _ in range(4):
            self.ms += 1
            now = self.ms * 1e-3
            if 'wrench' not in self.silent:
                noise = self.rng.normal(0, [0.25] * 3 + [0.02] * 3)
                self.monitor.wrench(now, self.sample('wrench', self.force + noise))
            if 'accelerometer' not in self.silent:
                volts = 5.0 + 0.01 * self.rng.normal(size=3)
                self.monitor.other('accelerometer', now, self.sample('accelerometer', volts))
        if 'pose' not in self.silent:
            place = self.position + 20e-6 * self.rng.normal(size=3)
            self.monitor.pose(now, self.sample('pose', (*place, *self.quaternion)))
        self.monitor.tick(now)
        return self.monitor.check(moving)

    def wait(self, ticks):
        for _ in range(ticks):
            self.tick()

    def begin(self):
        self.monitor.begin(self.ms * 1e-3)

    def freeze(self, name):
        self.frozen[name] = self.monitor.channels[name].values

    def stale(self, lag=0.0):
        return self.monitor.stale(self.ms * 1e-3 + lag)

    def until_fault(self, ticks, moving=True):
        begin = self.ms
        for _ in range(ticks):
            fault = self.tick(moving)
            if fault:
                return fault, (self.ms - begin) * 1e-3
        return '', (self.ms - begin) * 1e-3


@pytest.fixture(scope='module')
def watched():
    bench = Bench()
    assert bench.until_fault(300, moving=False)[0] == ''
    bench.begin()
    return bench


@pytest.fixture
def bench(watched):
    return deepcopy(watched)


def test_a_healthy_rig_is_still_at_most_instants(bench):
    verdicts = []
    for _ in range(200):
        assert not bench.tick()
        verdicts.append(bench.monitor.stillness().still)
    assert np.mean(verdicts) > 0.9


def test_ringing_of_half_a_newton_is_not_still(bench):
    for _ in range(100):
        bench.force[0] = 4.0 + 0.5 * np.sin(20 * bench.ms * 1e-3)
        bench.tick()
    verdict = bench.monitor.stillness()
    assert not verdict.still and 'force.x' in verdict.detail


@pytest.mark.parametrize('name', list(TOPICS))
def test_a_lost_sensor_is_named_in_time_to_stop_within_a_tenth_of_a_second(bench, name):
    bench.tick(moving=True)
    bench.silent.add(name)
    begin = bench.ms
    while not bench.stale():
        assert not bench.tick(moving=True)
    assert bench.stale().startswith(TOPICS[name] + ': silent')
    assert (bench.ms - begin) * 1e-3 + STREAM.stop_duration <= 0.1
    bench.silent.clear()
    bench.tick()
    assert not bench.stale()


def command(bench, travel):
    bench.monitor.command(bench.ms * 1e-3, (*(HOME.position + [travel, 0, 0]), *bench.quaternion))


@pytest.fixture
def quiet():
    """Return a robot whose readings repeat to the last bit while it stands, as simulators' do."""
    bench = Bench()
    for name in TOPICS:
        bench.tick()
        bench.freeze(name)
    bench.wait(300)
    bench.begin()
    command(bench, 0.0)
    return bench


def test_a_quiet_robot_that_is_told_to_move_and_has_not_yet_is_not_frozen(quiet):
    for i in range(50):
        command(quiet, 1e-5 * i)
        assert not quiet.tick(moving=True)


def test_commands_that_no_pose_has_reached_in_time_yet_freeze_nothing(quiet):
    for _ in range(20):
        quiet.monitor.command(quiet.ms * 1e-3 + 10.0, (*HOME.position + 0.01, *quiet.quaternion))
        assert not quiet.tick(moving=True)


@pytest.mark.parametrize('name', list(TOPICS))
def test_a_quiet_sensor_that_repeats_itself_under_way_is_found_frozen(quiet, name):
    for other in set(TOPICS) - {name}:
        del quiet.frozen[other]
    begin = quiet.ms
    for i in range(20):
        command(quiet, 1e-3 * (i + 1))
        if fault := quiet.tick(moving=True):
            break
    assert f'{TOPICS[name]}: the same reading' in fault
    assert (quiet.ms - begin) * 1e-3 + STREAM.stop_duration <= 0.1


def test_a_robot_that_has_not_set_off_is_not_still_yet(bench):
    command(bench, 0.0)
    bench.tick()
    assert bench.monitor.stillness().still
    command(bench, 0.01)
    bench.wait(100)
    verdict = bench.monitor.stillness()
    assert not verdict.still and 'of the commanded 0.01 m' in verdict.detail
    bench.position = HOME.position + [0.0098, 0, 0]
    bench.wait(100)
    assert bench.monitor.stillness().still


def test_a_stall_of_ones_own_does_not_blame_the_sensors(bench):
    bench.ms += 400
    bench.monitor.tick(bench.ms * 1e-3)
    assert not bench.stale()


@pytest.mark.parametrize('moving', [False, True])
@pytest.mark.parametrize('name', list(TOPICS))
def test_a_sensor_that_never_repeats_itself_is_found_frozen_without_motion(bench, name, moving):
    bench.tick(moving)
    bench.freeze(name)
    fault, after = bench.until_fault(30, moving)
    assert fault.startswith(TOPICS[name]) and 'the same reading' in fault
    assert after + STREAM.stop_duration <= 0.1


@pytest.mark.parametrize('seconds, healed', [(0.06, 0.5), (1.2, 2.1), (1.2, 4.0)])
def test_a_freeze_that_has_healed_does_not_excuse_the_next(bench, seconds, healed):
    bench.freeze('wrench')
    bench.wait(round(seconds / PERIOD))
    bench.frozen.clear()
    bench.wait(round(healed / PERIOD))
    bench.begin()
    bench.freeze('wrench')
    fault, after = bench.until_fault(30, moving=False)
    assert 'wrench: the same reading' in fault and after < 0.06


@pytest.mark.parametrize('name', list(TOPICS))
@pytest.mark.parametrize('seconds', first([0.06, 5.0]))
def test_a_sensor_that_is_frozen_keeps_a_sequence_from_starting_until_it_changes(
        bench, name, seconds):
    bench.freeze(name)
    bench.wait(round(seconds / PERIOD))
    for _ in range(2):
        with pytest.raises(DataError, match=f'{TOPICS[name]}: the same reading for'):
            bench.begin()
        bench.tick()
    bench.frozen.clear()
    bench.tick()
    bench.begin()


def test_readings_that_use_to_repeat_for_a_while_at_rest_are_not_frozen():
    bench = Bench()
    for tick in range(2500):
        if tick % 20 == 0:
            bench.frozen['pose'] = (*(HOME.position + 1e-6 * (tick % 3)), *bench.quaternion)
        if tick == 600:
            bench.begin()
        assert bench.tick() == ''


def test_a_sensor_that_always_repeats_itself_at_rest_may_do_so():
    bench = Bench()
    bench.frozen['pose'] = (*HOME.position, *bench.quaternion)
    bench.wait(500)
    bench.begin()
    assert bench.until_fault(100, moving=False)[0] == ''


@pytest.mark.parametrize('name', list(TOPICS))
@pytest.mark.parametrize('garbage', [np.nan, np.inf])
def test_garbage_is_named_at_once(bench, name, garbage):
    values = list(bench.monitor.channels[name].values)
    values[1] = garbage
    bench.frozen[name] = tuple(values)
    fault, after = bench.until_fault(10, moving=False)
    assert fault == f'{TOPICS[name]}: a reading is not finite' and after <= 0.004


def test_stale_stamps_are_named(bench):
    bench.tick()
    for lag in (0.1, 0.3):
        for _ in range(20):
            bench.tick()
            found = bench.stale(lag)
        assert bool(found) == (lag > WATCH.max_age)
    assert found.startswith('wrench: newest stamp is 0.300 s old')


def test_a_robot_that_runs_away_is_named(bench):
    for k in range(100):
        bench.position[1] += min(0.4, 0.01 * k) * 0.004
        fault = bench.tick(moving=True)
        if fault:
            break
    assert 'above limits.overspeed 1.5 times limits.speed 0.25 m/s' in fault


@pytest.mark.parametrize('limits, reason', [
    (Limits(overspeed=1.0), 'times limits.acceleration 8 m/s^2'),
    (Limits(overspeed=1.0, acceleration=20.0, jerk=760.0), 'times limits.jerk 760 m/s^3')])
def test_a_robot_that_shakes_is_named_by_its_acceleration_or_its_jerk(bench, limits, reason):
    bench.monitor.limits = limits
    for k in range(50):
        bench.position[1] = HOME.position[1] + 0.004 * np.sin(2 * np.pi * 10 * 0.004 * k)
        fault = bench.tick(moving=True)
    assert reason in fault


@pytest.mark.parametrize('name, part, value, said', [
    ('force', 0, 260.0, r'^wrench: force .*limits\.force 250 N'),
    ('force', 4, 61.0, r'^wrench: torque .*limits\.torque 60 N m'),
    ('position', 2, 1.41, r'outside limits\.workspace_min/max 0\.6 to 1\.4 m'),
    ('position', 0, 1.11, r'x = 1\.31.* m of the tip is outside'),
    ('quaternion', slice(4), 0.0, '^current_pose: a quaternion has norm 0, not 1$')])
def test_a_reading_beyond_its_limit_is_named_with_it(bench, name, part, value, said):
    getattr(bench, name)[part] = value
    fault, _ = bench.until_fault(3)
    assert re.search(said, fault)


def test_a_robot_that_does_not_follow_is_named(bench):
    now = bench.ms * 1e-3
    bench.monitor.command(now, (*HOME.position, *bench.quaternion))
    bench.monitor.command(now + 0.01, (*(HOME.position + [0.03, 0, 0]), *bench.quaternion))
    assert not bench.tick(True)
    fault, _ = bench.until_fault(5)
    assert '0.03 m from the command' in fault and 'check that the controller' in fault
    turned = quaternion_from_matrix(HOME.R_base_sensor @ rotation_from_vector([0.3, 0, 0]))
    bench.monitor.command(bench.ms * 1e-3, (*HOME.position, *turned))
    fault, _ = bench.until_fault(5)
    assert '0.3 rad from the command' in fault


@pytest.mark.parametrize('ticks, speed, said', [
    (0, 0.0, 'wrench: nothing received yet'), (30, 0.0, r'0\.119 s received, 0\.5 s are required'),
    (300, 0.002, 'current_pose: position.x drifts')])
def test_begin_refuses_silence_a_short_time_and_a_robot_that_moves(ticks, speed, said):
    bench = Bench()
    for _ in range(ticks):
        bench.position[0] += speed * PERIOD
        bench.tick()
    with pytest.raises(ForcecalError, match=said):
        bench.begin()


def test_begin_forgets_the_fault_of_the_run_before(bench):
    bench.frozen['wrench'] = (np.nan,) * 6
    bench.tick()
    bench.frozen.clear()
    assert bench.tick()
    bench.wait(600)
    bench.begin()
    assert not bench.tick()


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(-1.7, 1.7)] * 3).map(np.array))
def test_angle_between_quaternions_is_that_of_the_rotation_vector(turn):
    a = quaternion_from_matrix(HOME.R_base_sensor)
    b = quaternion_from_matrix(HOME.R_base_sensor @ rotation_from_vector(turn))
    angle = np.linalg.norm(turn)
    assert angle_between(tuple(a), tuple(b)) == pytest.approx(angle, abs=1e-9)
    assert angle_between(tuple(a), tuple(-b)) == pytest.approx(angle, abs=1e-9)


# The stream -------------------------------------------------------------------------------------


def test_commands_are_due_one_a_period():
    clock = StreamClock(4, 100, 1000)
    assert [clock.due(now) for now in (96, 99, 100)] == [0, 0, 1]
    assert clock.next_stamp() == 1000
    assert [clock.due(now) for now in (103, 104)] == [0, 1]
    assert clock.next_stamp() == 1004


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=50))
def test_a_late_caller_sends_few_at_once_and_stamps_lie_neither_ahead_nor_far_behind(pauses):
    clock, now, stamps = StreamClock(4, 0, 0), 0, []
    for pause in pauses:
        now += pause
        count = clock.due(now)
        assert count <= 3
        stamps += [clock.next_stamp() for _ in range(count)]
        assert not stamps or now - 4 < stamps[-1] <= now
    assert all(b - a >= 4 and (b - a) % 4 == 0 for a, b in pairwise(stamps))


def test_a_stream_takes_up_the_phase_of_the_measured_poses():
    assert next_in_phase(1000, 3, 4) == 1003
    assert next_in_phase(1003, 3, 4) == 1003
    assert next_in_phase(1001, 999, 4) == 1003


def test_twists_are_zero_at_rest_and_lead_back_to_the_path_in_motion():
    move = Move(HOME, nominal_poses()['h'], 2.0)
    off = Pose(HOME.position + [0, 0.001, 0], HOME.R_base_sensor)
    v, w = twist_towards(move.at(0.0), off, 5.0)
    assert not v.any() and not w.any()
    middle = move.at(1.0)
    v, w = twist_towards(middle, Pose(off.position, middle.pose.R_base_sensor), 5.0)
    np.testing.assert_allclose(v, [0, -0.005, 0], atol=1e-12)
    np.testing.assert_allclose(w, middle.angular_velocity, atol=1e-12)
