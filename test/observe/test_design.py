"""Gains: detectability before Riccati, the joint problem as yardstick, poles for any period."""

from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import ConfigError, UnobservableError
from forcecal_ros.observe import (
    design,
    kalman_gains,
    noise_levels,
    ObserverSettings,
    replay,
    Status,
    with_kalman_gains,
)
from forcecal_ros.observe.bandwidth import (
    butterworth,
    contact_bandwidth,
    Poles,
)
from forcecal_ros.observe.motion import tracking_gains
import numpy as np
from observing import calibration, push, record
import pytest
from scipy.linalg import solve_discrete_are

LEVELS = noise_levels(calibration().noise)
MASS = 13.0


def test_design_refuses_an_undetectable_offset_and_auto_leaves_it_out():
    with pytest.raises(UnobservableError, match='set observer.offset to off'):
        design(calibration(), ObserverSettings(offset='on', position=False))
    assert not design(calibration(), ObserverSettings(offset='auto', position=False)).track_offset
    assert not design(calibration(), ObserverSettings(offset='off')).track_offset
    assert design(calibration(), ObserverSettings(offset='on')).track_offset


def test_a_lasting_contact_does_not_become_an_offset():
    """50 N for 10 s on the compliant tool, the displacement from the spring force."""
    recording = record(12.0, contact=push(0, 50.0, 1.0), seed=1, without=('optidrive',))
    estimate = replay(recording, calibration())
    late = estimate.t > 8.0
    assert estimate.contact[late, 0].mean() == pytest.approx(50.0, abs=0.1)


def test_an_accelerometer_offset_is_found_through_the_pose():
    """0.1 m/s^2 too much is 1.3 N of false contact; without the state it stays."""
    known = calibration()
    wrong = replace(known, accelerometer=replace(
        known.accelerometer, offset=Estimate(
            known.accelerometer.offset.value - 0.1 * 0.2937, 0.0, 'V')))
    recording = record(12.0, seed=2)
    tracked, held = (replay(recording, wrong, ObserverSettings(offset=o)) for o in ('on', 'off'))
    late = tracked.t > 10.0
    assert np.abs(tracked.contact[late, :3].mean(axis=0)).max() < 0.1
    assert np.abs(held.contact[late, :3].mean(axis=0)) == pytest.approx([1.3] * 3, abs=0.05)
    assert (held.status[100:-20] == Status.OFFSET_HELD).all()


@pytest.mark.parametrize('dt', [0.001, 0.004, 0.01, 0.03])
@pytest.mark.parametrize('poles', [butterworth(80.0), Poles(0.5, 9.0, 85.0), Poles(2.0, 9., -30.)])
def test_gains_place_the_poles_whatever_the_period(dt, poles):
    A = np.array([[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1]])
    gain = np.array(tracking_gains(dt, poles))[:, None]
    found = np.linalg.eigvals((np.eye(3) - gain @ [[1.0, 0.0, 0.0]]) @ A)
    pair = -poles.mean + np.array([1, -1]) * np.emath.sqrt(-poles.split)
    wanted = np.exp(dt * np.array([-poles.real, *pair]).astype(complex))
    assert np.poly(found) == pytest.approx(np.real(np.poly(wanted)), abs=1e-9)


@pytest.mark.parametrize('walk', [0.1, 2.5, 10.0])
def test_bandwidth_is_that_of_the_riccati_equation_of_a_random_walk(walk):
    settings = ObserverSettings(contact_walk=walk, bandwidth_min_hz=1e-3, bandwidth_max_hz=1000.0)
    dt = 1 / LEVELS.rate
    noise = (LEVELS.force + MASS ** 2 * LEVELS.specific_force) / dt
    variance, = solve_discrete_are(1.0, 1.0, walk ** 2 * dt, noise)[0]
    expected = np.log1p(variance / noise) / dt / (2 * np.pi)
    assert contact_bandwidth(LEVELS, MASS, settings) == pytest.approx(expected, rel=1e-6)


def test_gains_for_the_calibration_name_the_bandwidth():
    gains = kalman_gains(design(calibration(), ObserverSettings(bandwidth_hz=20.0)), 0.001)
    assert float(gains['bandwidth']) == pytest.approx(20.0)
    assert float(gains['contact']) == pytest.approx(0.1181, abs=1e-4)  # 1 kHz
    kept = with_kalman_gains(calibration()).observer.kalman
    assert set(kept) == set(gains) | {
        'contact_walk', 'bandwidth_min', 'bandwidth_max', 'rise_time', 'std'}
    assert float(kept['rise_time']) == pytest.approx(0.0141, abs=1e-4)
    assert with_kalman_gains(replace(calibration(), observer=None)).observer is None


@pytest.mark.parametrize(('changes', 'message'), [
    ({'mass': Estimate(-1.0, 0.0, 'kg')}, 'no usable mass'),
    ({'com': Estimate([np.nan] * 3, 0.0, 'm')}, 'no usable com'),
    ({'wrench_bias': Estimate([np.nan] * 6, 0.0, 'N')}, 'wrench_bias')])
def test_a_calibration_that_lacks_what_is_needed_is_refused(changes, message):
    with pytest.raises(ConfigError, match=message):
        design(calibration(**changes))


def test_an_accelerometer_that_cannot_be_inverted_is_refused():
    known = calibration()
    for name, value, message in (('map', np.ones((3, 3)) / 3 ** 0.5, 'cannot be inverted'),
                                 ('gain', [np.nan] * 3, 'cannot be inverted'),
                                 ('offset', [np.nan] * 3, 'offset')):
        broken = replace(known.accelerometer, **{name: Estimate(value, 0.0, '1')})
        with pytest.raises(ConfigError, match=message):
            design(replace(known, accelerometer=broken))
    with pytest.raises(ConfigError, match='cutoff'):
        design(replace(known, accelerometer=replace(known.accelerometer, coupling='ac')))


@pytest.mark.parametrize('wrong', [
    {'filter': 'luenberger'}, {'offset': 'maybe'}, {'bandwidth_hz': 0.0}, {'skew': -1.0},
    {'contact_walk': np.inf}, {'wrench_limit': (1.0, 2.0)}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=f'observer.{next(iter(wrong))} is .*, expected'):
        ObserverSettings(**wrong)


def test_noise_levels_stand_in_where_none_were_measured():
    assert design(replace(calibration(), noise=None)).rate > 0
    broken = replace(calibration().noise, wrench_rate=np.nan)
    with pytest.raises(ConfigError, match='noise'):
        noise_levels(broken)


def test_a_delay_that_was_not_identified_counts_as_none():
    known = calibration()
    unknown = replace(known.accelerometer, delay=Estimate(np.nan, np.nan, 's'))
    assert design(replace(known, accelerometer=unknown)).delay == 0.0
