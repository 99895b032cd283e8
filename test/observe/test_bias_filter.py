"""Filters ukf and ekf: covariances, bad samples, contact, biases; the errors that they state."""

from dataclasses import replace

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.streams import Stream
from forcecal_ros.observe import design, FilterSettings, ObserverSettings, Status
from forcecal_ros.observe.bias_filter import begin, learn, pair
from forcecal_ros.observe.gaussian import Gaussian
from forcecal_ros.observe.playback import with_noise
from forcecal_ros.observe.sample import Unloaded
import gravity_arm as arm
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.linalg import block_diag

DT = 0.001
ZERO = (0.0,) * 3
LOAD = (1.0, -2.0, 5.0, 0.1, 0.2, 0.0)
NUMBER = st.floats(-4e8, 4e8)


@pytest.fixture(scope='module')
def calibration():
    return arm.calibrate(np.random.default_rng(11), seconds=0.2)[0]


@pytest.fixture(scope='module')
def model(calibration):
    return learning(calibration)


def learning(calibration, **choices):
    settings = ObserverSettings('ukf', learning=FilterSettings(**choices))
    return design(calibration, settings).bias_filter


def reading(t, measured, status=0):
    return Unloaded(t, status, tuple(measured), LOAD, ZERO)


def run(model, contact, rng=None, belief=None, bias=0.0):
    """Feed noise, bias and a contact (n, 6), a millisecond apart; return belief and samples."""
    belief = belief or begin(model)
    noise = np.zeros_like(contact) if rng is None else rng.multivariate_normal(
        np.zeros(6), model.R, len(contact))
    start = belief.t if belief.t == belief.t else 0.0
    samples = []
    for k, row in enumerate(contact + noise + bias, 1):
        belief, sample = learn(belief, reading(start + k * DT, row), model)
        samples.append(sample)
    return belief, samples


def wrenches(samples):
    return np.array([s.contact for s in samples])


def touching(samples):
    return [s.learned.touching for s in samples]


def pushed(n, at, force, axis=0):
    contact = np.zeros((n, 6))
    contact[at:, axis] = force
    return contact


@pytest.mark.filterwarnings('error')
@given(measured=st.lists(NUMBER, min_size=6, max_size=6), t=st.floats(1e-7, 1e300))
@example(measured=[4e8] * 6, t=1e300)
@example(measured=[1.0] * 6, t=1e-7)
@settings(max_examples=60, deadline=None)
def test_no_sample_makes_the_filter_raise_or_lose_its_numbers(model, measured, t):
    belief, _ = learn(begin(model), reading(0.0, ZERO * 2), model)
    _, sample = learn(belief, reading(t, measured), model)
    assert np.isfinite(sample.contact).all()
    assert sample.status in (0, Status.RESTARTED)


def test_a_covariance_that_broke_starts_the_filter_anew(model):
    broken = begin(model)._replace(t=0.0, states=Gaussian(np.zeros(12), np.full((12, 12), np.nan)))
    belief, sample = learn(broken, reading(DT, ZERO * 2), model)
    assert sample.status == Status.RESTARTED
    assert np.isfinite(belief.states.cov).all()


@pytest.mark.parametrize('status', [Status.BAD_WRENCH, Status.NO_GRAVITY])
def test_a_wrench_without_a_load_is_skipped_and_its_time_is_made_up(model, status):
    belief, before = run(model, np.zeros((50, 6)), np.random.default_rng(1))
    again, sample = learn(belief, reading(0.051, ZERO * 2, int(status)), model)
    assert again is belief
    assert sample.status == status
    assert sample.contact == before[-1].contact
    assert sample.innovation == (0.0,) * 6
    assert learn(again, reading(0.052, ZERO * 2), model)[0].t == 0.052


@pytest.mark.parametrize('size', [0.5, 100.0])
@pytest.mark.parametrize('axis', [0, 4])
def test_a_step_of_force_rises_within_15_ms(model, size, axis):
    force = size * (1.0 if axis < 3 else 0.06)
    rng = np.random.default_rng(2)
    belief, _ = run(model, np.zeros((500, 6)), rng)
    _, with_step = run(model, pushed(300, 100, force, axis), np.random.default_rng(3), belief)
    _, without = run(model, np.zeros((300, 6)), np.random.default_rng(3), belief)
    response = (wrenches(with_step) - wrenches(without))[100:, axis] / force
    rise = np.argmax(response > 0.9) - np.argmax(response > 0.1)
    assert rise <= 15
    assert response.max() < 1.05
    assert response[150:].mean() == pytest.approx(1.0, abs=0.01)


@pytest.mark.long
def test_in_contact_the_biases_are_frozen_and_grow_less_certain(model):
    belief, _ = run(model, np.zeros((500, 6)), np.random.default_rng(5))
    _, samples = run(model, pushed(3000, 0, 5.0), np.random.default_rng(6), belief)
    first, last = samples[1].learned, samples[-1].learned
    assert all(touching(samples))
    assert (last.bias == first.bias).all()
    assert (last.bias_std > first.bias_std).all()
    assert wrenches(samples)[200:, 0].mean() == pytest.approx(5.0, abs=0.02)


def test_contact_ends_after_the_quiet_that_was_asked_for(model):
    contact = np.zeros((3000, 6))
    contact[500:1000, 1] = 4.0
    _, samples = run(model, contact, np.random.default_rng(7))
    assumed = np.flatnonzero(touching(samples))
    assert assumed[0] == 500
    # the average over 0.1 s has to fade below the limit first
    assert 1000 + 200 <= assumed[-1] < 1000 + 200 + 400


@pytest.mark.long
def test_a_push_too_weak_for_the_test_is_read_short_and_becomes_a_bias(calibration):
    usual = learning(calibration)
    model = usual._replace(walk=block_diag(usual.walk[:6, :6], pair(4e-3, 4e-4)))
    _, samples = run(model, pushed(5500, 500, 0.05))
    assert not any(touching(samples))
    x = wrenches(samples)[500:, 0] / 0.05
    assert x[100:200].mean() == pytest.approx(0.92, abs=0.03)
    assert x[-1] < 0.8


@pytest.mark.long
def test_the_errors_are_as_large_as_the_filter_says_for_a_wrench_that_wanders(calibration):
    # in contact from the start, all as modelled: a random walk; b from its prior
    model = learning(calibration, bias_prior=(0.1, 0.01))
    rng, runs, errors = np.random.default_rng(9), 60, []
    Q = model.walk[:6, :6] * DT
    for _ in range(runs):
        walk = np.cumsum(rng.multivariate_normal(np.zeros(6), Q, 60), axis=0)
        contact = walk + rng.choice([-1, 1], 6) * [3, 3, 3, 0.2, 0.2, 0.2]
        bias = np.array([0.1] * 3 + [0.01] * 3) * rng.normal(size=6)
        _, samples = run(model, contact, rng, bias=bias)
        last = samples[-1]
        assert last.learned.touching
        errors.append((last.contact - contact[-1]) / last.learned.std)
    assert np.square(errors).mean(axis=0) == pytest.approx(
        np.ones(6), abs=4 * np.sqrt(2 / runs))


def test_a_calibration_without_noise_takes_it_from_a_recording(calibration):
    rng = np.random.default_rng(7)
    recording = arm.record(arm.free_motion(rng, 4.0), rng)
    found = with_noise(replace(calibration, noise=None), recording).noise
    truth = [arm.FORCE_NOISE] * 3 + [arm.TORQUE_NOISE] * 3
    assert np.sqrt(found.wrench.value.diagonal()) == pytest.approx(truth, rel=0.06)
    assert np.sqrt(found.specific_force.value.diagonal()) == pytest.approx(
        [arm.ACCELERATION_NOISE] * 3, rel=0.06)
    assert found.wrench_rate == pytest.approx(1000)
    with pytest.raises(DataError, match='99 samples are too few to estimate'):
        with_noise(replace(calibration, noise=None), replace(recording, wrench=Stream(
            recording.wrench.t[:99], recording.wrench.values[:99])))


def test_missing_noise_is_an_error_that_says_what_to_do(calibration):
    with pytest.raises(ConfigError, match='R is unknown; calibrate again'):
        learning(replace(calibration, noise=None))


@pytest.mark.parametrize('wrong', [
    {'rise_time': 0.0}, {'rise_time': float('nan')}, {'bias_prior': (1.0,)},
    {'contact_floor': (-1.0, 0.0)}])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ConfigError, match=f'gravity.{next(iter(wrong))}'):
        FilterSettings(**wrong)
