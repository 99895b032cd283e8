"""A change that lasts is found in a long recording as in a short one."""

from forcecal_ros.calibrate.lasting_change import lasting_change
from forcecal_ros.checks.frames import Forces
from forcecal_ros.core.geometry import rotation_from_vector
import numpy as np
import pytest

G = np.array([0.0, 0.0, -9.80665])


@pytest.mark.parametrize('n, at', [(60, 31), (2000, 1237), (5003, 1502)])
def test_the_mean_from_which_on_it_is_off_is_named(n, at):
    rng = np.random.default_rng(n)
    R = rotation_from_vector(rng.standard_normal((n // 4 + 1, 3)).repeat(4, axis=0)[:n])
    forces = Forces(R, 2.0 * (G @ R), G, None)
    off = 0.02 * rng.standard_normal((n, 3))
    assert lasting_change(forces, 0.5 * np.arange(n), off, 1.0) == ''
    off[at:] += [6.0, -3.0, 1.0]
    said = lasting_change(forces, 0.5 * np.arange(n), off, 1.0)
    words = said.split()
    assert float(words[1]) == pytest.approx(0.5 * at, abs=0.051)  # said to a tenth
    np.testing.assert_allclose([float(word) for word in words[7:10]], [6.0, -3.0, 1.0], atol=0.05)


def test_a_base_that_tilts_is_told_beside_hard_pushes_and_pushes_alone_are_not():
    rng = np.random.default_rng(7)
    R = rotation_from_vector(rng.standard_normal((40, 3)).repeat(2, axis=0))
    forces = Forces(R, 2.0 * (G @ R), G, None)
    off = 0.02 * rng.standard_normal((80, 3))
    for begin in (5, 20, 48, 66):
        off[begin:begin + 5] += 20.0 * rng.standard_normal(3)
    times = 0.5 * np.arange(80)
    assert lasting_change(forces, times, off, 1.0) == ''
    off[41:] += np.array([1.5, -0.7, 0.0]) @ R[41:]
    said = lasting_change(forces, times, off, 1.0)
    assert 'the base is not level any more' in said and float(said.split()[1]) == 20.5
