"""Signals in sixteen bits are right to a part of their largest value."""

from forcecal_ros.diagnose.model.jacobian import Compact, stacked
import numpy as np
import pytest

RNG = np.random.default_rng(1)


def test_signals_are_right_to_half_a_unit_each_of_its_own_size():
    signals = RNG.standard_normal((4, 3000)) * np.array([1e-9, 1.0, 1e6, 0.0])[:, np.newaxis]
    found = Compact.of(signals)
    largest = np.abs(signals).max(axis=1, keepdims=True)
    # half a unit, and single precision
    assert (np.abs(found.values() - signals) <= (0.5 / 32767 + 2e-7) * largest).all()
    assert found.numbers.nbytes == 2 * signals.size


def test_a_part_of_the_time_is_that_of_all():
    found = Compact.of(RNG.standard_normal((2, 50)))
    assert (found.values(slice(10, 20)) == found.values()[:, 10:20]).all()
    rows = stacked(np.arange(50.0), [Compact(found.numbers[1], found.unit[1]), None])(slice(7, 9))
    assert (rows == [[7.0, 8.0], found.values()[1, 7:9], [0.0, 0.0]]).all()


def test_signals_are_scaled_joined_and_summed():
    one, other = (Compact.of(RNG.standard_normal((k, 30))) for k in (2, 1))
    assert one.times(-3.0).values() == pytest.approx(-3.0 * one.values())
    joined = Compact.joined([one, other])
    weights = RNG.standard_normal((5, 3))
    assert joined.combined(weights) == pytest.approx(
        weights @ np.concatenate([one.values(), other.values()]), abs=1e-6)
