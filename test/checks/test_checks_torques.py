"""Torques about other axes than the forces are told, cables and contact are not taken for them."""

from forcecal_ros.checks.torques import refuse_other_torques
from forcecal_ros.checks.units import doubt_of_torque_unit
from forcecal_ros.core.errors import DataError
import numpy as np
import pytest


def readings(seed, poses=8, com=(0.01, -0.005, 0.07), pull=0.0):
    rng = np.random.default_rng(seed)
    down = rng.standard_normal((poses, 3))
    weight = 13.0 * down / np.linalg.norm(down, axis=1)[:, None]
    torque = np.cross(com, weight) + [0.1, -0.2, 0.05] + 1e-3 * rng.standard_normal((poses, 3))
    return weight, torque + pull * rng.standard_normal((poses, 3))


@pytest.mark.parametrize('poses', [4, 8, 20])
@pytest.mark.parametrize('pull', [0.0, 0.05, 1.0])
def test_sound_torques_pass_with_whatever_pulls_besides(poses, pull):
    for seed in range(60):
        weight, torque = readings(seed, poses, pull=pull)
        refuse_other_torques(weight, torque, np.full(3, 1e-3))
        weight, torque = readings(seed, poses, (0.0, 0.0, 0.07), pull)
        refuse_other_torques(weight, torque, None)


@pytest.mark.parametrize('order, signs, shown', [
    ([0, 1, 2], [1, 1, -1], 'x, y, -z'), ([1, 0, 2], [1, 1, 1], 'y, x, z'),
    ([2, 0, 1], [1, -1, 1], 'z, -x, y'), ([0, 1, 2], [-1, -1, 1], 'x, y, -z')])
def test_mirrored_and_swapped_torques_are_named(order, signs, shown):
    for seed in range(20):
        weight, torque = readings(seed)
        with pytest.raises(DataError, match=f'x, y, z show {shown}, or all three the other way'):
            refuse_other_torques(weight, torque[:, order] * signs, np.full(3, 1e-3))


def test_a_centre_of_mass_that_is_far_away_is_questioned():
    assert 'if it is 0.07 m, the torques are in lbf in' in doubt_of_torque_unit(0.07 / 0.11298)
    assert not doubt_of_torque_unit(0.2)
