"""A tool that a hand leads tells its weight at rest, and nothing else by its motion."""

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from longer import first
import numpy as np
import pytest

RATE, HOLD, WAY = 125.0, 3.0, 4.0
MASS, COM = 0.4, np.array([0.01, -0.02, 0.06])
G = np.array([0.0, 0.0, -9.80665])
HAND = np.array([0.02, -0.15, 0.12])
TWO = ((0.0, 0.0, 0.0), (1.5, 0.4, 0.0))
THREE = (*TWO, (0.3, -1.3, 0.2))


def led(turns, hand, seed=0, noise=(0.02, 0.001)):
    """Stand at each turn, with a push of ``hand`` N at ``HAND`` on the ways between."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, len(turns) * (HOLD + WAY) - WAY, 1.0 / RATE)
    knots = np.cumsum([0.0, *([HOLD, WAY] * len(turns))[:-1]])
    angles = np.repeat(np.array(turns), 2, axis=0)
    share = np.interp(t, knots, np.arange(len(knots)))
    smooth = np.floor(share) + (1.0 - np.cos(np.pi * (share % 1.0))) / 2.0
    way = np.stack([np.interp(smooth, np.arange(len(knots)), column) for column in angles.T],
                   axis=1)
    moving = (np.searchsorted(knots, t, 'right') - 1) % 2 == 1
    shake = np.sin(np.pi * (share % 1.0))**4 * moving
    way = way + 0.3 * shake[:, None] * np.sin(np.outer(t, [5.0, 7.0, 9.0]))
    R = rotation_from_vector(way)
    weight = MASS * G @ R
    torque = np.cross(COM, weight)
    push = hand * np.where(moving, 1.0, 0.0)[:, None] * np.stack(
        [np.sin(1.1 * t), np.cos(1.7 * t), np.sin(0.6 * t + 1.0)], axis=1)
    wrench = np.hstack([weight + push, torque + np.cross(HAND, push)])
    wrench += [0.5, -0.3, 1.0, 0.02, 0.01, -0.03]
    wrench += rng.standard_normal(wrench.shape) * np.repeat(noise, 3)
    return Recording(wrench=Stream(t, wrench, 'ft'),
                     pose=PoseStream(t, np.full((len(t), 3), np.nan), R, 'base'))


def test_two_poses_and_a_free_way_tell_the_centre_of_mass():
    found = identify(led(TWO, 0.0))
    np.testing.assert_allclose(found.com.value, COM, atol=4 * found.com.std.max())
    assert found.com.std.max() < 2e-3


def test_two_poses_and_a_hand_do_not():
    with pytest.raises(UnobservableError, match='not observable.* add a pose'):
        identify(led(TWO, 8.0))


@pytest.mark.parametrize('hand', first([1.2, 0.5]))
def test_a_light_hand_widens_the_errors_by_what_it_leaves_over(hand):
    found = identify(led(TWO, hand, seed=1))
    off = np.abs(found.com.value - COM)
    assert off.max() > 0.02  # the lever of the hand is not the tool's
    assert (off < 4.0 * found.com.std).all()


def test_a_hand_between_three_poses_spoils_the_motion_alone():
    for hand in (0.0, 8.0):
        found = identify(led(THREE, hand))
        said = any('the tool is in contact' in line for line in found.quality['warnings'])
        assert said == (hand > 0.0) and found.inertia is None
        np.testing.assert_allclose(found.com.value, COM, atol=1e-4)


def test_noise_of_a_light_tool_is_no_hand():
    noisy = identify(led(THREE, 0.0, noise=(6.0, 0.3)))
    assert not any('in contact' in line for line in noisy.quality['warnings'])
