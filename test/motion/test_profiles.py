"""Motion: the quintic, the stop that keeps to its path, limits that refuse with the number."""

from array import array

from forcecal_ros.core.errors import ConfigError, MotionError
from forcecal_ros.core.geometry import (
    quaternion_from_matrix,
    quaternion_of,
    rotation_from_vector,
    rotation_vector,
)
from forcecal_ros.core.parameters import section_of
from forcecal_ros.motion.limits import check_move, check_workspace, Limits
from forcecal_ros.motion.plan import (
    calibration_plan,
    check_wrench,
    contact_plan,
    expected_duration,
    prepare,
    Segment,
    Timing,
)
from forcecal_ros.motion.profiles import (
    anchor,
    flatten_poses,
    JointMove,
    Move,
    nominal_poses,
    orientation,
    Pace,
    peak_rates,
    Pose,
    quintic,
    read_poses,
    shortest_duration,
    step_goal,
    stop_time,
)
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

HOME = nominal_poses()['v']
LIMITS = Limits()
REST = np.array([4, -3, -119.5, 1.6, -4, 0.1])
PERIOD = 0.004


def nominal_plan(timing=Timing()):
    poses = nominal_poses()
    return calibration_plan(poses, step_goal(HOME, timing.step_distance), timing)


def sampled(move, period=PERIOD):
    times = np.arange(0.0, move.duration + 2 * period, period)
    return [move.at(t) for t in times]


def vectors(limit):
    return st.tuples(*[st.floats(-limit, limit)] * 3).map(np.array)


@settings(max_examples=25, deadline=None)
@given(vectors(0.3), vectors(1.0), st.floats(0.2, 5.0))
def test_velocities_are_the_derivative_of_the_poses(line, turn, duration):
    goal = Pose(HOME.position + line, HOME.R_base_sensor @ rotation_from_vector(turn))
    move = Move(HOME, goal, duration)
    for t in np.linspace(0.01, 0.99, 7) * duration:
        dt = 1e-5 * duration
        before, here, after = (move.at(t + d) for d in (-dt, 0.0, dt))
        np.testing.assert_allclose((after.pose.position - before.pose.position) / (2 * dt),
                                   here.velocity, atol=1e-6)
        spin = rotation_vector(after.pose.R_base_sensor @ before.pose.R_base_sensor.T)
        np.testing.assert_allclose(spin / (2 * dt), here.angular_velocity, atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(vectors(0.3), vectors(1.0))
def test_orientation_goes_along_the_geodesic_and_arrives(line, turn):
    goal = Pose(HOME.position + line, HOME.R_base_sensor @ rotation_from_vector(turn))
    move = Move(HOME, goal, 1.0)
    middle = move.at(0.5).pose
    np.testing.assert_allclose(
        rotation_vector(HOME.R_base_sensor.T @ middle.R_base_sensor), turn / 2, atol=1e-9)
    np.testing.assert_array_equal(move.at(1.0).pose.position, goal.position)
    np.testing.assert_array_equal(move.at(1.0).pose.R_base_sensor, goal.R_base_sensor)
    assert not move.at(1.0).moving


def test_half_a_turn_is_refused_because_noise_would_choose_the_way():
    goal = Pose(HOME.position, HOME.R_base_sensor @ rotation_from_vector([0, 0, np.pi]))
    with pytest.raises(MotionError, match='180.0 deg is too close to half a turn'):
        check_move(Move(HOME, goal, 5.0), LIMITS)


@settings(max_examples=25, deadline=None)
@given(vectors(0.2), vectors(1.5))
def test_shortest_duration_keeps_to_the_pace(line, turn):
    goal = Pose(HOME.position + line, HOME.R_base_sensor @ rotation_from_vector(turn))
    pace = Pace()
    move = Move(HOME, goal, shortest_duration(HOME, goal, pace))
    points = sampled(move)
    velocity = np.array([p.velocity for p in points])
    spin = np.array([p.angular_velocity for p in points])
    rounding = 1 + 1e-9
    assert np.linalg.norm(velocity, axis=1).max() <= pace.speed * rounding
    assert np.linalg.norm(spin, axis=1).max() <= pace.angular_speed * rounding
    acceleration = np.diff(velocity, axis=0) / PERIOD
    assert np.linalg.norm(acceleration, axis=1).max() <= pace.acceleration * rounding
    acceleration = np.diff(spin, axis=0) / PERIOD
    assert np.linalg.norm(acceleration, axis=1).max() <= pace.angular_acceleration * rounding


def test_a_joint_that_is_too_fast_is_refused_by_its_number():
    move = JointMove(np.zeros(6), np.array([0, 0.1, -2.0, 0, 0, 0]), 1.0)
    with pytest.raises(MotionError, match='3.75 rad/s of joint 3, limits.joint_speed is 1.5'):
        check_move(move, LIMITS, 'to h')


STEP = Move(HOME, step_goal(HOME, 0.01), 0.1)
FAR = Pose(HOME.position + [0.15, 0, 0], HOME.R_base_sensor)


@pytest.mark.parametrize('move, change, why', [
    (STEP, {'speed': 0.15}, r'it needs 0.1875 m/s, limits.speed is 0.15'),
    (STEP, {'speed': 0.19, 'acceleration': 6.4}, r' m/s\^2, limits.acceleration is 6.4'),
    (STEP, {'jerk': 800.0}, r' m/s\^3, limits.jerk is 800'),
    (Move(HOME, nominal_poses()['h'], 1.0), {},
     'it needs 2.945 rad/s, limits.angular_speed is 1.5'),
    (Move(HOME, FAR, 2.0), {}, 'the tip would reach x = 1.35 m')])
def test_a_move_beyond_a_limit_is_refused_with_number_and_key(move, change, why):
    with pytest.raises(MotionError, match=why):
        check_move(move, Limits(**change), 'it')
    check_workspace(move.goal.position[None], LIMITS, 'the sensor alone')


def test_the_tip_is_checked_along_the_arc_and_not_at_its_ends_only():
    half = rotation_from_vector([0, 0, np.pi / 2])
    start, goal = (Pose(HOME.position, R @ HOME.R_base_sensor) for R in (half.T, half))
    pose = Pose(HOME.position, HOME.R_base_sensor)
    limits = Limits(workspace_max=[1.15, 0.4, 1.4])
    for legal in (start, goal):
        check_workspace((legal.position + legal.R_base_sensor @ limits.tip)[None], limits, '')
    for a, b in ((start, pose), (pose, goal)):
        with pytest.raises(MotionError, match='the tip'):
            check_move(Move(a, b, 3.0), limits)


def test_nan_never_passes_a_check():
    bad = Pose(np.array([np.nan, 0, 1]), HOME.R_base_sensor)
    with pytest.raises(MotionError):
        check_move(Move(HOME, bad, 1.0), LIMITS)
    with pytest.raises(MotionError):
        check_workspace(bad.position[None], LIMITS, 'it')
    with pytest.raises(MotionError):
        check_wrench([], np.full(6, np.nan), LIMITS)


def test_peaks_of_acceleration_and_jerk_are_those_of_the_commands_stops_included():
    duration, stop, dt = 0.4, 0.045, 1e-4
    _, acceleration, jerk = peak_rates(duration, stop)
    accelerations, jerks = [], []
    for begin in np.linspace(0.0, duration, 41):
        t = np.arange(0.0, stop, dt)
        s, _, _ = quintic((begin + stop * stop_time(t / stop)[0]) / duration)
        accelerations.append(np.abs(np.diff(s, 2)).max() / dt**2)
        jerks.append(np.abs(np.diff(s, 3)).max() / dt**3)
    assert acceleration == pytest.approx(max(accelerations), rel=0.02)
    assert jerk == pytest.approx(max(jerks), rel=0.03)


def test_inertia_of_a_turn_counts_towards_force_and_torque():
    plan = (Segment('move', 'to h', nominal_poses()['h'], 1.6),)
    parts = prepare(plan, HOME, Pace(), Limits(angular_speed=2.0, angular_acceleration=100.0,
                                               angular_jerk=9000.0))
    check_wrench(parts, REST, LIMITS)
    with pytest.raises(MotionError, match=r'move to h would add .* N of inertia'):
        check_wrench(parts, REST, Limits(force=130.0))
    with pytest.raises(MotionError, match=r'would add .* N m of inertia .* limits.torque is 6'):
        check_wrench(parts, REST, Limits(torque=6.0))


def test_limits_that_cannot_be_stopped_from_are_refused():
    with pytest.raises(ConfigError, match=r'limits.speed 1 stops within .* limits.acceleration'):
        Limits(speed=1.0)
    with pytest.raises(ConfigError, match='workspace_min'):
        Limits(workspace_min=[0, 0, 2.0])
    with pytest.raises(ConfigError, match='limits.tip is .* expected a list of 3 finite numbers'):
        Limits(tip=[0, np.nan, 0])
    with pytest.raises(ConfigError, match='3 finite numbers.*; edit the lines .* # SET'):
        section_of(Limits, {'limits.workspace_min': [np.nan] * 3}, 'limits')
    assert Limits(tip=array('d', [0.1, 0.0, 0.0])).tip.tolist() == [0.1, 0.0, 0.0]  # of rclpy


def test_default_plan_keeps_the_limits_and_takes_twelve_to_sixteen_seconds():
    parts = prepare(nominal_plan(), HOME, Pace(), LIMITS)
    check_wrench(parts, np.array([4, -3, -119.5, 1.6, -4, 0.1]), LIMITS)
    assert 12.0 < expected_duration(parts, 0.43) < 16.0
    words = [part.segment.phase for part in parts]
    assert words == ['move', 'settle', 'measure'] * 4 + ['move', 'settle'] + ['step'] * 4


def test_contact_plan_goes_where_it_says_and_comes_back():
    timing = Timing()
    plan = contact_plan(nominal_poses(), step_goal(HOME, timing.contact_distance), timing)
    with pytest.raises(MotionError, match='approach out: the tip would reach x = 1.28'):
        prepare(plan, HOME, Pace(), Limits(workspace_max=[1.25, 0.4, 1.4]))
    parts = prepare(plan, HOME, Pace(), LIMITS)
    assert [part.segment.phase for part in parts] == [
        'move', 'settle', 'measure', 'approach', 'contact', 'retract', 'settle']
    np.testing.assert_allclose(parts[4].goal.position, HOME.position + [0.086, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(parts[-1].goal.position, HOME.position)


def test_default_poses_span_gravity_well():
    poses = nominal_poses()
    gravity = np.array([pose.R_base_sensor.T @ [0, 0, -1] for pose in poses.values()])
    np.testing.assert_allclose(gravity[0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(gravity[1], [1, 0, 0], atol=1e-12)
    assert np.linalg.cond(gravity) < 4


def test_pose_h_is_the_matrix_printed_in_the_paper():
    a, d, theta = np.pi / 2, np.pi, 0.3
    sa, ca, sd, cd, s, c = np.sin(a), np.cos(a), np.sin(d), np.cos(d), np.sin(theta), np.cos(theta)
    printed = [[ca * c + sa * sd * s, -ca * s + sa * sd * c, sa * cd],
               [cd * s, cd * c, -sd],
               [-sa * c + ca * sd * s, sa * s + ca * sd * c, ca * cd]]
    np.testing.assert_allclose(orientation(a, d, theta), printed, atol=1e-15)


def test_a_plan_begins_where_the_robot_stands_and_each_part_where_the_last_ended():
    start = Pose(HOME.position + [0.01, -0.02, 0.0], HOME.R_base_sensor)
    parts = prepare(nominal_plan(), start, Pace(), LIMITS)
    here = start
    for part in parts:
        if part.move is not None:
            assert part.move.start is here
        here = part.goal
    assert here.position == pytest.approx(HOME.position)


def test_a_robot_outside_the_box_is_not_started():
    start = Pose(np.array([0.3, 0.0, 0.5]), HOME.R_base_sensor)
    with pytest.raises(MotionError, match='the start: the sensor would reach x = 0.3 m'):
        prepare(nominal_plan(), start, Pace(), LIMITS)


def test_a_reading_near_the_limit_refuses_the_plan():
    parts = prepare(nominal_plan(), HOME, Pace(), LIMITS)
    heavy = np.array([0, 0, 200.0, 0, 0, 0])
    with pytest.raises(MotionError, match=r'step out would add 117.7 N .* limits.force is 250'):
        check_wrench(parts, heavy, LIMITS)
    with pytest.raises(MotionError, match='reads 70 N m at rest, limits.torque is 60'):
        check_wrench(parts, np.array([0, 0, 1, 0, 70.0, 0]), LIMITS)


def test_open_positions_are_filled_with_the_place():
    flat = flatten_poses(nominal_poses())
    flat[7:10] = [np.nan] * 3
    filled = anchor(read_poses(list(nominal_poses()), flat), np.array([1.1, 0.0, 0.9]))
    for name, pose in nominal_poses().items():
        np.testing.assert_allclose(filled[name].R_base_sensor, pose.R_base_sensor, atol=1e-12)
        np.testing.assert_array_equal(
            filled[name].position, [1.1, 0.0, 0.9] if name == 'h' else pose.position)


@pytest.mark.parametrize('names, flat, message', [
    (['v'], [1.0] * 6, 'got 6 numbers'),
    ([], [], '0 poses '),
    (['v', 'v'], [0.0, 0, 0, 1, 0, 0, 0] * 2, 'different'),
    (['v'], [0.0, 0, 0, 1, 1, 0, 0], 'norm 1.414'),
    (['v'], [0.0, 0, 0, np.nan, 1, 0, 0], 'norm nan'),
])
def test_malformed_poses_are_refused(names, flat, message):
    with pytest.raises(ConfigError, match=message):
        read_poses(names, flat)


def test_poses_and_joint_vectors_are_not_mixed():
    plan = calibration_plan({'v': HOME, 'h': np.zeros(6)}, HOME, Timing())
    with pytest.raises(MotionError, match='mixes poses and joint vectors'):
        prepare(plan, HOME, Pace(), LIMITS)


@settings(max_examples=25, deadline=None)
@given(vectors(3.14159), st.sampled_from([1.0, 1e-4, 1e-9]))
def test_the_quick_quaternion_is_that_of_the_matrix(turn, size):
    for R in (rotation_from_vector(turn * size), HOME.R_base_sensor @ rotation_from_vector(turn)):
        quick, exact = np.array(quaternion_of(R)), quaternion_from_matrix(R)
        assert np.linalg.norm(quick) == pytest.approx(1.0, abs=1e-15)
        assert min(np.abs(quick - exact).max(), np.abs(quick + exact).max()) < 1e-12
