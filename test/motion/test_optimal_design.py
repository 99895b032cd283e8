"""Designed calibrations: what they promise is what the identification finds, within the limits."""

from dataclasses import replace

from calibration_runs import run
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.io.calibration_file import dump, parse
from forcecal_ros.motion.limits import Limits, pace_within
from forcecal_ros.motion.optimal_design import (
    at_rest,
    d_optimality,
    design_calibration,
    errors_of,
    GROUPS,
    in_motion,
    Planner,
    Robot,
    sensors_of,
    step_within,
    TOOL,
)
from forcecal_ros.motion.plan import calibration_plan, prepare, Timing
from forcecal_ros.motion.profiles import Move, nominal_poses, reach_of, step_goal
from forcecal_ros.nodes.sequencer import PARAMETERS, settings_of
from forcecal_ros.sim.rig.file import expected_sensors, load_rig
import numpy as np
import pytest
import yaml

HOME = nominal_poses()['v']
SENSORS = expected_sensors(load_rig())


@pytest.fixture(scope='module')
def recording():
    return run(seed=1)


@pytest.fixture(scope='module')
def calibration(recording):
    return identify(recording)


def default_errors():
    poses = nominal_poses()
    return Planner(Robot(HOME), SENSORS, list(poses.values()), Timing(), 30.0).errors(
        range(len(poses)), Timing().measure)


def test_predicted_standard_errors_are_those_of_the_identification_or_larger(calibration):
    """Motion adds to static poses; standard errors of 40 blocks scatter by a fifth."""
    errors, found = default_errors(), calibration
    for name, std in (('mass', found.mass.std), ('com', found.com.std),
                      ('force bias', found.wrench_bias.std[:3]),
                      ('torque bias', found.wrench_bias.std[3:]),
                      ('offset', found.accelerometer.offset.std),
                      ('gain', found.accelerometer.gain.std)):
        assert (std < 1.5 * errors.std(name)).all(), name
        assert np.max(std / errors.std(name)) > 0.3, name


def test_the_default_sequence_finds_offsets_within_half_a_millivolt_by_three_sigma(calibration):
    assert default_errors().std('offset').max() < 0.5e-3 / 3
    truth = load_rig().accelerometer.acc1.offset
    assert np.abs(calibration.accelerometer.offset.value - truth).max() < 0.5e-3


def test_information_adds_up():
    a, b = (at_rest(pose.R_base_sensor, SENSORS) for pose in (HOME, nominal_poses()['h']))
    there = in_motion(Move(HOME, nominal_poses()['h'], 2.0), SENSORS)
    assert not there[:TOOL, :TOOL].any() and np.linalg.eigvalsh(there[TOOL:, TOOL:])[0] > -1e-6
    before, after = (errors_of(one, SENSORS) for one in (a + b + there, a + 2 * b + there))
    assert all((after.std(name) < 1.000001 * before.std(name)).all() for name in before.names)


def require_kept(poses, timing, pace, limits, duration):
    """Check that a sequence from its first pose keeps limits, time [s] and a tilt of 100 deg."""
    home = next(iter(poses.values()))
    plan = calibration_plan(poses, step_goal(home, timing.step_distance), timing)
    parts = prepare(plan, home, pace, limits)
    assert sum(part.duration or 0.5 for part in parts) <= duration
    for pose in poses.values():
        cosine = (np.trace(home.R_base_sensor.T @ pose.R_base_sensor) - 1) / 2
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 100.001


def test_a_design_keeps_time_tilt_and_limits_and_is_better_than_the_default():
    design = design_calibration(Robot(HOME), SENSORS, 16.0)
    require_kept(design.poses, design.timing, design.robot.pace, Limits(), 16.0)
    np.testing.assert_array_equal(design.poses['home'].position, HOME.position)
    assert d_optimality(design.errors) < d_optimality(default_errors())


def test_a_slow_robot_gets_a_slow_pace_and_a_short_step():
    limits = Limits(speed=0.05, acceleration=2.0, jerk=300.0, angular_speed=1.0)
    pace, timing = pace_within(limits), step_within(Robot(HOME, limits), Timing())
    assert pace.angular_speed < 1.0 and 0.0 < timing.step_distance < 0.005
    prepare(calibration_plan(nominal_poses(), step_goal(HOME, timing.step_distance), timing),
            HOME, pace, limits)


def test_what_does_not_fit_is_refused_by_its_reason():
    with pytest.raises(MotionError, match='three poses do not fit into 6 s'):
        design_calibration(Robot(HOME), SENSORS, 6.0)
    low = Limits(workspace_min=(0.95, -0.05, 0.85), workspace_max=(1.25, 0.05, 1.05))
    with pytest.raises(MotionError, match='within the limits: .*limits.workspace_m'):
        design_calibration(Robot(HOME, low), SENSORS, 16.0)


def test_sensors_come_from_a_calibration(calibration):
    found = sensors_of(parse(dump(calibration)))
    assert found.mass == pytest.approx(13.0, rel=1e-3)
    assert found.force == pytest.approx(SENSORS.force, rel=0.25)
    assert found.torque == pytest.approx(SENSORS.torque, rel=0.25)
    assert found.volts == pytest.approx(SENSORS.volts, rel=0.25)
    with pytest.raises(DataError, match='has no noise'):
        sensors_of(replace(calibration, noise=None))


def test_home_and_box_come_from_a_recording(recording):
    tip = np.array([0.2, 0.0, 0.1])
    home, lower, upper = reach_of(recording, tip)
    assert np.abs(home.position - HOME.position).max() < 1e-3
    corner = HOME.position + HOME.R_base_sensor @ tip
    assert (lower <= corner + 1e-3).all() and (upper >= corner - 1e-3).all()
    with pytest.raises(DataError, match='--home'):
        reach_of(replace(recording, pose=None), tip)


def test_the_command_writes_a_plan_within_time_tilt_and_limits_for_the_sequencer(
        tmp_path, capsys):
    path = tmp_path / 'plan.yaml'
    assert main(['plan', '--for', 'calibration', '--duration', '14',
                 '--home', *'0.9 0 1 1 0 0 0'.split(), '--set', 'limits.angular_speed=1.2',
                 '-o', str(path)]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in GROUPS)
    given = yaml.safe_load(path.read_text())['/**/sequencer']['ros__parameters']
    flat = {f'{group}.{name}': value for group, rows in given.items() if isinstance(rows, dict)
            for name, value in rows.items()}
    settings = settings_of({**{row.name: row.default for row in PARAMETERS}, **flat,
                            'sequence': given['sequence']})
    assert settings.sequence == 'calibrate' and settings.limits.angular_speed == 1.2
    assert settings.pace.angular_speed <= 1.2
    home = next(iter(settings.poses.values()))
    np.testing.assert_allclose(home.position, [0.9, 0.0, 1.0])
    require_kept(settings.poses, settings.timing, settings.pace, settings.limits, 14.0)


@pytest.mark.parametrize('arguments, said', [
    (['--effects', 'wrench_dely'], 'did you mean wrench_delay?'),
    (['--for', 'calibration', '--contact'], '--contact is not used by --for calibration'),
    (['--tilt', '30'], '--tilt is not used by --for diagnosis'),
    (['--set', 'limits.sped=1'], 'did you mean limits.speed?'),
    (['--set', 'limits.tip=1'], 'expected 3 comma-separated numbers'),
    (['--set', 'timing.measure=1'], 'set only limits')])
def test_wrong_usage_is_named(arguments, said, capsys):
    status = None
    try:
        status = main(['plan', *arguments])
    except SystemExit as end:
        status = end.code
    assert status == 2 and said in capsys.readouterr().err
