"""Of an accelerometer's axis counts what the force confirmed, and motion in full."""

from dataclasses import replace

from forcecal_ros.io.calibration_file import dump, parse
from forcecal_ros.observe import design, replay
from forcecal_ros.observe.share import with_share
from forcecal_ros.observe.weighing import weigh, Weighing
import gravity_arm as arm
import numpy as np
import pytest

RATE = 1000.0
SHARE, LEVEL = (0.1, 1.0, 0.1), (0.05, 0.05, 0.05)


def left_out(beyond, share=SHARE, level=LEVEL):
    state, out = Weighing(), []
    for i, one in enumerate(beyond):
        state, left = weigh(state, i / RATE, tuple(one), share, level, 0.1)
        out.append(left)
    return np.array(out)


def swing(size, seconds=6.0, hertz=2.0):
    t = np.arange(round(seconds * RATE)) / RATE
    return size * np.sqrt(2.0) * np.sin(2 * np.pi * hertz * t)[:, None] * np.ones(3)


def test_what_is_no_larger_than_the_error_counts_by_its_share():
    beyond = swing(0.05)
    kept = (beyond - left_out(beyond))[3000:].std(axis=0) / beyond[3000:].std(axis=0)
    assert kept[1] == 1.0
    # what is weighed: 2 Hz below a corner of 19 Hz, without the mean over a second
    weighed = 1 / (1 + 2j / 19.1) / (1 - 1j / (2 * np.pi * 2.0))
    assert kept[[0, 2]] == pytest.approx(abs(1 - 0.9 * weighed), abs=0.005)


def test_motion_beyond_the_error_counts_in_full():
    beyond = swing(1.0)
    assert (left_out(beyond)[1000:].std(axis=0) < 0.02).all()


def test_a_steady_part_is_left_alone():
    assert np.abs(left_out(np.ones((4000, 3)))).max() == 0.0


def test_after_a_pause_it_begins_anew():
    state = Weighing(1.0, (9.0,) * 3, (9.0,) * 3, (9.0,) * 3, (9.0,) * 3, (9.0,) * 3)
    after, left = weigh(state, 2.0, (1.0, 2.0, 3.0), SHARE, LEVEL, 0.1)
    assert after.mean == (1.0, 2.0, 3.0) and after.power == left == (0.0, 0.0, 0.0)


@pytest.fixture(scope='module')
def known():
    return arm.calibrate(np.random.default_rng(3))[0]


@pytest.fixture(scope='module')
def moved():
    rng = np.random.default_rng(4)
    recording = arm.record(arm.free_motion(rng, 12.0), rng)
    # 4 Hz that the force does not show, along y, ten times what the hand moves there
    error = 0.0 * recording.accelerometer.values
    error[:, 1] = 3.0 * np.sin(2 * np.pi * 4.0 * recording.accelerometer.t)
    return recording, replace(recording, accelerometer=replace(
        recording.accelerometer, values=recording.accelerometer.values + error))


def test_a_sound_accelerometer_counts_in_full(known, moved):
    whole = with_share(known, moved[0])
    assert whole.accelerometer.share.value.tolist() == [1.0, 1.0, 1.0]
    assert not design(whole).weighs


def test_an_axis_with_an_error_of_its_own_counts_by_what_the_force_confirms(known, moved):
    part = with_share(known, moved[1])
    share = part.accelerometer.share.value
    assert share[1] < 0.1 and share[[0, 2]].tolist() == [1.0, 1.0]
    full, weighed = (replay(moved[1], c).measured[2000:, 1].std() for c in (known, part))
    assert weighed < 0.5 * full


def test_the_file_keeps_share_and_level(known, moved):
    weighed = with_share(known, moved[1])
    again, once = parse(dump(weighed), 'a file').accelerometer, weighed.accelerometer
    np.testing.assert_allclose(again.share.value, once.share.value)
    np.testing.assert_allclose(again.level.value, once.level.value)
