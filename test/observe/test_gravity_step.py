"""The step: bad samples, contact, biases; what the filter claims about itself."""

from forcecal_ros.gravity import (
    describe,
    Imu,
    initial_state,
    model_from_calibration,
    pose_free_model,
    pose_free_step,
    PoseFreeState,
    Settings,
    State,
    step,
)
from forcecal_ros.observe.filters.bias_filter import (
    BAD_PERIOD,
    BAD_WRENCH,
    NO_ACCELEROMETER,
    NO_GYRO,
    NO_LOAD,
    RESTARTED,
)
from forcecal_ros.observe.filters.gaussian import Gaussian
import gravity_arm as arm
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.stats import chi2

DT = 0.001
KINDS = {'ukf': Settings(), 'ekf': Settings(filter='ekf'), 'static': Settings(filter='static'),
         'six': Settings(states=6)}
NUMBER = st.floats(allow_nan=True, allow_infinity=True)


@pytest.fixture(scope='module')
def calibration():
    return arm.calibrate(np.random.default_rng(11), seconds=0.2)[0]


@pytest.fixture(scope='module')
def models(calibration):
    return {name: model_from_calibration(calibration, choice) for name, choice in KINDS.items()}


@pytest.fixture(scope='module')
def model(models):
    return models['ukf']


@pytest.fixture(scope='module')
def pose_free(calibration):
    return pose_free_model(calibration, imu=Imu(gyro_std=arm.GYRO_NOISE))


def run(model, contact, rng=None, state=None, bias=0.0):
    """Feed noise, bias and a contact (n, 6) on top of a load; return state and estimates."""
    state = state or initial_state(model)
    load = np.array([1.0, -2.0, 5.0, 0.1, 0.2, 0.0])
    noise = np.zeros_like(contact) if rng is None else rng.multivariate_normal(
        np.zeros(6), model.covariances.R, len(contact))
    estimates = []
    for row in contact + noise + load + model.bias + bias:
        state, estimate = step(state, row, load, DT, model)
        estimates.append(estimate)
    return state, estimates


def wrenches(estimates):
    return np.array([e.wrench for e in estimates])


def pushed(n, at, force, axis=0):
    contact = np.zeros((n, 6))
    contact[at:, axis] = force
    return contact


@pytest.mark.filterwarnings('error')
@given(wrench=st.lists(NUMBER, min_size=6, max_size=6),
       load=st.none() | st.lists(NUMBER, min_size=6, max_size=6), dt=NUMBER)
@example(wrench=[9e5] * 6, load=[-9e5] * 6, dt=1e300)
@example(wrench=[1.0] * 6, load=[0.0] * 6, dt=5e-324)
@settings(max_examples=60, deadline=None)
@pytest.mark.parametrize('kind', KINDS)
def test_no_sample_makes_the_step_raise_or_lose_its_numbers(models, kind, wrench, load, dt):
    model = models[kind]
    before = initial_state(model)
    after, estimate = step(before, wrench, load, dt, model)
    assert np.isfinite(estimate.wrench).all()
    bad = (not np.isfinite(wrench).all(), not (np.isfinite(dt) and dt > 0),
           load is None or not np.isfinite(load).all())
    for wrong, bit in zip(bad, (BAD_WRENCH, BAD_PERIOD, NO_LOAD)):
        if wrong:
            assert estimate.status & bit and after is before
    assert len(describe(estimate.status)) == estimate.status.bit_count()


@pytest.mark.filterwarnings('error')
@given(wrench=st.lists(NUMBER, min_size=6, max_size=6),
       force=st.none() | st.lists(NUMBER, min_size=3, max_size=3),
       omega=st.none() | st.lists(NUMBER, min_size=3, max_size=3), dt=NUMBER)
@example(wrench=[0.0] * 6, force=[0.0] * 3, omega=[9e5] * 3, dt=10.0)
@settings(max_examples=60, deadline=None)
def test_no_sample_makes_the_pose_free_step_raise(pose_free, wrench, force, omega, dt):
    model = pose_free
    state, _ = pose_free_step(PoseFreeState(), model.wrench.bias, [0.0, 0.0, 9.8], [0.0] * 3, DT,
                              model)
    after, estimate = pose_free_step(state, wrench, force, omega, dt, model)
    good = (np.abs(wrench) < 1e6).all() and np.isfinite(dt) and dt > 0
    if not good:
        assert after is state and estimate.contact.status & (BAD_WRENCH | BAD_PERIOD)
    elif force is None:
        assert estimate.contact.status & NO_ACCELEROMETER
    elif omega is None:
        assert estimate.contact.status & NO_GYRO


def test_a_wrong_number_of_numbers_is_a_bad_wrench(model):
    state = initial_state(model)
    assert step(state, [1.0] * 5, [0.0] * 6, DT, model)[1].status == BAD_WRENCH


def test_a_covariance_that_broke_starts_the_filter_anew(model):
    broken = State(Gaussian(np.zeros(12), np.full((12, 12), np.nan)), initial_state(model).contact)
    state, estimate = step(broken, model.bias, np.zeros(6), DT, model)
    assert estimate.status == RESTARTED
    assert np.isfinite(state.belief.cov).all()


def test_a_bad_sample_in_between_is_skipped_and_repeated(model):
    state, before = run(model, np.zeros((50, 6)), np.random.default_rng(1))
    again, estimate = step(state, [np.nan] * 6, [0.0] * 6, DT, model)
    assert again is state
    assert (estimate.wrench == before[-1].wrench).all()


@pytest.mark.parametrize('size', [0.5, 1.0, 10.0, 100.0])
@pytest.mark.parametrize('axis', [0, 2, 4])
def test_a_step_of_force_rises_within_15_ms(model, size, axis):
    force = size * (1.0 if axis < 3 else 0.06)
    rng = np.random.default_rng(2)
    state, _ = run(model, np.zeros((500, 6)), rng)
    _, with_step = run(model, pushed(300, 100, force, axis), np.random.default_rng(3), state)
    _, without = run(model, np.zeros((300, 6)), np.random.default_rng(3), state)
    response = (wrenches(with_step) - wrenches(without))[100:, axis] / force
    rise = np.argmax(response > 0.9) - np.argmax(response > 0.1)
    assert rise <= 15
    assert response.max() < 1.05
    assert response[150:].mean() == pytest.approx(1.0, abs=0.01)


def test_while_free_the_biases_learn(calibration):
    model = model_from_calibration(calibration, Settings(bias_prior=(0.3, 0.02)))
    moved = np.array([0.25, -0.2, 0.1, 0.01, -0.01, 0.02])
    _, estimates = run(model, np.zeros((6000, 6)), np.random.default_rng(4), bias=moved)
    last = estimates[-1]
    assert (np.abs(last.bias - model.bias - moved) < 4 * last.bias_std).all()
    assert (last.bias_std < [0.02] * 3 + [0.002] * 3).all()
    assert not any(e.contact for e in estimates)


def test_in_contact_the_biases_are_frozen_and_grow_less_certain(model):
    state, _ = run(model, np.zeros((500, 6)), np.random.default_rng(5))
    _, estimates = run(model, pushed(3000, 0, 5.0), np.random.default_rng(6), state)
    first, last = estimates[1], estimates[-1]
    assert all(e.contact for e in estimates)
    assert (last.bias == first.bias).all()
    assert (last.bias_std > first.bias_std).all()
    assert wrenches(estimates)[200:, 0].mean() == pytest.approx(5.0, abs=0.02)


def test_contact_ends_after_the_quiet_that_was_asked_for(model):
    contact = np.zeros((3000, 6))
    contact[500:1000, 1] = 4.0
    _, estimates = run(model, contact, np.random.default_rng(7))
    assumed = np.flatnonzero([e.contact for e in estimates])
    assert assumed[0] == 500
    # the average over 0.1 s has to fade below the limit first
    assert 1000 + 200 <= assumed[-1] < 1000 + 200 + 400


def test_a_push_too_weak_for_the_test_is_read_short_and_becomes_a_bias(calibration):
    model = model_from_calibration(calibration, Settings(bias_walk=(4e-3, 4e-4)))
    _, estimates = run(model, pushed(5500, 500, 0.05))
    assert not any(e.contact for e in estimates)
    x = wrenches(estimates)[500:, 0] / 0.05
    assert x[100:200].mean() == pytest.approx(0.92, abs=0.03)
    assert x[-1] < 0.8


def test_wrench_and_bias_are_correlated_against_each_other(model):
    _, free = run(model, np.zeros((200, 6)))
    _, touched = run(model, pushed(200, 0, 5.0))
    for estimates in (free, touched):
        assert (estimates[-1].correlation < 0).all() and (estimates[-1].correlation > -1).all()


def test_a_bias_of_which_little_is_known_correlates_fully_in_contact(calibration):
    # from the start, a push too strong to be the bias that may have moved
    model = model_from_calibration(calibration, Settings(bias_prior=(0.3, 0.02)))
    _, estimates = run(model, pushed(100, 0, 20.0))
    assert (estimates[-1].correlation < -0.9).all()
    assert estimates[-1].wrench[0] == pytest.approx(20.0, abs=0.03)


def test_nis_keeps_to_its_bounds_where_all_is_as_modelled(model):
    _, estimates = run(model, np.zeros((8000, 6)), np.random.default_rng(8))
    nis = np.array([e.nis for e in estimates])
    low, high = chi2.ppf([0.005, 0.995], 6 * len(nis)) / len(nis)
    assert low < nis.mean() < high
    inside = ((nis > chi2.ppf(0.025, 6)) & (nis < chi2.ppf(0.975, 6))).mean()
    assert inside == pytest.approx(0.95, abs=4 * np.sqrt(0.05 * 0.95 / len(nis)))


def test_the_errors_are_as_large_as_the_filter_says_for_a_wrench_that_wanders(calibration):
    # in contact from the start, all as modelled: a random walk; b from its prior
    model = model_from_calibration(calibration, Settings(bias_prior=(0.1, 0.01)))
    rng, runs, errors = np.random.default_rng(9), 60, []
    Q = model.covariances.Q
    for _ in range(runs):
        walk = np.cumsum(rng.multivariate_normal(np.zeros(6), Q, 60), axis=0)
        contact = walk + rng.choice([-1, 1], 6) * [3, 3, 3, 0.2, 0.2, 0.2]
        bias = np.array([0.1] * 3 + [0.01] * 3) * rng.normal(size=6)
        _, estimates = run(model, contact, rng, bias=bias)
        assert estimates[-1].contact
        errors.append((estimates[-1].wrench - contact[-1]) / estimates[-1].std)
    assert np.square(errors).mean(axis=0) == pytest.approx(
        np.ones(6), abs=4 * np.sqrt(2 / runs))


def test_static_takes_weight_and_bias_off_and_filters_nothing(calibration):
    model = model_from_calibration(calibration, Settings(filter='static'))
    load, y = np.arange(6.0), np.array([3.0, 1, 4, 1, 5, 9])
    _, estimate = step(initial_state(model), y, load, DT, model)
    assert estimate.wrench == pytest.approx(y - load - model.bias)


def test_ukf_and_ekf_are_the_same_filter_here(calibration):
    contact = pushed(400, 200, 3.0)
    results = [wrenches(run(model_from_calibration(calibration, Settings(filter=name)), contact,
                            np.random.default_rng(10))[1]) for name in ('ukf', 'ekf')]
    assert results[0] == pytest.approx(results[1], abs=1e-9)


def test_six_states_keep_the_calibration_s_bias(calibration):
    model = model_from_calibration(calibration, Settings(states=6))
    _, estimates = run(model, np.zeros((300, 6)), np.random.default_rng(12))
    assert (estimates[-1].bias == model.bias).all()
    assert (estimates[-1].correlation == 0).all()


def test_a_silent_accelerometer_leaves_gravity_to_the_gyro(pose_free):
    model = pose_free
    rng = np.random.default_rng(13)
    motion = arm.free_motion(rng, 3.0)
    recording = arm.record(motion, rng)
    state = PoseFreeState()
    for k in range(3000):
        f = recording.accelerometer.values[k] if k < 1500 else None
        state, estimate = pose_free_step(
            state, recording.wrench.values[k], f, recording.angular_velocity.values[k], DT, model)
    g = motion.R_base_sensor[-1].T @ arm.G
    assert estimate.contact.status == NO_ACCELEROMETER
    assert (np.abs(estimate.gravity - g) < 4 * estimate.gravity_std).all()
    assert np.linalg.norm(estimate.gravity) == pytest.approx(9.80665)


def test_nothing_is_said_before_an_accelerometer_spoke(pose_free):
    model = pose_free
    state, estimate = pose_free_step(PoseFreeState(), model.wrench.bias, None, [0.0] * 3, DT,
                                     model)
    assert estimate.contact.status == NO_LOAD
    assert np.isnan(estimate.gravity).all()
    assert state == PoseFreeState()
