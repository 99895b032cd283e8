"""Blocks over a recording, and means over them."""

from forcecal_ros.core.streams import Phase
from forcecal_ros.core.time_grid import Averager, block_length, labelled
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


def test_blocks_hold_five_samples_of_the_slowest_sensor():
    assert block_length(0.02, 0.001, 0.004) == pytest.approx(0.02)
    assert block_length(0.02, 0.001, 0.01) == pytest.approx(0.05)
    assert block_length(0.02, 0.0014, 0.004) == pytest.approx(0.021)


def test_contact_and_idle_are_neither_still_nor_free():
    phases = (Phase('idle', 0, 1), Phase('measure', 1, 2), Phase('move', 2, 3),
              Phase('settle', 3, 4), Phase('contact', 4, 5))
    starts = 0.0005 + 0.02 * np.arange(249)
    still, free = labelled(starts, 0.02, [(1.0, 2.0)], phases)
    seconds = (starts + 0.01).astype(int)
    assert (seconds[still == 0] == 1).all() and (still == 0).sum() >= 48
    # blocks lie across the borders of measure, move and settle: all are free
    assert set(seconds[free]) <= {1, 2, 3} and (free & (seconds >= 2)).sum() >= 98
    assert not (free & (still >= 0)).any()


def test_stamps_that_nearly_coincide_do_not_make_the_mean_swing():
    rng = np.random.default_rng(0)
    t = 1e-3 * np.arange(2000)
    t[501::50] = t[500::50] + 1e-7
    noisy = np.sin(3 * t)[:, np.newaxis] + 0.01 * rng.standard_normal((2000, 1))
    starts = np.arange(0.1, 1.8, 0.02)
    means = Averager(t, noisy).means(starts, 0.02)[:, 0]
    assert np.abs(means - np.sin(3 * (starts + 0.01))).max() < 0.02
