"""The protocol of [Traversaro2014] IV on a simulated leg: how near the truth, and how sure."""

from dataclasses import replace

from forcecal_ros.insitu import calibrate, Load, Mounting, Options
import insitu_leg
from insitu_leg import BODY_MASS, G, Leg, PROTOCOL, REAL
from insitu_runs import calibrated, data_set, errors, sigmas, validation
import numpy as np
import pytest
from scipy import signal


@pytest.fixture(scope='module')
def noisy():
    return calibrated(Leg(), 1)


@pytest.fixture(scope='module')
def real():
    return calibrated(REAL, 1)


def test_with_noise_alone_truths_are_met_within_standard_errors_and_without_a_warning(noisy):
    assert max(errors(noisy)) < 0.003
    assert np.abs(sigmas(noisy, Leg())).max() < 3.0
    assert not noisy.warnings


def test_the_manufacturers_matrix_makes_an_ellipsoid_of_the_sphere(noisy):
    for found, load in validation(noisy):
        if load.mass:
            np.testing.assert_allclose(found.by_manufacturer.semi_axes, [77, 47.5, 43], rtol=0.03)
            np.testing.assert_allclose(found.semi_axes.value, (BODY_MASS + load.mass) * G,
                                       rtol=0.003)
        assert abs(found.by_manufacturer.mass - load.mass) > 1.0


def test_with_bias_hysteresis_and_flex_errors_stay_small_and_standard_errors_hold(real):
    assert max(errors(real)) < 0.02
    off = np.abs(sigmas(real, REAL))
    assert (off < 2).mean() >= 0.9 and np.median(off) >= 0.4


def test_the_flex_is_reported_as_what_leaves_the_subspace(real):
    assert any('bends under load' in warning and 'from the subspace' in warning
               for warning in real.warnings)
    assert real.causes.bending.significant


def test_the_accelerometers_bias_is_found_in_the_norm_of_gravity(real):
    bias = -np.array(REAL.accelerometer_bias)
    assert real.norm.usable
    assert (np.abs(real.norm.offset - bias) < 4 * real.norm.std).all()


@pytest.mark.long
def test_blocks_as_long_as_the_motion_bias_nothing(monkeypatch):
    monkeypatch.setattr('forcecal_ros.insitu.blocks.MOST_BLOCKS', 60)
    leg = Leg(accelerometer_bias=(0.05, -0.05, 0.05), duration=120.0)
    result = calibrated(leg, 3)
    assert (np.abs(result.norm.offset + leg.accelerometer_bias) < 4 * result.norm.std).all()
    assert np.abs(sigmas(result, leg)).max() < 4.0


@pytest.mark.long
def test_hysteresis_that_is_taken_off_leaves_smaller_errors(monkeypatch):
    leg = Leg(hysteresis=0.005)
    compensated = np.max([errors(calibrated(leg, seed)) for seed in (1, 2)], axis=0)
    monkeypatch.setattr('forcecal_ros.insitu.uncertainty.ENOUGH', np.inf)
    without = np.max([errors(calibrated(leg, seed)) for seed in (1, 2)], axis=0)
    assert (compensated < 0.7 * without).all()


@pytest.mark.long
@pytest.mark.parametrize('window', [3.01, 0.0])
def test_standard_errors_cover_with_the_filter_and_without(window):
    leg = Leg(duration=30.0)
    z = np.concatenate([
        sigmas(calibrated(leg, 30 + seed, Options(filter_window=window)), leg)
        for seed in range(3)])
    assert 0.75 < np.sqrt((z ** 2).mean()) < 1.2
    assert (np.abs(z) < 1.96).mean() > 0.91


@pytest.mark.long
def test_standard_errors_cover_when_the_noise_is_correlated_over_seconds(monkeypatch):
    def record(load, leg, seed, plain=insitu_leg.record):
        log = plain(load, leg, seed)
        decay = np.exp(-1 / (insitu_leg.RATE * 1.0))
        white = np.random.default_rng(seed + 7).standard_normal((len(log.t) + 1000, 6))
        slow = signal.lfilter([np.sqrt(1 - decay ** 2)], [1, -decay], white, axis=0)[1000:]
        size = 0.5 * np.repeat([insitu_leg.FORCE_NOISE, insitu_leg.TORQUE_NOISE], 3)
        return insitu_leg.Log(log.t, log.raw + (slow * size) @ insitu_leg.GAUGES.T, log.accel,
                              log.gyro, log.wrench)

    monkeypatch.setattr('insitu_runs.record', record)
    z = np.concatenate([sigmas(calibrated(Leg(), 60 + seed), Leg()) for seed in range(3)])
    assert np.sqrt((z ** 2).mean()) < 1.3
    assert (np.abs(z) < 1.96).mean() > 0.88


TURN = np.array([[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]])
"""Accelerometer to sensor."""


def turned_sets(leg, positions_in_accelerometer):
    for k, load in enumerate(PROTOCOL[:4]):
        log = insitu_leg.record(load, leg, 400 + k)
        at = TURN.T @ np.array(load.position) if positions_in_accelerometer else load.position
        yield data_set(replace(log, accel=log.accel @ TURN), Load(load.mass, tuple(at)), f'{k}')


@pytest.mark.long
def test_known_rotation_of_the_accelerometer_changes_nothing_nor_do_positions_in_its_frame():
    leg = Leg(duration=20.0)
    plain = calibrated(leg, 0.4, protocol=PROTOCOL[:4])
    turned = calibrate('leg', list(turned_sets(leg, False)), Mounting(TURN), Options())
    np.testing.assert_allclose(turned.matrix.value, plain.matrix.value, rtol=1e-6, atol=1e-9)
    turned = calibrate('leg', list(turned_sets(leg, True)), Mounting(), Options())
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(TURN @ turned.matrix.value[part], plain.matrix.value[part],
                                   rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(TURN @ turned.com.value, plain.com.value, rtol=1e-6)


def test_fast_motion_needs_the_gyro_and_then_is_as_good_as_rest():
    fast = Leg(inertial=True, speed=8.0, duration=30.0)
    where = Mounting(position=insitu_leg.ACCELEROMETER)
    with_gyro = calibrated(fast, 2, Options(moving=True), where)
    assert max(errors(with_gyro)) < 0.005
    assert np.abs(sigmas(with_gyro, fast)).max() < 4.0
    J = insitu_leg.BODY_INERTIA
    off = np.abs(with_gyro.inertia.value - J) / with_gyro.inertia.std
    assert off.max() < 4.0
    without = calibrated(fast, 2, Options(screening=False))
    assert errors(without)[2] > 0.03
    assert any('move slower' in warning for warning in without.warnings)
