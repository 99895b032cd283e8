"""[Traversaro2014] equation by equation, against forms written out anew and other physics."""

from forcecal_ros.core.geometry import skew
from forcecal_ros.insitu import equations as eq
from forcecal_ros.insitu.blocks import Mounting, prepare, Prepared, to_blocks
from forcecal_ros.insitu.equations import (
    body_map,
    Load,
    STATIC,
)
from forcecal_ros.insitu.moments import accumulate, smooth, window_samples
from forcecal_ros.insitu.offset import offset_of, principal_basis
from hypothesis import given, settings
from hypothesis import strategies as st
import insitu_leg
from insitu_leg import GAUGES, Leg, OFFSET, record
from insitu_leg import Load as Added
from insitu_runs import chunks_of
import numpy as np
import pytest
from scipy.signal import savgol_filter

QUIET = Leg(noise=0.0)
ADDED = insitu_leg.PROTOCOL[1]


@pytest.fixture(scope='module')
def noisy():
    return record(ADDED, Leg(), 1)


def moments_of(log, window=1, kept=((-np.inf, np.inf),), corrected=True, magnitude=None):
    recording = prepare(chunks_of(log), Mounting(), False)
    blocks = to_blocks(recording)
    scale = 1.0 if corrected else 0.0
    return accumulate(recording, kept, window, 3, scale * blocks.raw_noise,
                      scale * blocks.gravity_noise, magnitude)


@given(st.lists(st.floats(-3, 3), min_size=7, max_size=7))
def test_the_map_of_gravity_gives_weight_and_its_moment(numbers):
    mass, com, gravity = abs(numbers[0]) + 0.1, np.array(numbers[1:4]), np.array(numbers[4:])
    wrench = body_map(np.array([mass, *(mass * com)]), STATIC) @ gravity
    np.testing.assert_allclose(wrench[:3], mass * gravity)
    np.testing.assert_allclose(wrench[3:], np.cross(com, mass * gravity), atol=1e-12)


def by_twelve_unknowns(log):
    """Return the offset by Eq. 9 to 17 as printed: E (3 x 3) and y_o (3) by least squares."""
    mean, basis = log.raw.mean(axis=0), principal_basis(np.cov(log.raw.T))
    rows = np.kron(np.column_stack([-log.accel, np.ones(len(log.raw))]), np.eye(3))
    y = ((log.raw - mean) @ basis).ravel()
    return mean + basis @ np.linalg.lstsq(rows, y, rcond=None)[0][9:]


def test_moments_give_the_offset_that_the_twelve_unknowns_give(noisy):
    found = offset_of(moments_of(noisy, corrected=False))
    np.testing.assert_allclose(found, by_twelve_unknowns(noisy), atol=1e-6)


def test_accelerometer_noise_pulls_the_plain_offset_and_correction_takes_it_off():
    logs = [record(ADDED, Leg(), seed) for seed in range(8)]
    plain = np.mean([offset_of(moments_of(log, corrected=False)) for log in logs], axis=0)
    corrected = np.mean([offset_of(moments_of(log)) for log in logs], axis=0)
    to_newton = np.linalg.inv(GAUGES)[:3]
    pulled = np.linalg.norm(to_newton @ (plain - OFFSET))
    left = np.linalg.norm(to_newton @ (corrected - OFFSET))
    assert pulled > 0.15
    assert left < pulled / 3


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 400), st.sampled_from([1, 5, 21, 301]))
def test_the_filter_has_polynomial_ends(n, window):
    values = np.random.default_rng(n).normal(size=(n, 2)).cumsum(axis=0)
    found = smooth(values, window, 3).values
    if window == 1:
        expected = values
    elif n >= window:
        expected = savgol_filter(values, window, 3, axis=0, mode='interp')
    else:
        x = np.linspace(-1, 1, n) if n > 1 else np.zeros(1)
        order = min(3, n - 1)
        expected = np.stack([np.polyval(np.polyfit(x, y, order), x) for y in values.T], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_the_noise_gain_of_the_filter_is_what_it_does_to_noise():
    noise = np.random.default_rng(0).normal(size=(60_000, 4))
    found = smooth(noise, 301, 3)
    power = (found.values ** 2).sum() / 4
    independent = 60_000 / 301
    assert power == pytest.approx(found.noise_gain, rel=4 * np.sqrt(2 / (4 * independent)))


@pytest.mark.parametrize('rate, samples', [(100.0, 301), (99.0, 299), (1000.0, 3011), (10.0, 31)])
def test_the_papers_window_is_scaled_to_the_rate(rate, samples):
    assert abs(window_samples(3.01, 3, rate) - samples) <= 2
    assert window_samples(3.01, 3, rate) % 2 == 1


def test_rows_are_the_equation_written_out():
    rng = np.random.default_rng(2)
    C, body = rng.normal(size=(6, 6)), np.array([2.0, 0.1, -0.2, 0.3])
    raw, gravity = rng.normal(size=(5, 6)), rng.normal(size=(5, 3))
    left = eq.rows(raw, gravity) @ np.concatenate([C.T.ravel(), body])
    M = np.vstack([body[0] * np.eye(3), skew(body[1:])])
    np.testing.assert_allclose(left.reshape(5, 6), raw @ C.T - gravity @ M.T)


def test_body_and_load_are_weighed_together():
    body = np.array([2.0, 0.2, -0.4, 0.6])
    weight = eq.total_map(body, Load(0.5, (0.4, 0.0, -0.2)), STATIC) @ [0.0, 0.0, -10.0]
    # 2.5 kg; moment (0.4, -0.4, 0.5) kg m x (0, 0, -10) m/s^2
    np.testing.assert_allclose(weight, [0.0, 0.0, -25.0, 4.0, 4.0, 0.0], atol=1e-12)


def test_the_body_that_a_calibrated_sensor_feels_is_found():
    gravity = 10.0 * np.eye(3)
    wrench = [[20.0, 0.0, 0.0, 0.0, 6.0, 4.0], [0.0, 20.0, 0.0, -6.0, 0.0, 2.0],
              [0.0, 0.0, 20.0, -4.0, -2.0, 0.0]]
    np.testing.assert_allclose(eq.body_of(np.array(wrench), gravity), [2.0, 0.2, -0.4, 0.6])


def test_the_truth_solves_the_system_of_all_data_sets():
    loads = [Added(0.0), ADDED]
    logs = [record(load, QUIET, k) for k, load in enumerate(loads)]
    left, right = eq.system([log.raw[::500] - OFFSET for log in logs],
                            [-log.accel[::500] for log in logs],
                            [Load(load.mass, load.position) for load in loads])
    body = insitu_leg.BODY_MASS * np.array([1.0, *insitu_leg.BODY_COM])
    truth = np.concatenate([insitu_leg.true_matrix(QUIET).T.ravel(), body])
    np.testing.assert_allclose(left @ truth, right, atol=1e-8)
    assert np.abs(right).max() > 1.0


def solved(channels, noise):
    leg = Leg(noise=0.0, channels=channels, offset=np.zeros(len(channels)), noise_map=np.zeros(
        (len(channels), 6)))
    loads = insitu_leg.PROTOCOL[:4]
    logs = [record(load, leg, k) for k, load in enumerate(loads)]
    raws = [log.raw[::50] for log in logs]
    return leg, eq.solve(raws, [-log.accel[::50] for log in logs],
                         [Load(load.mass, load.position) for load in loads],
                         eq.six_channels(raws, noise))


def test_more_than_six_channels_are_combined_by_their_noise():
    rng = np.random.default_rng(4)
    channels = rng.normal(size=(9, 6))
    noise = np.diag([1.0, 1, 1, 1, 1, 1, 1e4, 1e4, 1e4])
    _, fit = solved(channels, noise)
    np.testing.assert_allclose(fit.matrix @ channels, np.eye(6), atol=1e-7)
    assert np.abs(fit.matrix[:, 6:]).max() < 1e-2 * np.abs(fit.matrix[:, :6]).max()


def test_blocks_of_a_long_recording_stay_few_and_keep_their_noise(noisy, monkeypatch):
    one = to_blocks(Prepared(noisy.t, -noisy.accel, noisy.raw))
    monkeypatch.setattr('forcecal_ros.insitu.blocks.MOST_BLOCKS', 500)
    many = to_blocks(Prepared(np.concatenate([noisy.t + 60 * k for k in range(5)]),
                              np.tile(-noisy.accel, (5, 1)), np.tile(noisy.raw, (5, 1))))
    assert len(many) <= 500
    assert many.samples > one.samples
    np.testing.assert_allclose(many.raw_noise, one.raw_noise, atol=0.1 * one.raw_noise.max())
    sigma = insitu_leg.ACCELERATION_NOISE
    np.testing.assert_allclose(np.sqrt(np.diag(one.gravity_noise)), sigma, rtol=0.06)


def test_the_noise_of_coupled_channels_is_measured_with_its_correlation(noisy):
    blocks = to_blocks(Prepared(noisy.t, -noisy.accel, noisy.raw))
    size = np.repeat([insitu_leg.FORCE_NOISE, insitu_leg.TORQUE_NOISE], 3) ** 2
    true = (GAUGES * size) @ GAUGES.T
    np.testing.assert_allclose(blocks.raw_noise, true, atol=0.06 * true.max())
