"""Block means and what the noise at rest is worth."""

from forcecal_ros.identify.ac_coupling import fading, lowpassed
from forcecal_ros.identify.blocks import Averager, block_length, make_grid
from forcecal_ros.identify.means import drift
from forcecal_ros.recording.streams import Phase, Stream
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest


@given(st.floats(0.0, 0.01), st.floats(0.005, 0.05))
def test_a_block_mean_of_a_cubic_is_exact_wherever_the_block_lies(shift, length):
    t = np.arange(0, 1, 0.004)
    starts = np.array([0.1, 0.3, 0.5]) + shift
    found = Averager(t, np.stack([t**3 - t, 2 - t], axis=1)).means(starts, length)
    a, b = starts, starts + length
    np.testing.assert_allclose(found[:, 0], ((b**4 - a**4) / 4 - (b**2 - a**2) / 2) / length,
                               atol=1e-10)
    np.testing.assert_allclose(found[:, 1], 2 - (a + b) / 2, atol=1e-10)


def test_blocks_over_missing_samples_are_missing_and_others_are_not():
    t = np.delete(np.arange(0, 1, 0.001), np.arange(300, 320))
    averager = Averager(t, t[:, None])
    found = averager.means(np.array([0.2, 0.29, 0.31, 0.35, 0.99, -0.1]), 0.02)[:, 0]
    np.testing.assert_array_equal(np.isnan(found), [False, True, True, False, True, True])


def test_a_late_signal_is_met_by_late_blocks():
    t = np.arange(0, 2, 0.001)

    def signal(t):
        return np.sin(20 * t)[:, None]

    starts = np.arange(0.1, 1.8, 0.02)
    on_time = Averager(t, signal(t)).means(starts, 0.02)
    late = Averager(t, signal(t - 0.00437)).means(starts + 0.00437, 0.02)
    np.testing.assert_allclose(late, on_time, atol=1e-7)


def test_blocks_hold_five_samples_of_the_slowest_sensor():
    assert block_length(0.02, 0.001, 0.004) == pytest.approx(0.02)
    assert block_length(0.02, 0.001, 0.01) == pytest.approx(0.05)
    assert block_length(0.02, 0.0014, 0.004) == pytest.approx(0.021)


def test_contact_and_idle_are_neither_still_nor_free():
    phases = (Phase('idle', 0, 1), Phase('measure', 1, 2), Phase('move', 2, 3),
              Phase('settle', 3, 4), Phase('contact', 4, 5))
    grid = make_grid(np.arange(0, 5, 0.001), 0.02, [(1.0, 2.0)], phases)
    seconds = (grid.starts + 0.01).astype(int)
    assert (seconds[grid.still == 0] == 1).all() and (grid.still == 0).sum() >= 48
    assert set(seconds[grid.free]) == {2, 3}
    # one block lies across the border of move and settle: both are free
    assert grid.free.sum() >= 98








def test_a_drift_is_found_where_it_is_and_noise_is_none():
    rng = np.random.default_rng(11)
    t = np.arange(0, 4, 0.001)
    values = 0.01 * rng.standard_normal((len(t), 3))
    windows = [(0.0, 2.0), (2.0, 4.0)]
    assert drift(Stream(t, values), windows)[0] < 5
    values[2000:, 1] += 0.01 * np.exp(-(t[2000:] - 2) / 0.5)
    sigmas, pose, channel = drift(Stream(t, values), windows)
    assert sigmas > 6 and (pose, channel) == (1, 1)


def test_the_highpass_of_block_means_is_that_of_the_signal():
    cutoff, dt, length = 0.2, 1e-4, 0.02
    t = np.arange(0, 6, dt) + dt / 2
    f = np.sin(3 * t) + (t > 2)
    keep = np.exp(-2 * np.pi * cutoff * dt)
    w, state = np.empty_like(t), 1.5
    for i, value in enumerate(f):
        w[i] = state + (value - state) * (1 - keep) / 2
        state = keep * state + (1 - keep) * value
    blocks = f.reshape(-1, 200).mean(axis=1)
    found = lowpassed(blocks, length, cutoff) + 1.5 * fading(len(blocks), length, cutoff)
    np.testing.assert_allclose(found, w.reshape(-1, 200).mean(axis=1), atol=2e-4)
