"""Wrenches at rest determine frame, axes and the way down if the poses do, and nothing else."""

import re

from forcecal_ros.checks.hypotheses import judge
from forcecal_ros.checks.messages import Stated
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from longer import first
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

G = np.array([0.0, 0.0, -9.81])
NOISE = 0.02


def turn(*degrees):
    return rotation_from_vector(np.radians(degrees))


def forces(seed, n=12, Q=np.eye(3), gravity=G, mass=1.2, com=(0.01, 0.0, 0.06), pull=0.0,
           torques=np.eye(3)):
    """Record a tool whose sensor is turned by Q, and its torques by another matrix on top."""
    rng = np.random.default_rng(seed)
    R = Rotation.random(n, random_state=rng).as_matrix()
    wire = mass * gravity @ R + rng.normal(0.0, 8.0, 3) + NOISE * rng.standard_normal((n, 3))
    torque = np.cross(com, mass * gravity @ R) + pull * rng.standard_normal((n, 3))
    one = np.hstack([wire @ Q.T, torque @ Q.T @ torques.T])
    t = 2.0 * np.arange(n)
    return Recording(wrench=Stream(t, one), pose=PoseStream(t, np.full((n, 3), np.nan), R))


@pytest.mark.parametrize('seed', first(range(5)))
@pytest.mark.parametrize('n', [4, 6, 12, 24])
def test_sound_forces_are_taken_as_they_are(n, seed):
    assert judge(forces(seed, n), G) == ()


@pytest.mark.parametrize('given, by, said', [
    (None, 'calibration', r'calibrate again with --sensor-rotation \S+ \S+ 30\S*$'),
    (None, 'rig', r'pass --sensor-from-pose 0 0 0 \S+ \S+ (\S+) (\S+)$'),
    ((0.1, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0), '',
     r'pass --sensor-from-pose 0.1 0 0.2 \S+ \S+ (\S+) (\S+)$')])
def test_a_turn_is_mended_where_the_pose_of_the_sensor_was_stated(given, by, said):
    with pytest.raises(DataError, match=said) as refused:
        judge(forces(1, Q=turn(0.0, 0.0, 30.0).T), G,
              Stated(sensor_from_pose=given, by=by))
    about_z = re.search(said, str(refused.value)).groups()
    np.testing.assert_allclose(np.array(about_z, dtype=float),
                               [np.sin(np.radians(15.0)), np.cos(np.radians(15.0))][:len(about_z)],
                               atol=0.01)



def test_a_turned_sensor_on_a_tilted_base_is_both():
    with pytest.raises(DataError, match=r'by -4[45]\.\d.* y.*and the base is tilted.* (89|90)\.'):
        judge(forces(1, 24, Q=turn(0.0, 45.0, 0.0), gravity=turn(90.0, 0.0, 0.0) @ G), G)


@pytest.mark.parametrize('sign', [1, pytest.param(-1, marks=pytest.mark.long)])
def test_the_opposite_sign_is_not_taken_for_a_turn(sign):
    for seed in range(3):
        with pytest.raises(DataError, match=f'set wrench.sign to {-sign} .*upside|upside.*'
                                            f'set wrench.sign to {-sign} '):
            judge(forces(seed, 6, Q=-np.eye(3)), G, Stated(wrench_sign=sign))


def test_a_degree_is_not_refused():
    assert judge(forces(1, 24, gravity=turn(1.0, 0.0, 0.0) @ G), G) == ()
    assert judge(forces(1, 24, Q=turn(0.0, 0.0, -1.0)), G) == ()


def test_two_poses_say_nothing():
    assert judge(forces(1, 2, Q=turn(0.0, 0.0, 30.0)), G) == ()


def test_a_force_without_weight_is_no_tool():
    with pytest.raises(UnobservableError, match='show no weight'):
        judge(forces(1, mass=0.0), G)


def test_wrenches_of_other_poses_are_no_tool():
    one = forces(1, 24)
    values = np.vstack([one.wrench.values[:12], one.wrench.values[12:][::-1]])
    with pytest.raises(DataError, match='in the same poses|of different robots'):
        judge(Recording(wrench=Stream(one.wrench.t, values), pose=one.pose), G)


def test_a_tared_wrench_in_base_says_so():
    one = forces(1)
    still = np.tile([0.0, 0.0, -9.81, 0.0, 0.0, 0.0], (12, 1))
    still += NOISE * np.random.default_rng(2).standard_normal((12, 6))
    with pytest.raises(UnobservableError, match=r'weight of 0\.999 kg: the wrench may be'):
        judge(Recording(wrench=Stream(one.wrench.t, still), pose=one.pose), G)


@pytest.mark.parametrize('poses', first([6, 8, 20]))
@pytest.mark.parametrize('com', [(0.01, -0.005, 0.07), (0.0, 0.0, 0.07)])
@pytest.mark.parametrize('pull', [0.0, 0.05, 1.0])
def test_sound_torques_pass_with_whatever_pulls_besides(poses, com, pull):
    assert judge(forces(0, poses, com=com, pull=1e-3 + pull), G) == ()


@pytest.mark.parametrize('order, signs, shown', [
    ([0, 1, 2], [1, 1, -1], 'x, y, -z'), ([1, 0, 2], [1, 1, 1], 'y, x, z'),
    ([2, 0, 1], [1, -1, 1], 'z, -x, y'), ([0, 1, 2], [-1, -1, 1], 'x, y, -z')])
def test_mirrored_and_swapped_torques_are_named(order, signs, shown):
    axes = np.eye(3)[order] * np.array(signs)[:, None]
    with pytest.raises(DataError, match=rf'x, y, z measure {shown}\), or all three have|'
                                        'torques are about other axes'):
        judge(forces(0, com=(0.01, -0.005, 0.07), pull=1e-3, torques=axes), G)
