"""Clocks against a rig's rates, and limits of coarse readings."""

from forcecal_ros.recording.checks.clipping import clipping, quantisation
from forcecal_ros.recording.checks.clocks import clocks, skew_between
from forcecal_ros.recording.streams import CHANNELS, Recording, Stream
import numpy as np
import pytest


def test_a_clock_that_is_wrong_by_more_than_half_a_hertz_is_wrong_against_the_rig():
    t = 1e-3 * np.arange(20_000) * (1.0 + 1e-3)
    recording = Recording(wrench=Stream(t, np.zeros((len(t), 6))))
    found = clocks(recording, {'wrench': 1000.0})
    assert skew_between(found)['wrench'] == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize('step, ends', [(0.1, 2), (5.0, 0)])
def test_the_last_of_a_few_rough_steps_is_not_the_end_of_a_range(step, ends):
    t = 0.001 * np.arange(20_000)
    force = np.zeros((len(t), 6))
    force[:, 0] = np.clip(120.0 * np.sin(2.0 * np.pi * 0.3 * t), -100.0, 100.0)
    force += 0.2 * np.random.default_rng(5).standard_normal(force.shape)
    force[:, 0] = np.clip(step * np.round(force[:, 0] / step), -100.0, 100.0)
    recording = Recording(wrench=Stream(t, force, 'ft_sensor'))
    noise = dict.fromkeys(CHANNELS['wrench'], 0.2)
    found = clipping(recording, quantisation(recording, noise), noise)
    assert [round(abs(x.limit)) for x in found] == [100] * ends
