"""What a reading is made of, the covariances, and what can be told apart."""

from dataclasses import replace

from forcecal_ros.calibration.model import Estimate
from forcecal_ros.errors import ConfigError, DataError
from forcecal_ros.gravity import (
    initial_state,
    model_from_calibration,
    observability_rank,
    pose_free_model,
    Settings,
    step,
    weight,
)
from forcecal_ros.observe.filters.covariances import gain_of, load_noise, paper_covariances
from forcecal_ros.observe.filters.gaussian import Gaussian
from forcecal_ros.observe.filters.sigma_points import transform
from forcecal_ros.observe.noise import white_noise, with_noise
from forcecal_ros.observe.pose_free.model import Imu
from forcecal_ros.observe.pose_free.orientation import (
    exponential,
    Motion,
    readings,
    relevelled,
    start_pose_free,
    STATES,
)
from forcecal_ros.recording.streams import Stream
import gravity_arm as arm
import numpy as np
import pytest
from scipy.spatial.transform import Rotation


@pytest.fixture(scope='module')
def calibration():
    return arm.calibrate(np.random.default_rng(3), seconds=0.2)[0]


@pytest.fixture(scope='module')
def model(calibration):
    return model_from_calibration(calibration)


def test_two_free_random_walks_have_rank_6_of_12(model):
    assert observability_rank(model, 0.001, contact=True) == 6


def test_a_wrench_that_returns_to_nil_can_be_told_from_its_bias(model):
    assert observability_rank(model, 0.001, contact=False) == 12


def test_six_states_are_always_observable(calibration):
    six = model_from_calibration(calibration, Settings(states=6))
    assert observability_rank(six, 0.001, contact=True) == 6


def test_at_rest_the_weight_is_on_the_wire_as_rig_and_drivers_have_it(calibration, model):
    R = arm.resting(np.array([[0.0, 0.0, 1.0]]), 0.01).R_base_sensor[0]
    m, c = float(calibration.mass), calibration.com.value
    g = np.array([0.0, 0.0, 9.80665])
    assert weight(R, model) == pytest.approx(np.concatenate([m * g, np.cross(c, m * g)]))


def test_the_paper_s_covariances_are_those_it_prints():
    Q, R, P0, period = paper_covariances()
    assert Q.diagonal() == pytest.approx([0.01] * 3 + [0.001] * 3)
    assert R.diagonal() == pytest.approx([0.1] * 3 + [0.01] * 3)
    assert P0.diagonal() == pytest.approx([1.0] * 3 + [0.1] * 3)
    assert period == 0.001


def test_the_paper_s_r_taken_as_noise_gives_three_times_its_table(calibration):
    settings = Settings(covariances='paper', states=6)
    model = model_from_calibration(calibration, settings)
    noise = np.sqrt(model.covariances.R.diagonal())
    rng = np.random.default_rng(4)
    state, errors = initial_state(model), []
    for _ in range(5000):
        state, estimate = step(state, model.bias + noise * rng.normal(size=6), np.zeros(6),
                               0.001, model)
        errors.append(estimate.wrench)
    worst = np.abs(errors[100:]).max(axis=0)
    # gain 0.27: std 0.125 N, times the 4 sigma that 5000 samples reach
    assert worst[:3] == pytest.approx([0.5] * 3, abs=0.1)
    assert (worst[:2] > 2.5 * arm.TABLE[:2]).all()


def test_the_stationary_gain_gives_the_rise_time(model):
    state = initial_state(model)
    for _ in range(400):
        state, _ = step(state, model.bias, np.zeros(6), 0.001, model)
    state, estimate = step(state, model.bias + [50, 0, 0, 0, 0, 0], np.zeros(6), 0.001, model)
    assert estimate.wrench[0] / 50 == pytest.approx(
        gain_of(model.settings.rise_time, 0.001), rel=0.05)


def test_noise_of_the_load_is_that_of_drawn_accelerations(calibration):
    rng = np.random.default_rng(5)
    n, alpha_std = 40000, 0.3
    f = rng.multivariate_normal(np.zeros(3), calibration.noise.specific_force.value, n)
    alpha = alpha_std * rng.normal(size=(n, 3))
    m, c, J = float(calibration.mass), calibration.com.value, calibration.inertia.value
    force = -m * (f + np.cross(alpha, c - arm.IMU))
    drawn = np.cov(np.hstack([force, np.cross(c, force) - alpha @ J]).T)
    expected = load_noise(calibration, alpha_std)
    size = np.sqrt(expected.diagonal())
    assert (drawn - expected) / np.outer(size, size) == pytest.approx(
        np.zeros((6, 6)), abs=5 * np.sqrt(2 / n))


def test_white_noise_is_found_beneath_motion():
    rng = np.random.default_rng(6)
    t = np.arange(20000) / 1000
    noise = rng.normal(size=(len(t), 2)) * [0.05, 0.2]
    found = white_noise(Stream(t, noise + np.sin(2 * np.pi * t)[:, None]))
    assert np.sqrt(found.diagonal()) == pytest.approx([0.05, 0.2], rel=0.03)
    with pytest.raises(DataError, match='99 samples'):
        white_noise(Stream(t[:99], noise[:99]))


def test_a_calibration_without_noise_takes_it_from_a_recording(calibration):
    rng = np.random.default_rng(7)
    recording = arm.record(arm.free_motion(rng, 4.0), rng)
    found = with_noise(replace(calibration, noise=None), recording).noise
    truth = [arm.FORCE_NOISE] * 3 + [arm.TORQUE_NOISE] * 3
    assert np.sqrt(found.wrench.value.diagonal()) == pytest.approx(truth, rel=0.06)
    assert np.sqrt(found.specific_force.value.diagonal()) == pytest.approx(
        [arm.ACCELERATION_NOISE] * 3, rel=0.06)
    assert found.wrench_rate == pytest.approx(1000)


def test_missing_noise_is_an_error_that_says_what_to_do(calibration):
    with pytest.raises(ConfigError, match='covariances: paper'):
        model_from_calibration(replace(calibration, noise=None))


def test_static_needs_no_noise(calibration):
    model_from_calibration(replace(calibration, noise=None), Settings(filter='static'))


@pytest.mark.parametrize('wrong', [
    {'filter': 'pf'}, {'states': 8}, {'covariances': 'guess'}, {'rise_time': 0.0},
    {'relaxation': float('nan')}, {'bias_walk': (1.0,)}, {'contact_floor': (-1.0, 0.0)},
    {'false_alarm': 1.0}])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ConfigError, match=f'gravity.{next(iter(wrong))}'):
        Settings(**wrong)


def test_without_pose_the_calibration_needs_an_accelerometer_with_dc(calibration):
    coupled = replace(calibration.accelerometer, coupling='ac',
                      cutoff=Estimate(0.01, 0.0, 'Hz'))
    with pytest.raises(ConfigError, match='DC-coupled'):
        pose_free_model(replace(calibration, accelerometer=coupled))
    with pytest.raises(ConfigError, match='needs a pose'):
        pose_free_model(calibration, Settings(filter='static'))


@pytest.mark.parametrize('vector', [(0.0, 0.0, 0.0), (1e-12, 0, 0), (0.3, -0.2, 0.9), (3, 1, 0)])
def test_the_exponential_is_that_of_so3(vector):
    assert exponential(*vector) == pytest.approx(
        Rotation.from_rotvec(vector).as_matrix(), abs=1e-14)


def test_moving_the_tilt_into_the_frame_changes_no_gravity(calibration):
    model = pose_free_model(calibration)
    belief = start_pose_free(model, np.array([1.0, -2.0, 9.0]))
    mean = belief.states.mean.copy()
    mean[13:15] = 0.3, -0.5
    still = Motion(np.zeros(3), np.zeros(3))
    before = readings(belief.level, model, still).value(mean)
    after = relevelled(belief.level, Gaussian(mean.copy(), belief.states.cov))
    assert readings(after.level, model, still).value(after.states.mean) == pytest.approx(before)
    assert after.level.T @ after.level == pytest.approx(np.eye(3), abs=1e-12)


def pose_free_case(calibration, acceleration=0.0):
    """Return a belief with a poor orientation and an unknown payload, and its readings."""
    model = pose_free_model(calibration, imu=Imu(tilt_std=0.6, payload_std=0.15))
    level, states = start_pose_free(model, np.array([2.0, 1.0, 9.0]))
    mean, cov = states.mean.copy(), states.cov.copy()
    mean[15:18] = acceleration
    cov[12, 13] = cov[13, 12] = 0.5 * np.sqrt(cov[12, 12] * cov[13, 13])
    motion = Motion(np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -1.0]))
    return Gaussian(mean, cov), readings(level, model, motion)


def test_differences_and_jacobian_are_those_of_the_readings(calibration):
    a = np.array([0.5, -0.3, 0.2])
    belief, h = pose_free_case(calibration, a)
    mean, rng = belief.mean, np.random.default_rng(8)
    dx = 1e-2 * rng.normal(size=(20, STATES))
    value = np.array([h.value(mean + row) - h.value(mean) for row in dx])
    # what a heavier mass adds to the inertia is left out on purpose
    left_out = -dx[:, 12:13] * a
    value[:, :3] -= left_out
    value[:, 3:6] -= np.cross(calibration.com.value, left_out)
    assert h.difference(mean, dx) == pytest.approx(value, abs=1e-13)
    assert h.difference(mean, 1e-6 * dx) == pytest.approx(
        1e-6 * dx @ h.jacobian(mean).T, abs=1e-13)


def test_sigma_points_foretell_a_tilted_weight_better_than_the_jacobian(calibration):
    belief, h = pose_free_case(calibration)
    rng = np.random.default_rng(9)
    drawn = h.difference(belief.mean, rng.multivariate_normal(
        np.zeros(STATES), belief.cov, 100_000)).mean(axis=0)
    by_points = transform(belief, h).mean - h.value(belief.mean)
    # the Jacobian foretells no shift of the mean at all
    force = slice(0, 3)
    assert np.linalg.norm(by_points[force] - drawn[force]) < 0.25 * np.linalg.norm(drawn[force])
    assert np.linalg.norm(drawn[force]) > 1.0
