"""A calibration of a simulated rig that never rests, and what is refused."""

from dataclasses import replace

from changed import later, with_values
from forcecal_ros.calibrate.joint import require_tool
from forcecal_ros.calibrate.pipeline import calibrate_by_motion, fit_motion, identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.io.bags import write_recording
from forcecal_ros.io.calibration_file import load
from forcecal_ros.motion.continuous import MultiSine
from forcecal_ros.motion.profiles import nominal_poses
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
from longer import first
from moving_arm import BIAS, COM, MASS
from moving_arm import moving as moving_arm
import numpy as np
import pytest
from wrong_recordings import recording_of

RIG = load_rig()


def shortened(recording, start, end):
    """Return the part of a recording between two times."""
    return replace(recording, contact_truth=None, **{
        name: getattr(recording, name).between(start, end)
        for name in ('wrench', 'accelerometer', 'optidrive', 'pose', 'target')})


def run(seed, turns=(1.0, 1.0, 1.0), translation=0.47):
    """Simulate 20 s of the multi-sine; `turns` scales the rotations about the axes."""
    move, t = MultiSine(nominal_poses()['v'], translation, 0.9, 20.0), np.arange(0.0, 20.0, 0.004)
    offset, _ = move.offsets(t)
    return simulate(RIG, PoseStream(t, move.start.position + offset[:, :3], (
        move.start.R_base_sensor @ rotation_from_vector(turns * offset[:, 3:]))), seed=seed)


@pytest.fixture(scope='module')
def whole():
    return run(1)


@pytest.fixture(scope='module')
def moving(whole):
    return shortened(whole, 1.5, 18.5)


def fitted(recording, settings=IdentificationSettings()):
    """Fit a recording that is not checked."""
    fit = fit_motion(recording, settings)
    require_tool(fit, True, settings.largest_delay)
    return fit


def assert_nominal(calibration):
    assert float(calibration.mass) == pytest.approx(RIG.tool.mass, rel=2e-3)
    np.testing.assert_allclose(calibration.com.value, RIG.tool.com, atol=1e-3)
    assert calibration.quality['method'] == 'motion'


@pytest.mark.parametrize('every', first([8, 1]))
def test_tool_of_a_rig_that_never_rests(moving, every):
    calibration = identify(replace(moving, wrench=moving.wrench.rows(slice(None, None, every))))
    assert_nominal(calibration)
    np.testing.assert_allclose(calibration.inertia.value, RIG.tool.inertia, atol=0.005)
    seen, true = calibration.accelerometer, RIG.accelerometer
    np.testing.assert_allclose(seen.gain.value, true.acc1.gain, rtol=1e-3)
    np.testing.assert_allclose(seen.offset.value, true.acc1.offset, atol=5e-3)
    np.testing.assert_allclose(seen.map.value, np.eye(3), atol=2e-3)
    np.testing.assert_allclose(seen.position.value, true.position, atol=1e-3)
    assert abs(float(seen.delay)) < 2e-4 and calibration.observer is None


def test_noise_of_the_pose_makes_no_tool_light():
    off = []
    for seed in range(4):
        found = fitted(recording_of(moving_arm(seed, turns=0.3)))
        truth = np.array([MASS, *(MASS * COM), *BIAS])
        keep = [0, 1, 2, 3, *range(10, 16)]
        off.append((found.theta[keep] - truth) / found.std[keep])
    # diluted by the noise, masses are light by 2.3 standard errors on average, biases as far off
    assert np.abs(np.mean(off, axis=0)).max() < 3.0 / np.sqrt(4)
    assert np.square(off).mean() < 2.0


def test_static_poses_of_one_orientation_leave_it_to_the_motion(whole):
    assert_nominal(identify(replace(whole, contact_truth=None)))


def test_contact_for_a_third_of_the_time(moving):
    pushes = ([0, 20, 30, 2, 0, 0], [15, -10, 20, 0, 2, 1], [0, 0, 40, -3, 1, 0])
    which = np.arange(len(moving.wrench)) * 9 // len(moving.wrench)
    push = np.choose(which[:, None] // 3, pushes) * (which % 3 == 1)[:, None]
    assert_nominal(identify(with_values(moving, lambda values: values + push)))


def test_without_positions_there_is_no_inertia(moving):
    place = np.full_like(moving.pose.position, np.nan)
    calibration = identify(replace(moving, pose=replace(moving.pose, position=place)))
    assert calibration.inertia is None
    assert any('no position' in one for one in calibration.quality['warnings'])
    assert float(calibration.mass) == pytest.approx(RIG.tool.mass, rel=0.02)


def test_rotation_about_one_axis_is_refused_by_name():
    recording = shortened(run(2, (0.0, 1.0, 0.0), 0.0), 1.5, 18.5)
    with pytest.raises(UnobservableError, match='rotates about only one axis, near its y.*x'):
        identify(recording)


def test_too_short_a_recording_is_refused(moving):
    with pytest.raises(UnobservableError, match='overlap for 4 s'):
        identify(shortened(moving, 2.0, 6.0))


@pytest.mark.parametrize('late', [-0.09, 0.028])
@pytest.mark.long
def test_a_delay_is_found(moving, late):
    delayed = later(moving, late)
    assert_nominal(identify(replace(delayed, accelerometer=None)))
    assert fitted(delayed).delay - fitted(moving).delay == pytest.approx(late, abs=1e-4)


def test_clocks_apart_are_refused(moving):
    with pytest.raises(DataError, match='at the search limit'):
        fitted(later(moving, 0.08), IdentificationSettings(largest_delay=0.05))


def test_forces_of_no_rigid_tool_are_refused(moving):
    noise = np.random.default_rng(3).normal(size=(34, 6))
    pushes = np.repeat(noise, len(moving.wrench) // 34 + 1, axis=0)[:len(moving.wrench)]
    with pytest.raises(UnobservableError, match='standard error of'):
        fitted(with_values(moving, lambda values: 50.0 * pushes))
    with pytest.raises(DataError, match='forces differ from those of a rigid tool'):
        fitted(with_values(moving, lambda values: values * [1, 1, -1, 1, 1, -1]))


def test_rotated_axes_make_the_estimates_suspect(moving):
    R = rotation_from_vector(np.array([0.1, 0.0, 0.2]))
    recording = with_values(moving, lambda values: values @ np.kron(np.eye(2), R))
    with pytest.raises(DataError, match='its axes are rotated'):
        identify(recording)
    settings = IdentificationSettings()
    quality = calibrate_by_motion(
        recording, settings, fitted(recording), None, 'it moves')['quality']
    assert 'mass' in quality['suspect'] and any('suspect: mass' in one for one in quality[
        'warnings'])


def test_opposite_sign_is_refused(moving):
    with pytest.raises(DataError, match='wrench-sign -1'):
        identify(with_values(moving, lambda values: -values))


def test_the_command_writes_a_calibration_that_the_observer_takes(moving, tmp_path, capsys):
    bag, file = str(tmp_path / 'bag'), str(tmp_path / 'calibration.yaml')
    write_recording(tmp_path / 'bag', replace(moving, **{
        name: getattr(moving, name).rows(slice(None, None, 4))
        for name in ('wrench', 'accelerometer', 'optidrive')}))
    assert main(['calibrate', bag, '-o', file, '--report', str(tmp_path / 'report.html')]) == 0
    shown = capsys.readouterr()
    assert 'residual force x in motion' in shown.out
    assert 'accelerometer gain' in shown.out
    assert 'Residual in motion' in (tmp_path / 'report.html').read_text()
    assert_nominal(load(file))
    assert main(['estimate', bag, '--calibration', file, '-o', str(tmp_path / 'out.csv')]) == 0
