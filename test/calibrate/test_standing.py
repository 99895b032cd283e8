"""Where a recording without phases stands still, whatever the noise of its poses."""

from dataclasses import replace

from forcecal_ros.calibrate.poses import static_windows
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
import numpy as np
import pytest

RATE = 250.0
HOLDS = ((0.0, 4.0), (6.0, 10.0), (12.0, 16.0))


def moved(place, turn, slow=0.0, seed=1):
    """Three holds, two moves of 2 s between them, and white noise [m], [rad]."""
    t = np.arange(0.0, 16.0, 1.0 / RATE)
    x = sum(np.clip((t - start) / 2.0, 0.0, 1.0) for start in (4.0, 10.0))
    x = x + slow * t
    rng = np.random.default_rng(seed)
    way = np.outer(x, [0.2, 0.0, 0.1]) + place * rng.normal(size=(len(t), 3))
    angle = np.outer(x, [0.5, 0.3, 0.0])
    R = rotation_from_vector(angle) @ rotation_from_vector(turn * rng.normal(size=(len(t), 3)))
    return Recording(pose=PoseStream(t, way, R))


@pytest.mark.parametrize('place, turn', [(0.0, 0.0), (1e-4, 2e-4), (1e-3, 2e-3)])
def test_holds_are_found_and_moves_left_out(place, turn):
    windows = static_windows(moved(place, turn))
    assert len(windows) == len(HOLDS)
    for i, ((start, end), (first, last)) in enumerate(zip(windows, HOLDS)):
        # the first second of a stand is left to the tool's ringing
        assert start == pytest.approx(first + (1.0 if i else 0.0), abs=0.25)
        assert end == pytest.approx(last, abs=0.25)
        assert first <= start and end <= last + 0.06


def test_what_creeps_is_no_stand():
    with pytest.raises(DataError, match='never stands still'):
        static_windows(moved(2e-5, 2e-5, slow=0.05))


@pytest.mark.parametrize('frequency', [0.4, 3.0])
def test_a_robot_held_by_hand_stands_although_it_sways(frequency):
    sound = moved(2e-5, 2e-5)
    t = sound.pose.t
    phase = 2.0 * np.pi * frequency * t[:, None] + np.array([0.0, 1.6, 4.0])
    swaying = replace(sound, pose=replace(
        sound.pose, position=sound.pose.position + 4e-4 * np.sin(phase),
        R_base_sensor=sound.pose.R_base_sensor @ rotation_from_vector(5e-4 * np.sin(phase))))
    windows = static_windows(swaying)
    assert len(windows) == len(HOLDS)
    for i, ((start, end), (first, last)) in enumerate(zip(windows, HOLDS)):
        assert first + 0.9 * (i > 0) <= start <= first + 1.6 and last - 0.6 <= end <= last + 0.1


def test_a_stand_in_which_the_wrench_pauses_is_left_out():
    sound = moved(2e-5, 2e-5)
    t = sound.pose.t[(sound.pose.t > 0.8) & ((sound.pose.t < 7.5) | (sound.pose.t > 9.0))]
    windows = static_windows(replace(sound, wrench=Stream(t, np.zeros((len(t), 6)))))
    assert [round(start) for start, _ in windows] == [1, 13] and windows[0][0] > 0.8
    with pytest.raises(DataError, match='no wrench in any of the 3 static poses'):
        static_windows(replace(sound, wrench=Stream(t + 100.0, np.zeros((len(t), 6)))))
