"""Forces at rest tell frame, axes and the way down where the poses do, and nothing else."""

import re

from forcecal_ros.checks.frame_faults import (
    refuse_other_frame,
    refuse_unexplained,
    refuse_weightless,
    slightly_off,
    Stated,
)
from forcecal_ros.checks.frames import Forces, judge
from forcecal_ros.checks.orientations import (
    refuse_other_orientation,
    simpler_reading,
)
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import rotation_from_vector
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

G = np.array([0.0, 0.0, -9.81])
NOISE = 0.02
SWAPPED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def turn(*degrees):
    return rotation_from_vector(np.radians(degrees))


def forces(seed, n=12, Q=np.eye(3), gravity=G, base=False, known=False, mass=1.2):
    """Return forces of a tool whose sensor is turned by Q, or that are expressed in base."""
    rng = np.random.default_rng(seed)
    R = Rotation.random(n, random_state=rng).as_matrix()
    wire = mass * gravity @ R @ Q.T + rng.normal(0.0, 8.0, 3)
    if base:
        wire = np.einsum('nij,nj->ni', R, wire)
    return Forces(R, wire + NOISE * rng.standard_normal((n, 3)), G,
                  np.full(n, NOISE) if known else None)


def names(judgement):
    return [fit.name for fit in judgement.likely]


@pytest.mark.parametrize('known', [False, True])
@pytest.mark.parametrize('n', [3, 4, 6, 12, 24])
def test_sound_forces_are_taken_as_they_are(n, known):
    for seed in range(60):
        judgement = judge(forces(seed, n, known=known))
        assert names(judgement) == ['plain']
        refuse_other_frame(judgement)
        refuse_weightless(judgement)
        refuse_unexplained(judgement)
        assert not slightly_off(judgement)


@pytest.mark.parametrize('times, name', [(0.3, 'turned'), (0.6, 'plain')])
def test_a_turn_that_twice_the_noise_explains_is_none(times, name):
    R = turn(0.0, 20.0, 0.0) @ rotation_from_vector(
        0.6 * np.array([[1, 0, 0], [0, 1, 0], [0.7, -0.7, 0], [-1, 0.3, 0], [0, 0, 0]]))
    wire = 1.5 * G @ R @ turn(0.0, 0.0, -15.0).T
    off = judge(Forces(R, wire, G, None)).plain.rms
    sure = Forces(R, wire, G, np.full(5, times * off))
    assert name in names(judge(sure))


@pytest.mark.parametrize('known', [False, True])
@pytest.mark.parametrize('n', [6, 12, 24])
def test_a_turn_is_found_within_its_standard_error(n, known):
    angles = []
    for seed in range(20):
        fit, = judge(forces(seed, n, Q=turn(0.0, 0.0, -30.0), known=known)).likely
        assert fit.name == 'turned'
        angles.append((np.linalg.norm(Rotation.from_matrix(fit.Q).as_rotvec()) - np.radians(30.0))
                      / fit.turn_std)
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(1.0, abs=0.6)


def test_a_turn_is_named_about_the_axis_that_the_sensor_was_turned_about():
    with pytest.raises(DataError, match=r'turned by 30\.\d+ \+- 0\.\d+ deg about z .*'
                                        r'; state --sensor-rotation \S+ \S+ 30\S* \(where'):
        refuse_other_frame(judge(forces(1, Q=turn(0.0, 0.0, 30.0).T)))


@pytest.mark.parametrize('given, by, said', [
    (None, 'calibration', r'calibrate again with --sensor-rotation \S+ \S+ 30\S*$'),
    (None, 'rig', r'state --sensor-from-pose 0 0 0 \S+ \S+ (\S+) (\S+)$'),
    ((0.1, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0), '',
     r'state --sensor-from-pose 0.1 0 0.2 \S+ \S+ (\S+) (\S+)$')])
def test_a_turn_is_mended_where_the_pose_of_the_sensor_was_stated(given, by, said):
    with pytest.raises(DataError, match=said) as refused:
        refuse_other_frame(judge(forces(1, Q=turn(0.0, 0.0, 30.0).T)),
                           Stated(sensor_from_pose=given, by=by))
    about_z = re.search(said, str(refused.value)).groups()
    np.testing.assert_allclose(np.array(about_z, dtype=float),
                               [np.sin(np.radians(15.0)), np.cos(np.radians(15.0))][:len(about_z)],
                               atol=0.01)


def test_a_tilted_base_is_named_with_the_option_that_states_it():
    with pytest.raises(DataError, match='not level.*--gravity-direction ') as refused:
        refuse_other_frame(judge(forces(1, gravity=turn(40.0, 0.0, 0.0) @ G)))
    said = np.array(str(refused.value).rpartition('direction ')[2].split(), dtype=float)
    np.testing.assert_allclose(said, turn(40.0, 0.0, 0.0) @ [0.0, 0.0, -1.0], atol=0.005)


def test_a_turned_sensor_on_a_tilted_base_is_both():
    with pytest.raises(DataError, match=r'by -45\.0.* about y.*and base is not level.* 89\.9'):
        refuse_other_frame(judge(forces(
            1, Q=turn(0.0, 45.0, 0.0), gravity=turn(90.0, 0.0, 0.0) @ G)))


@pytest.mark.parametrize('Q, said', [(SWAPPED, 'x, y, z show y, x, z'),
                                     (np.diag([1.0, 1.0, -1.0]), 'x, y, z show x, y, -z')])
def test_swapped_and_mirrored_axes_are_named(Q, said):
    with pytest.raises(DataError, match=f'mirrored .*{said}'):
        refuse_other_frame(judge(forces(1, Q=Q)))


def test_a_wrench_in_base_is_named():
    for seed in range(20):
        with pytest.raises(DataError, match='expressed in base, not in the frame of the sensor'):
            refuse_other_frame(judge(forces(seed, 8, base=True)))


@pytest.mark.parametrize('sign', [1, -1])
def test_the_opposite_sign_is_not_taken_for_a_turn(sign):
    for seed in range(20):
        with pytest.raises(DataError, match=f'set wrench.sign to {-sign} .*upside|upside.*'
                                            f'set wrench.sign to {-sign} '):
            refuse_other_frame(judge(forces(seed, 6, Q=-np.eye(3))), Stated(wrench_sign=sign))


def test_a_degree_is_named_and_not_refused():
    tilted = judge(forces(1, 24, gravity=turn(1.0, 0.0, 0.0) @ G))
    turned = judge(forces(1, 24, Q=turn(0.0, 0.0, -1.0)))
    for judgement in (tilted, turned):
        refuse_other_frame(judgement)
    assert 'gravity is 1.0' in slightly_off(tilted)
    assert 'deg about z' in slightly_off(turned)


def test_three_poses_that_cannot_tell_a_turn_from_a_mirror_name_both():
    found = judge(forces(1, 3, Q=SWAPPED, known=True))
    assert set(names(found)) == {'turned', 'mirrored'}
    with pytest.raises(DataError, match='turned .*, or its axes are mirrored.*; poses in more|'
                                        'mirrored .*, or its axes are turned.*; poses in more'):
        refuse_other_frame(found)


def test_two_poses_say_nothing():
    found = judge(forces(1, 2, Q=turn(0.0, 0.0, 30.0), known=True))
    assert names(found) == ['plain']


def test_a_force_without_weight_is_no_tool():
    with pytest.raises(UnobservableError, match='show no weight'):
        refuse_weightless(judge(forces(1, mass=0.0)))


def test_wrenches_of_other_poses_are_no_tool():
    one = forces(1, 24)
    half = one._replace(wire=np.vstack([one.wire[:12], one.wire[12:][::-1]]))
    with pytest.raises(DataError, match='not of the same poses'):
        refuse_unexplained(judge(half))


def test_a_tared_wrench_in_base_says_so():
    one = forces(1)
    still = one._replace(wire=np.tile([0.0, 0.0, -9.81], (12, 1))
                         + NOISE * np.random.default_rng(2).standard_normal((12, 3)))
    with pytest.raises(UnobservableError, match=r'of 0\.999 kg in a wrench expressed in base'):
        refuse_weightless(judge(still))


def read_wrongly(seed, n=12, off=0.8):
    """Return forces of few directions, off by a pull; quaternions from w were read from x."""
    rng = np.random.default_rng(seed)
    lean = rng.normal(0.0, 0.5, (n // 3, 3))
    R = turn(180.0, 0.0, 0.0) @ rotation_from_vector(
        np.repeat(lean, 3, axis=0) + rng.normal(0.0, 0.02, (n, 3)))
    wire = 1.5 * G @ R + rng.normal(0.0, 8.0, 3) + off * rng.standard_normal((n, 3))
    x, y, z, w = Rotation.from_matrix(R).as_quat().T
    wrong = Rotation.from_quat(np.stack([w, x, y, z], axis=1)).as_matrix()
    return Forces(wrong, wire, G, np.full(n, 0.1))


def test_quaternions_from_w_are_named_and_not_axes_that_fit_as_well():
    said, frames = [], 0
    for seed in range(40):
        recorded = read_wrongly(seed)
        judgement = judge(recorded)
        if names(judgement) == ['plain']:
            continue
        frames += 1
        try:
            refuse_other_orientation(recorded, judgement)
        except DataError as error:
            said.append(str(error))
    assert frames > 20
    assert len(said) > 0.9 * frames
    assert all('in the order w, x, y, z' in one for one in said)


def test_other_axes_are_not_taken_for_an_orientation_read_wrongly():
    for seed in range(40):
        for Q in (turn(0.0, 0.0, -30.0), SWAPPED, turn(90.0, 0.0, 0.0)):
            recorded = forces(seed, 12, Q=Q)
            judgement = judge(recorded)
            assert names(judgement) != ['plain']
            refuse_other_orientation(recorded, judgement)
            assert not simpler_reading(recorded, judgement)


def test_pulls_that_poses_share_make_no_tilt_beside_a_turn():
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        lean = np.repeat(rng.normal(0.0, 0.9, (4, 3)), 3, axis=0) + rng.normal(0.0, 0.08, (12, 3))
        R = rotation_from_vector(lean)
        pull = np.repeat(rng.normal(0.0, 0.06, (4, 3)), 3, axis=0)
        wire = 0.4 * G @ R @ turn(0.0, 0.0, -85.0).T + pull
        wire += NOISE * rng.standard_normal((12, 3))
        found.append(names(judge(Forces(R, wire, G, np.full(12, 0.1 * NOISE)))))
    assert sum('turned' in one for one in found) >= 25
