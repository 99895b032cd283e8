"""Stamps that were set on arrival are put back on the instants around which they lie."""

from forcecal_ros.core.stamps import even_instants, jitter_of, with_even_stamps
from forcecal_ros.core.streams import Stream
import numpy as np
import pytest

PERIOD = 1e-3


def regular(n=20_000):
    return PERIOD * np.arange(n)


def arrived(t, jitter, seed=0):
    """As a driver stamps what it takes up late, in order."""
    late = t + np.random.default_rng(seed).uniform(0.0, jitter, len(t))
    return np.maximum.accumulate(late) + 1e-9 * np.arange(len(t))


def evened(t):
    jitter = jitter_of(t)
    return even_instants(t, jitter), jitter


def swinging(at, noise=1e-3):
    """Return what a sensor reads of a motion of 1 Hz at the instants ``at``."""
    wave = np.sin(2 * np.pi * at[:, None] + [0.0, 1.0])
    return wave + noise * np.random.default_rng(1).normal(size=wave.shape)


def test_regular_stamps_stay_as_they_are():
    stream = Stream(regular(), swinging(regular()))
    assert with_even_stamps(stream)[0] is stream


@pytest.mark.parametrize('jitter', [5e-4, 3e-3])
def test_late_stamps_of_a_regular_sensor_are_evened(jitter):
    t = regular()
    even, _ = with_even_stamps(Stream(arrived(t, jitter), swinging(t)))
    assert (even.t - t)[1000:-1000].std() < 1e-4


@pytest.mark.parametrize('jitter', [5e-4, 3e-3])
def test_true_stamps_of_a_sensor_that_is_read_irregularly_stay(jitter):
    t = arrived(regular(), jitter)
    stream = Stream(t, swinging(t))
    assert with_even_stamps(stream)[0] is stream


@pytest.mark.parametrize('jitter, stays', [(2e-4, True), (3e-3, False)])
def test_where_the_signal_is_noise_only_a_large_jitter_is_evened(jitter, stays):
    t = arrived(regular(), jitter)
    stream = Stream(t, np.random.default_rng(2).normal(size=(len(t), 3)))
    assert (with_even_stamps(stream)[0] is stream) == stays


@pytest.mark.parametrize('jitter', [1e-3, 3e-3, 6e-3])
def test_what_is_left_of_a_jitter_is_its_mean_over_a_second(jitter):
    t = regular()
    even, found = evened(arrived(t, jitter))
    off = (even - t)[1000:-1000]
    assert found.period == pytest.approx(PERIOD, rel=1e-3)
    assert off.std() < 4 * jitter / np.sqrt(12) / np.sqrt(1000)
    assert 0.5 * jitter < off.mean() < jitter  # of those that overtake, the latest counts


def test_bursts_of_eight_are_spread_out():
    t = regular()
    burst = t[7::8].repeat(8) + 1e-6 * np.tile(np.arange(8), len(t) // 8)
    even, _ = evened(burst)
    assert np.ptp(np.diff(even)[1000:-1000]) < 0.1 * PERIOD


@pytest.mark.parametrize('size', [2, 10, 20, 40])
def test_the_period_of_bursts_is_that_of_the_sensor(size):
    n = 12_000
    last = PERIOD * (np.arange(n) // size * size + size - 1)
    period = jitter_of(last + 1e-5 * (np.arange(n) % size)).period
    assert period == pytest.approx(PERIOD, rel=2e-3)


def test_a_pause_stays_a_pause_and_what_comes_after_it_stays_late():
    t = regular()
    kept = np.r_[t[:7000], t[7050:]]
    even, _ = evened(arrived(kept, 3e-3))
    assert np.diff(even).argmax() == 6999
    assert abs((even - kept)[8100:-1000].mean() - (even - kept)[1000:5900].mean()) < 2e-4


@pytest.mark.parametrize('lost', [20, 40, 50])
def test_a_pause_is_as_long_as_the_samples_on_either_side_say(lost):
    t = regular()
    kept = np.r_[0:7000, 7000 + lost:len(t)]
    for seed in range(10):
        even, jitter = evened(arrived(t, 4.7e-3, seed)[kept])
        assert jitter.number[7000] - jitter.number[6999] == lost + 1
        off = (even - t[kept])[5000:9000]
        assert np.ptp(off) < 0.3 * PERIOD


def test_few_stamps_say_nothing_about_their_jitter():
    assert jitter_of(np.array([0.0, 1.0, 2.5])).std == 0.0
    assert np.isnan(jitter_of(np.array([1.0])).period)


@pytest.mark.parametrize('share', [0.01, 0.2])
def test_lost_samples_are_no_jitter(share):
    t = regular()
    t = t[np.random.default_rng(3).random(len(t)) > share]
    stream = Stream(t, swinging(t))
    assert with_even_stamps(stream)[0] is stream


def test_lost_samples_leave_the_others_where_they_were():
    t = regular()
    kept = np.random.default_rng(3).random(len(t)) > 0.05
    even, _ = with_even_stamps(Stream(arrived(t, 3e-4)[kept], swinging(t)[kept]))
    assert (even.t - t[kept])[1000:-1000].std() < 5e-5


@pytest.mark.parametrize('lost', [3, 5, 12])
def test_a_pause_that_is_shorter_than_the_jitter_is_found(lost):
    t = regular()
    kept = np.r_[0:7000, 7000 + lost:len(t)]
    even, _ = evened(arrived(t, 3e-3)[kept])
    off = (even - t[kept])[1000:-1000]
    assert off.std() < 1.5e-4


def test_a_short_stretch_between_two_pauses_is_evened_too():
    t = regular()
    kept = np.ones(len(t), dtype=bool)
    kept[7000:7006] = kept[7052:7058] = False
    for seed in range(5):
        late = arrived(t, 1e-3, seed)[kept]
        even, _ = with_even_stamps(Stream(late, swinging(t[kept])))
        assert np.diff(even.t).min() > 0.9 * PERIOD
        off = even.t - t[kept]
        assert np.abs(off - np.median(off))[6900:7100].max() < 1.2 * PERIOD
