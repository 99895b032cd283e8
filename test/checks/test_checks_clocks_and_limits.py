"""Clocks against a rig's rates, and limits of coarse readings."""

from forcecal_ros.checks.clocks import clocks, skew_between
from forcecal_ros.checks.signals import clipped, refuse_wrapped
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import CHANNELS, PoseStream, Recording, Stream
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
    found = clipped(recording, dict.fromkeys(CHANNELS['wrench'], 0.2))
    assert [round(abs(x.limit)) for x in found] == [100] * ends


def counted(bits):
    """One channel that counts up slowly, and from its end on begins again three times."""
    t = 0.001 * np.arange(4000)
    values = np.floor(t * 2**bits) % 2**bits
    return Stream(t, values[:, None]), PoseStream(t, np.zeros((len(t), 3)), np.tile(
        np.eye(3), (len(t), 1, 1)))


def test_counts_of_eight_bits_wrap_and_four_steps_are_noise():
    with pytest.raises(DataError, match='its counts overflow'):
        refuse_wrapped(*counted(8))
    refuse_wrapped(*counted(2))
