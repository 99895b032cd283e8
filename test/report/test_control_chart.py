"""Control limits hold what they promise, and find what moved and when."""

from forcecal_ros.report.control_chart import chart, limit
import numpy as np
import pytest


def test_false_alarms_come_as_often_as_is_said():
    # standard errors differ by ten, and scatter is three times what they say
    rng = np.random.default_rng(1)
    length, series, nights = 100.0, 60, 250
    stds = rng.choice([0.1, 0.3, 1.0], size=(series, nights))
    values = 7.0 + 3.0 * stds * rng.normal(size=(series, nights))
    h = limit(length)
    alarms = sum(len(chart(v, s, h).changes) for v, s in zip(values, stds))
    expected = series * nights / length
    # each alarm starts the wait anew from two numbers on: Poisson within 4 sigma
    assert abs(alarms - expected) < 4 * np.sqrt(expected)


def test_the_limit_is_siegmunds():
    # [Siegmund1985]: h = 5 with k = 0.5 runs 465 numbers on two sides (tables: 465)
    assert limit(465.0) == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize('factor', [1.0, 5.0])
def test_a_shift_is_found_soon_and_dated(factor):
    rng = np.random.default_rng(2)
    stds = np.full(60, 0.01)
    values = 2.0 + factor * stds * rng.normal(size=60)
    values[40:] -= 6.0 * factor * 0.01
    (found,) = chart(values, stds, limit(40_000.0)).changes
    assert found.onset == 40 and found.noticed < 44
    assert found.after - found.before == pytest.approx(-6.0 * factor * 0.01, abs=4 * found.std)


def test_one_bad_recording_is_odd_and_no_change():
    rng = np.random.default_rng(3)
    values = rng.normal(size=50)
    values[30] += 40.0
    found = chart(values, [np.nan] * 50, limit(40_000.0))
    assert found.odd == (30,) and not found.changes
    values[31] += 40.0
    assert chart(values, [np.nan] * 50, limit(40_000.0)).changes[0].onset == 30


def test_a_number_that_never_scattered_may_still_change():
    found = chart([1.0] * 10 + [2.0] * 5, [0.0] * 15, limit(1000.0))
    assert [one.onset for one in found.changes] == [10]
    assert not chart([1.0] * 15, [0.0] * 15, limit(1000.0)).changes
    assert chart([], [], 5.0).level == () and chart([1.0], [0.1], 5.0).level == (0.0,)
