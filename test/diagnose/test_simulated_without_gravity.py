"""Simulated sensors without gravity are refused or left out by that name."""

from dataclasses import replace

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Stream
from forcecal_ros.diagnose.recordings import keep_comparable_imus
from forcecal_ros.diagnose.sources.simulated_tool import simulated_tool
from longer import first
import moving_arm
from moving_arm import moving
import numpy as np
from own_arm import RIG
import pytest
from wrong_recordings import at_wrench, recording_of

G = 9.80665


@pytest.fixture(scope='module')
def one():
    return moving(5, seconds=20.0, rate=200.0)


@pytest.mark.parametrize('noise', first([0.08, 0.0]))
def test_a_wrench_without_weight_is_refused_and_no_tool_that_touches(one, noise):
    force = -moving_arm.MASS * G * at_wrench(one)[:, 2]
    weight = np.hstack([force, np.cross(moving_arm.COM, force)])
    rng = np.random.default_rng(1)
    wrench = one.wrench - moving_arm.BIAS - weight + noise * rng.standard_normal((len(one.t), 6))
    with pytest.raises(DataError, match=(
            'the simulated wrench: it shows the inertia of 0.9.* kg and the weight of .*let it '
            'publish the wrench without compensating gravity')):
        simulated_tool(recording_of(replace(one, wrench=wrench)), 0.1, 900, RIG)


def test_an_imu_without_gravity_is_left_out_as_such(one):
    t = one.t
    noise = 0.05 * np.random.default_rng(2).standard_normal((len(t), 3))
    up = at_wrench(one)[:, 2] * G
    recording = recording_of(one)
    with_it, without = (replace(recording, accelerometer=Stream(t, values), accelerometer_unit=(
        'm/s^2')) for values in (up + noise, noise))
    *_, note = keep_comparable_imus(with_it, without)
    assert "the simulator's shows 0.0" in note and 'and no gravity' in note
    assert 'deg from' not in note
    assert keep_comparable_imus(with_it, with_it)[2] == ''
