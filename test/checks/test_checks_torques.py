"""Torques about other axes than the forces are named; cables and contact are not."""

from forcecal_ros.checks.hypotheses import judge
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from longer import first
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

G = np.array([0.0, 0.0, -9.80665])


def readings(seed, poses=8, com=(0.01, -0.005, 0.07), pull=0.0, order=(0, 1, 2), signs=(1, 1, 1)):
    rng = np.random.default_rng(seed)
    R = Rotation.random(poses, random_state=rng).as_matrix()
    weight = 1.3 * (G @ R)
    torque = np.cross(com, weight) + [0.1, -0.2, 0.05] + 1e-3 * rng.standard_normal((poses, 3))
    torque += pull * rng.standard_normal((poses, 3))
    force = weight + 1e-2 * rng.standard_normal((poses, 3))
    t = np.arange(poses, dtype=float)
    return Recording(wrench=Stream(t, np.hstack([force, torque[:, order] * signs])),
                     pose=PoseStream(t, np.full((poses, 3), np.nan), R))


@pytest.mark.parametrize('poses', first([6, 8, 20]))
@pytest.mark.parametrize('com', [(0.01, -0.005, 0.07), (0.0, 0.0, 0.07)])
@pytest.mark.parametrize('pull', [0.0, 0.05, 1.0])
def test_sound_torques_pass_with_whatever_pulls_besides(poses, com, pull):
    assert judge(readings(0, poses, com, pull), G) == ()


@pytest.mark.parametrize('order, signs, shown', [
    ([0, 1, 2], [1, 1, -1], 'x, y, -z'), ([1, 0, 2], [1, 1, 1], 'y, x, z'),
    ([2, 0, 1], [1, -1, 1], 'z, -x, y'), ([0, 1, 2], [-1, -1, 1], 'x, y, -z')])
def test_mirrored_and_swapped_torques_are_named(order, signs, shown):
    with pytest.raises(DataError, match=f'x, y, z show {shown}, or all three the other way|'
                                        'torques are not about the axes'):
        judge(readings(0, 12, order=order, signs=signs), G)
