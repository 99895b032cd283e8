"""A zero that jumps between poses is named with its time and size, pushed before or not."""

from dataclasses import replace
from itertools import product

from forcecal_ros.checks.hypotheses import judge
from forcecal_ros.core.errors import DataError
from longer import first
import numpy as np
import pytest
from static_sets import static_set
from wrong_recordings import log, recording_of

DOWN = np.array([0.0, 0.0, -9.80665])
JUMP = np.array([4.0, -2.0, 3.0, 0.1, 0.05, 0.0])
HOLD_S, MOVE_S = 3.0, 1.5


@pytest.mark.parametrize('seed, push, times', first(dict.fromkeys(
    [(0, 80.0, 1), (21, 0.0, 1), (21, 0.0, 3), *product((21, 22, 23), (80.0, 0.0), (1, 2, 3)),
     *product(range(4), (80.0, 0.0), (1,))]), 2))
def test_a_jump_after_the_third_of_eight_poses(seed, push, times):
    one = log(seed, poses=8, hold=HOLD_S, move=MOVE_S, mass=0.95)
    at = 3 * (HOLD_S + MOVE_S) - MOVE_S / 2
    wrench = one.wrench + times * JUMP * (one.t >= at)[:, None]
    bump = np.clip(one.t - at + 1.0, 0.0, 1.0)
    wrench[:, 2] += push * np.sin(np.pi * bump)**2
    x, y, z = (times * JUMP[:3]).round().astype(int)
    with pytest.raises(DataError, match=rf'on the wrench differs by \+{x} {y} \+{z} N') as error:
        judge(recording_of(replace(one, wrench=wrench)), DOWN)
    found = float(str(error.value).split('from ')[1].split()[0])
    assert at - 1.1 < found < at + 0.5


@pytest.mark.parametrize('seed', first(range(6), 2))
def test_a_jump_between_poses_of_one_sample_each(seed):
    recording, tool = static_set(seed)
    wrench = recording.wrench
    after = np.arange(len(wrench)) >= len(wrench) // 3
    jump = 0.5 * 9.80665 * tool.mass * np.array([0.6, -0.48, 0.64, 0.0, 0.0, 0.0])
    moved = replace(wrench, values=wrench.values + after[:, None] * jump)
    with pytest.raises(DataError, match='the bias changed .a tare, an overload') as error:
        judge(replace(recording, wrench=moved), DOWN)
    found = np.array(str(error.value).split('differs by ')[1].split()[:3], dtype=float)
    np.testing.assert_allclose(found, jump[:3], rtol=0.2, atol=0.05 * np.linalg.norm(jump))
