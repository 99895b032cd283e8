"""Recordings with discrepancies that no library has: what was asked for, and always the same."""

from background_cases import make
from background_energy import NOISE
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest

pytestmark = pytest.mark.long  # of what the benchmark makes

CASE = {'base': 'rig', 'half': 'development', 'seed': 3, 'number': 0, 'effects': [],
        'kinds': {'hum': 5000.0}, 'ratio': 0.0}


@pytest.fixture(scope='module')
def humming():
    return make(CASE)


def test_a_seed_repeats_to_the_bit(humming):
    for one, again in zip(humming[:2], make(CASE)[:2]):
        np.testing.assert_array_equal(one.wrench.values, again.wrench.values)
        np.testing.assert_array_equal(one.accelerometer.values, again.accelerometer.values)
        np.testing.assert_array_equal(one.pose.R_base_sensor, again.pose.R_base_sensor)


def energy(one, other):
    sensor = load_rig().wrench_sensor
    noise = NOISE * np.repeat([sensor.force_noise, sensor.torque_noise], 3)
    return float((((one.wrench.values - other.wrench.values) / noise) ** 2).sum())


def test_energies_are_what_was_asked_for(humming):
    silent, late = (make(CASE | changed) for changed in (
        {'kinds': {}}, {'effects': ['wrench_delay'], 'ratio': 4.0}))
    # mains hum is none of what nuisances could take up
    assert energy(humming[1], silent[1]) == pytest.approx(5000.0, rel=0.02)
    assert humming[3].background == {'hum': 5000.0}
    assert late[3].energies['wrench_delay'] == pytest.approx(20000.0, rel=0.04)
    assert late[3].ratio == pytest.approx(4.0, rel=0.04)
    # beyond what they could take up, of a rig that differs from the nominal one
    assert 18000.0 < energy(late[1], humming[1]) < 40000.0
