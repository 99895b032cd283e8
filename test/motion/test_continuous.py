"""The multi-sine of a continuous calibration: smooth, within every limit, enough to calibrate."""

from dataclasses import replace

from forcecal_ros.core.errors import MotionError
from forcecal_ros.core.geometry import rotation_vector
from forcecal_ros.motion.continuous import (
    check_multi_sine,
    DURATION_S,
    fit_multi_sine,
    MIN_ROTATION_RAD,
    MultiSine,
)
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import Stillness
from forcecal_ros.motion.plan import continuous_plan, outline, path_of, preview, Timing
from forcecal_ros.motion.profiles import nominal_poses, Pace
from forcecal_ros.motion.sequence import MotionSequence, StreamSettings
from forcecal_ros.nodes.sequencer import PARAMETERS, settings_of
from longer import first
import numpy as np
import pytest

HOME = nominal_poses()['v']
LIMITS, PACE, TIMING = Limits(), Pace(), Timing()
PERIOD = 0.004
STOP = LIMITS.stop_duration


@pytest.fixture(scope='module')
def move():
    return fit_multi_sine(HOME, PACE, LIMITS)


def rates(poses):
    """Return speed, acceleration, turning and its change as a robot would measure them."""
    position = np.array([pose.position for pose in poses])
    R = np.array([pose.R_base_sensor for pose in poses])
    velocity = np.diff(position, axis=0) / PERIOD
    turning = rotation_vector(R[1:] @ R[:-1].transpose(0, 2, 1)) / PERIOD
    return [np.linalg.norm(x, axis=1).max() for x in (
        velocity, np.diff(velocity, axis=0) / PERIOD, turning, np.diff(turning, axis=0) / PERIOD)]


def commanded(stop_after=None):
    sequence = MotionSequence(StreamSettings(stop_duration=STOP))
    sequence.start(continuous_plan(HOME, TIMING, PACE, LIMITS), HOME)
    commands, phases = [], []
    while (command := sequence.step(Stillness(True, ''))) is not None:
        commands.append(command)
        phases.append(sequence.status.phase)
        if stop_after is not None and len(commands) == stop_after:
            sequence.abort('by the test')
    return commands, phases


def test_it_begins_and_ends_at_rest_where_the_robot_stands(move):
    for t in (0.0, DURATION_S):
        setpoint = move.at(t)
        assert not setpoint.moving
        np.testing.assert_array_equal(setpoint.pose.position, HOME.position)
        np.testing.assert_array_equal(setpoint.pose.R_base_sensor, HOME.R_base_sensor)


def test_velocities_are_those_of_the_poses(move):
    for t in np.random.default_rng(1).uniform(0.0, DURATION_S, 30):
        before, now, after = (move.at(t + dt) for dt in (-1e-4, 0.0, 1e-4))
        np.testing.assert_allclose(
            (after.pose.position - before.pose.position) / 2e-4, now.velocity, atol=1e-6)
        np.testing.assert_allclose(
            rotation_vector(after.pose.R_base_sensor @ before.pose.R_base_sensor.T) / 2e-4,
            now.angular_velocity, atol=1e-6)


def test_it_keeps_the_pace_and_uses_it(move):
    measured = rates([move.at(t).pose for t in np.arange(0.0, DURATION_S, PERIOD)])
    allowed = (PACE.speed, PACE.acceleration, PACE.angular_speed, PACE.angular_acceleration)
    assert all(found <= cap * (1 + 1e-3) for found, cap in zip(measured, allowed))
    assert measured[0] > 0.9 * PACE.speed and measured[2] > 0.9 * PACE.angular_speed


@pytest.mark.parametrize('seed', first(range(3)))
def test_a_stop_at_any_instant_stays_on_the_path_and_within_the_limits(seed):
    after = int(np.random.default_rng(seed).integers(350, 2500))
    commands, phases = commanded(after)
    assert phases[after - 1] == 'sweep' and phases[-1] == 'aborted'
    assert not commands[-1].moving
    stopping = commands[after - 2:]
    assert sum(command.moving for command in stopping) * PERIOD < STOP + 3 * PERIOD
    speed, acceleration, turning, change = rates([c.pose for c in stopping])
    assert speed < LIMITS.speed and acceleration < LIMITS.acceleration
    assert turning < LIMITS.angular_speed and change < LIMITS.angular_acceleration


@pytest.mark.parametrize('limit, value', first([
    ('speed', 0.05), ('angular_acceleration', 14.0), ('acceleration', 1.7), ('jerk', 200.0),
    ('angular_speed', 0.4), ('angular_jerk', 1300.0)], 2))
def test_each_limit_alone_makes_it_smaller(move, limit, value):
    speeds = {'acceleration': {'speed': 0.05}, 'jerk': {'speed': 0.06},
              'angular_acceleration': {'angular_speed': 0.42},
              'angular_jerk': {'angular_speed': 0.44}}.get(limit, {})
    tight = Limits(**{**speeds, limit: value})
    with pytest.raises(MotionError, match=f'limits.({limit}|{"|".join([*speeds, limit])}) is'):
        check_multi_sine(move, tight)
    smaller = fit_multi_sine(HOME, PACE, tight)
    check_multi_sine(smaller, tight)
    shrunk = (smaller.rotation < move.rotation if limit.startswith('angular')
              else smaller.translation < move.translation)
    assert shrunk


def test_the_workspace_bounds_sensor_and_tip(move):
    box = Limits(workspace_min=[0.95, -0.05, 0.8], workspace_max=[1.22, 0.05, 1.06])
    small = fit_multi_sine(HOME, PACE, box)
    assert small.rotation < 0.9 * move.rotation
    positions, rotations = small.poses()
    for points in (positions, positions + rotations @ box.tip):
        assert (points >= box.workspace_min).all() and (points <= box.workspace_max).all()
    assert np.linalg.norm(small.offsets(np.arange(0.0, DURATION_S, PERIOD))[0][:, 3:],
                          axis=1).max() > MIN_ROTATION_RAD


def test_too_little_room_is_refused_before_anything_moves():
    tight = Limits(workspace_min=[0.99, -0.01, 0.89], workspace_max=[1.21, 0.01, 1.01])
    with pytest.raises(MotionError, match='limits.workspace_m.* less than 6 deg of rotation'):
        continuous_plan(HOME, TIMING, PACE, tight)
    outside = HOME._replace(position=np.array([2.0, 0.0, 1.0]))
    with pytest.raises(MotionError, match='the start: the sensor would reach x = 2'):
        continuous_plan(outside, TIMING, PACE, LIMITS)
    with pytest.raises(MotionError, match='motion.backend'):
        continuous_plan(np.zeros(6), TIMING, PACE, LIMITS)


def test_a_stream_of_it_has_its_phases_and_ends_where_it_began():
    commands, phases = commanded()
    order = [phase for i, phase in enumerate(phases) if i == 0 or phases[i - 1] != phase]
    assert order == ['settle', 'measure', 'sweep', 'settle', 'measure', 'settle']
    assert phases.count('sweep') * PERIOD == pytest.approx(DURATION_S, abs=2 * PERIOD)
    np.testing.assert_array_equal(commands[-1].pose.position, HOME.position)


def test_its_preview_shows_path_and_outline(move):
    plan = continuous_plan(HOME, TIMING, PACE, LIMITS)
    speed, turning = move.peak_speeds
    said = outline(plan, LIMITS.tip)
    assert said.startswith(f'1 moves in {DURATION_S + 2 * TIMING.measure:.1f} s')
    assert f'{move.distance:.3g} m and' in said and move.distance > 0.5
    assert f'at most {speed:.3g} m/s and {turning:.3g} rad/s; ft_sensor stays within' in said
    assert len(path_of(plan)[0]) == pytest.approx(DURATION_S / 0.02, abs=2)
    target, _ = preview(plan, 1 / PERIOD, 0.3)
    assert np.abs(target.position - HOME.position).max() > 0.01


def test_gravity_moves_in_the_sensor_and_axes_are_uncorrelated(move):
    """A tenth of g along each horizontal axis, and no correlation above a third."""
    offset, _ = move.offsets(np.arange(0.0, DURATION_S, PERIOD))
    correlation = np.corrcoef(offset.T) - np.eye(6)
    assert np.abs(correlation).max() < 1 / 3
    _, R = move.poses()
    assert (R[:, 2, :].std(axis=0)[:2] > 0.1).all()


def test_the_parameter_chooses_it_for_calibrate_alone():
    value = {row.name: row.default for row in PARAMETERS}
    assert not settings_of(value).continuous
    chosen = value | {'motion.sequence': 'continuous'}
    assert settings_of(chosen).continuous
    assert not settings_of(chosen | {'sequence': 'contact'}).continuous


def test_inertial_force_is_bounded_before_the_first_command(move):
    peak = move.peak_acceleration_at(0.0)
    fastest = rates([move.at(t).pose for t in np.arange(0.0, DURATION_S, PERIOD)])[1]
    assert fastest <= peak * (1 + 1e-2)
    assert move.peak_acceleration_at(0.3) > peak
    assert MultiSine(HOME, 0.5, 0.5).peak_acceleration_at(0.0) < replace(
        MultiSine(HOME), rotation=0.5).peak_acceleration_at(0.0)
