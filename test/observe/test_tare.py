"""Taring removes the weight first, and is refused when the tool moves or touches."""

from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import DataError
from forcecal_ros.observe import design, noise_levels, Status, tare, with_bias
from forcecal_ros.observe.live import MAX_PAUSE_S, MIN_SAMPLES, Window
from forcecal_ros.observe.playback import events, run
from longer import but, first
import numpy as np
from observing import BIAS, calibration, FORCE_NOISE, lossy, observed, push, record, Swing
import pytest
from scipy.spatial.transform import Rotation

LEVELS = noise_levels(calibration().noise)
MODEL = design(calibration())
UNTARED = design(calibration(wrench_bias=Estimate(np.zeros(6), 0.0, 'N, N m')))


def window(recording, start, end, model=MODEL):
    _, samples = run(events(recording), model)
    return [s for s in samples if start <= s.t < end]


@pytest.mark.parametrize('euler', but(
    [(np.pi, 0.0, 0.0), (2.0, 0.5, 1.0), (0.0, np.pi / 2, 0.0)], [(np.pi, 0.0, 0.0)]))
def test_tare_finds_the_bias_in_any_orientation(euler):
    home = Rotation.from_euler('xyz', euler).as_matrix()
    found = tare(window(record(2.5, home=home), 0.5, 2.4, UNTARED), UNTARED, LEVELS)
    # the accelerometer's offset and the pose decide what is weight: 0.02 N or so
    assert np.abs(found.bias - BIAS)[:3].max() < 0.05
    assert np.abs(found.bias - BIAS)[3:].max() < 0.01
    assert found.shift == pytest.approx(found.bias)
    assert found.std[0] < 5 * FORCE_NOISE / np.sqrt(1900)


def test_after_taring_the_contact_wrench_is_zero():
    recording = record(2.5)
    found = tare(window(recording, 0.5, 2.4, UNTARED), UNTARED, LEVELS)
    after = np.array([s.contact for s in window(recording, 0.5, 2.4,
                                                with_bias(UNTARED, found.bias))])
    assert np.abs(after.mean(axis=0)[:3]).max() < 0.02


@pytest.mark.parametrize('swing', [
    Swing(place=(0.01, 0.0, 0.0), place_hz=1.0), Swing(turn=0.05, turn_hz=0.3, axis=(0., 1., 0.))])
def test_tare_is_refused_in_motion(swing):
    with pytest.raises(DataError, match='moves'):
        tare(window(record(2.5, swing), 1.2, 2.4), MODEL, LEVELS)


def test_tare_is_refused_while_a_contact_begins():
    with pytest.raises(DataError, match='touches something.*force.x'):
        tare(window(record(2.5, contact=push(0, 5.0, 1.5)), 0.5, 2.4), MODEL, LEVELS)


def test_tare_wants_long_enough_a_window_of_valid_samples():
    with pytest.raises(DataError, match='0.5 s at rest'):
        tare([], MODEL, LEVELS)
    with pytest.raises(DataError, match='0.5 s at rest'):
        tare(window(record(1.0), 0.5, 0.8), MODEL, LEVELS)
    blind = record(1.5, without=('pose', 'accelerometer'))
    with pytest.raises(DataError, match='weight unknown'):
        tare(window(blind, 0.5, 1.4), MODEL, LEVELS)


def test_single_samples_that_are_not_valid_do_not_count():
    samples = window(record(1.5), 0.9, 1.45)
    wanted = tare(samples, MODEL, LEVELS)

    def with_invalid(share):
        return [s._replace(status=Status.BAD_WRENCH, measured=(99.0,) * 6)
                if i % round(1 / share) == 0 else s for i, s in enumerate(samples)]

    found = tare(with_invalid(0.05), MODEL, LEVELS)
    assert np.abs(found.bias - wanted.bias).max() < 0.02
    with pytest.raises(DataError, match='of 550 samples are not valid: the wrench is not finite'):
        tare(with_invalid(0.2), MODEL, LEVELS)


NOISE = calibration().noise
RATES = (10.0, 50.0, 125.0, 1000.0)
SECONDS = 2.6


def observer(rate, seed, **scene):
    recording = record(SECONDS, seed=seed, rates=(rate, 500.0, 125.0), **scene)
    return observed(lossy(recording, seed), design(calibration()))


@pytest.mark.parametrize('calibrated_at', first([None, 1000.0]))
@pytest.mark.parametrize('rate', but(RATES, {50.0, 125.0}))
def test_a_tare_at_rest_succeeds_by_no_chance(rate, calibrated_at):
    levels = noise_levels(replace(NOISE, wrench_rate=calibrated_at or rate))
    for seed in range(2 if rate > 500 else 4):
        live = observer(rate, seed)
        found = live.tare(live.model, levels)
        assert np.abs(found.shift[:3]).max() < 5 * FORCE_NOISE


@pytest.mark.parametrize('rate', but(RATES, {50.0, 125.0}))
def test_a_push_that_has_just_begun_is_refused_at_every_rate(rate):
    for seed in range(2):
        live = observer(rate, seed, contact=push(0, 5.0, SECONDS - 0.25))
        with pytest.raises(DataError, match='touches something'):
            live.tare(live.model, noise_levels(NOISE))


def samples(times):
    live = observed(record(0.05), design(calibration()))
    one = live.window.samples[-1]
    return [one._replace(t=t) for t in times]


@pytest.mark.parametrize('period', [0.001, 0.02, 0.1])
def test_a_window_spans_its_seconds_and_never_fewer_samples_than_a_tare_wants(period):
    window = Window(0.5)
    for sample in samples(np.arange(0.0, 5.0, period)):
        window.add(sample)
        window.add_pose(sample.t, (0.0,) * 7)
    kept = window.samples
    assert len(kept) >= MIN_SAMPLES
    assert 0.5 <= kept[-1].t - kept[0].t <= max(0.5, MIN_SAMPLES * period) + 2 * period
    assert len(window.poses_of_samples()) == len(kept)


@pytest.mark.parametrize('step', [-3600.0, -0.1, 2 * MAX_PAUSE_S])
def test_a_window_begins_anew_after_a_pause_and_where_stamps_go_back(step):
    window = Window(0.5)
    times = 7200.0 + np.arange(0.0, 1.0, 0.01)
    for sample in samples([*times, *(times[-1] + step + np.arange(10) * 0.01)]):
        window.add(sample)
    assert len(window.samples) == 10


def test_poses_do_not_pile_up_while_the_wrench_is_silent():
    window = Window(0.5)
    window.add(samples([0.0])[0])
    for t in np.arange(0.0, 100.0, 0.1):
        window.add_pose(float(t), (0.0,) * 7)
    assert len(window.poses) < 300
