"""What a reading is made of, the covariances, and what can be told apart."""

from dataclasses import replace

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.streams import Stream
from forcecal_ros.observe import design, FilterSettings, ObserverSettings
from forcecal_ros.observe.bandwidth import load_maps
from forcecal_ros.observe.bias_filter import (
    begin,
    gain_of,
    learn,
    paper_covariances,
    transition,
)
from forcecal_ros.observe.contact import tool_wrench
from forcecal_ros.observe.playback import white_noise, with_noise
from forcecal_ros.observe.sample import Unloaded
import gravity_arm as arm
import numpy as np
import pytest

ZERO = (0.0,) * 3


def learning(calibration, **choices):
    settings = ObserverSettings('ukf', learning=FilterSettings(**choices))
    return design(calibration, settings).bias_filter


def reading(t, measured):
    return Unloaded(t, 0, tuple(measured), ZERO * 2, ZERO)


@pytest.fixture(scope='module')
def calibration():
    return arm.calibrate(np.random.default_rng(3), seconds=0.2)[0]


@pytest.fixture(scope='module')
def model(calibration):
    return learning(calibration)


@pytest.mark.parametrize('contact, rank', [(True, 6), (False, 12)])
def test_a_wrench_that_returns_to_zero_is_separated_from_its_bias(model, contact, rank):
    A, H = transition(model, 1e-3, contact)[0], np.hstack([np.eye(6), np.eye(6)])
    rows = [H @ np.linalg.matrix_power(A, k) for k in range(12)]
    assert np.linalg.matrix_rank(np.vstack(rows)) == rank


def test_at_rest_the_weight_is_on_the_wire_as_rig_and_drivers_have_it(calibration):
    m, c = float(calibration.mass), calibration.com.value
    g = np.array([0.0, 0.0, 9.80665])
    assert tool_wrench(design(calibration).load, tuple(-g), ZERO, ZERO, 0.0) == pytest.approx(
        np.concatenate([m * g, np.cross(c, m * g)]))


def test_the_paper_s_covariances_are_those_it_prints():
    Q, R, P0, period = paper_covariances()
    assert Q.diagonal() == pytest.approx([0.01] * 3 + [0.001] * 3)
    assert R.diagonal() == pytest.approx([0.1] * 3 + [0.01] * 3)
    assert P0.diagonal() == pytest.approx([1.0] * 3 + [0.1] * 3)
    assert period == 0.001


def test_the_paper_s_r_taken_as_noise_gives_three_times_its_table(calibration):
    model = learning(calibration, covariances='paper', states=6)
    noise = np.sqrt(model.covariances.R.diagonal())
    rng = np.random.default_rng(4)
    belief, errors = begin(model), []
    for k in range(5000):
        belief, sample = learn(belief, reading(0.001 * k, noise * rng.normal(size=6)), model)
        errors.append(sample.contact)
    worst = np.abs(errors[100:]).max(axis=0)
    # gain 0.27: std 0.125 N, times the 4 sigma that 5000 samples reach
    assert worst[:3] == pytest.approx([0.5] * 3, abs=0.1)
    assert (worst[:2] > 2.5 * arm.TABLE[:2]).all()


def test_the_stationary_gain_gives_the_rise_time(model):
    belief = begin(model)
    for k in range(400):
        belief, _ = learn(belief, reading(0.001 * k, ZERO * 2), model)
    _, sample = learn(belief, reading(0.4, (50.0, 0, 0, 0, 0, 0)), model)
    assert sample.contact[0] / 50 == pytest.approx(
        gain_of(model.settings.rise_time, 0.001), rel=0.05)


def test_noise_of_the_load_is_that_of_drawn_accelerations(calibration):
    rng = np.random.default_rng(5)
    n, alpha_std = 40000, 0.3
    f = rng.multivariate_normal(np.zeros(3), calibration.noise.specific_force.value, n)
    alpha = alpha_std * rng.normal(size=(n, 3))
    m, c, J = float(calibration.mass), calibration.com.value, calibration.inertia.value
    force = -m * (f + np.cross(alpha, c - arm.IMU))
    drawn = np.cov(np.hstack([force, np.cross(c, force) - alpha @ J]).T)
    by_force, by_alpha = load_maps(calibration)
    expected = (by_force @ calibration.noise.specific_force.value @ by_force.T
                + alpha_std ** 2 * by_alpha @ by_alpha.T)
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
        learning(replace(calibration, noise=None))


def test_static_needs_no_noise(calibration):
    assert design(replace(calibration, noise=None), ObserverSettings('static')).weight_only


@pytest.mark.parametrize('wrong', [
    {'states': 8}, {'covariances': 'guess'}, {'rise_time': 0.0}, {'relaxation': float('nan')},
    {'bias_walk': (1.0,)}, {'contact_floor': (-1.0, 0.0)}, {'false_alarm': 1.0}])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ConfigError, match=f'gravity.{next(iter(wrong))}'):
        FilterSettings(**wrong)


def test_an_unknown_filter_is_refused():
    with pytest.raises(ConfigError, match=r"filter is 'pf', expected one of kalman, newton, ukf"):
        ObserverSettings('pf')
