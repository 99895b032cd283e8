"""The delay between the sensors, found from motion, with an honest standard error."""

from forcecal_ros.calibrate.delay import estimate_delay, with_delay
from forcecal_ros.core.errors import DataError
from longer import first
import numpy as np
from observing import calibration, record, Swing
import pytest

SWING = Swing(place=(0.012, 0.004, 0.006), slide=0.003)


@pytest.mark.parametrize('delay', first([-0.0033, 0.010, -0.010, 0.0, 0.006], 2))
def test_delay_of_free_motion_is_found_within_its_standard_error(delay):
    rates = (1000.0, 254.0, 250.0)
    errors = []
    for seed in range(6):
        found = estimate_delay(record(3.0, SWING, seed=seed, delay=delay, rates=rates),
                               calibration(0.0))
        errors.append((float(found) - delay) / found.std)
    assert found.std < 3e-4
    assert np.abs(np.mean(errors)) < 4 / np.sqrt(6)
    assert np.abs(errors).max() < 4


def test_a_bias_that_moved_does_not_count():
    moved = calibration(wrench_bias=type(calibration().mass)(np.zeros(6), 0.0, 'N, N m'))
    found = estimate_delay(record(3.0, SWING, seed=1, delay=0.006), moved)
    assert float(found) == pytest.approx(0.006, abs=4 * found.std)


def test_rest_and_short_recordings_are_refused():
    with pytest.raises(DataError, match='does not identify the delay'):
        estimate_delay(record(3.0, seed=2), calibration())
    with pytest.raises(DataError, match='blocks'):
        estimate_delay(record(0.3, SWING), calibration())
    with pytest.raises(DataError, match='requires wrench and accelerometer'):
        estimate_delay(record(1.0, without=('accelerometer',)), calibration())


def test_the_calibration_takes_it_over():
    found = estimate_delay(record(3.0, SWING, delay=0.006), calibration())
    assert with_delay(calibration(), found).accelerometer.delay is found
