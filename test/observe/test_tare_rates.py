"""A tare at rest succeeds at every rate of the wrench, with jitter and lost samples."""

from dataclasses import replace

from forcecal_ros.core.errors import DataError
from forcecal_ros.observe import design, noise_levels
from forcecal_ros.observe.live import MAX_PAUSE_S, MIN_SAMPLES, Window
import numpy as np
from observing import calibration, FORCE_NOISE, lossy, observed, push, record
import pytest

NOISE = calibration().noise
RATES = (10.0, 50.0, 125.0, 1000.0)
SECONDS = 2.6


def observer(rate, seed, **scene):
    recording = record(SECONDS, seed=seed, rates=(rate, 500.0, 125.0), **scene)
    return observed(lossy(recording, seed), design(calibration()))


@pytest.mark.parametrize('calibrated_at', [1000.0, None])
@pytest.mark.parametrize('rate', RATES)
def test_a_tare_at_rest_succeeds_by_no_chance(rate, calibrated_at):
    levels = noise_levels(replace(NOISE, wrench_rate=calibrated_at or rate))
    for seed in range(2 if rate > 500 else 4):
        live = observer(rate, seed)
        found = live.tare(live.model, levels)
        assert np.abs(found.shift[:3]).max() < 5 * FORCE_NOISE


@pytest.mark.parametrize('rate', RATES)
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


def test_a_pose_from_before_the_window_is_no_part_of_it():
    window = Window(0.5)
    for sample in samples([5.0, 5.1]):
        window.add(sample)
    window.add_pose(4.9, (0.0,) * 7)
    assert window.poses_of_samples() == []
    window.add_pose(5.1, (0.0,) * 7)
    assert len(window.poses_of_samples()) == 1
