"""Claims about the robot: [Gamez2005] Eq. 28, the servo behind it, and the turning of S."""

from dataclasses import replace

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.effects import with_effects
from forcecal_ros.effects.rig import Robot
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.plant import AT_ONCE, kernel_parameters, Plant
from forcecal_ros.sim.rig.robot import Motion, move, robot_at_rest, TINY
import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

RIG = load_rig()
PERIOD = RIG.robot.period
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def moved(positions, rotations=None, steps=4, rig=RIG):
    """Motion along commands, from rest at the first one."""
    xyzw = (np.tile(UPRIGHT, (len(positions), 1)) if rotations is None
            else Rotation.from_matrix(rotations).as_quat())
    motion = Motion.empty(2 * steps * len(positions) + 1)
    move(kernel_parameters(rig)[()], robot_at_rest(positions[0], xyzw[0])[0],
         np.array(positions), xyzw, steps, motion)
    return motion


def smooth(n, seed, size):
    """Random smooth curves that start at rest at 0, shape (n, 3)."""
    white = np.random.default_rng(seed).standard_normal((n, 3))
    white[:20] = 0.0
    curve = white
    for _ in range(4):
        curve = lfilter([0.1], [1.0, -0.9], curve, axis=0)
    return size * curve / np.abs(curve).max()


def test_coefficients_are_those_that_the_paper_prints():
    assert RIG.robot == Robot(0.004, (1.0494, -0.0775, 0.0006), (1.2348, -1.5084, 0.3011))


def test_poles_of_eq_28_at_4_ms_are_the_eigenvalues_of_eq_30():
    poles = np.roots([1.0, *(-c for c in RIG.robot.feedback)])
    A = np.array([[49.5509, -55.8283, 0.394953], [658.2543, -641.2211, -4.813578],
                  [-8022.6303, 9077.2025, -1262.97499]])
    eigenvalues = np.sort(np.log(poles.astype(complex)).real / PERIOD)
    assert eigenvalues == pytest.approx([-1183.9, -663.1, -7.575], rel=1e-4)
    assert eigenvalues == pytest.approx(np.sort(np.linalg.eigvals(A).real), rel=1e-3)


def test_raw_jump_comes_a_period_late_and_overshoots_by_23_percent():
    stiff = replace(RIG, servo=replace(RIG.servo, position_bandwidth=1e6))
    jump = np.zeros((2000, 3))
    jump[5:, 1] = 1.0
    ends = moved(jump, rig=stiff).position[::8, 1]
    assert ends[:6] == pytest.approx(np.zeros(6), abs=1e-12)
    assert ends[7] == pytest.approx(1.2348, abs=2e-3)  # servo lag: 3 slope / w
    assert ends[-1] == pytest.approx(1.0, abs=1e-9)


def test_turn_by_more_than_half_a_turn_takes_the_short_way():
    angle = np.radians(170.0)
    rotations = rotation_from_vector(np.outer(
        np.concatenate([np.full(5, -angle), np.full(500, angle)]), [0.0, 0.0, 1.0]))
    motion = moved(np.zeros((505, 3)), rotations)
    heading = np.unwrap(np.arctan2(motion.R_base_sensor[:, 1, 0], motion.R_base_sensor[:, 0, 0]))
    assert heading[-1] - heading[0] == pytest.approx(-np.radians(20.0), abs=1e-9)


def test_orientation_converges_with_the_fourth_power_of_the_step():
    rotations = rotation_from_vector(smooth(200, seed=9, size=1.5))
    finest = moved(np.zeros((200, 3)), rotations, steps=32).R_base_sensor[::64]
    errors = [np.abs(moved(np.zeros((200, 3)), rotations, steps=n).R_base_sensor[::2 * n]
                     - finest).max() for n in (1, 2, 4)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.2)


def test_a_long_motion_is_that_of_its_parts_whatever_the_robot_has():
    n = AT_ONCE + 500
    rig = with_effects(RIG, {'robot_delay': {'delay': 0.003},
                             'robot_resonance': {'gain': 0.2, 'frequency': 20.0, 'damping': 0.1}})
    positions = 0.1 * np.sin(np.arange(n)[:, np.newaxis] * [0.01, 0.02, 0.03])
    xyzw = Rotation.from_rotvec(positions).as_quat()
    whole, parts = Plant(rig), Plant(rig)
    for plant in (whole, parts):
        plant.rest(positions[0], xyzw[0])
    motion = whole.move(positions, xyzw)
    first, second = (parts.move(positions[part], xyzw[part])
                     for part in (slice(0, 700), slice(700, n)))
    for name, one, a, b in zip(motion._fields, motion, first, second):
        assert np.abs(one - np.concatenate([a, b[1:]])).max() < 1e-9 * np.abs(one).max(), name


def test_a_robot_at_rest_leaves_no_number_too_small_to_compute_with():
    positions = 0.01 * np.minimum(np.arange(2500) * PERIOD, 0.1)[:, np.newaxis] * np.ones(3)
    turned = Rotation.from_rotvec(3.0 * positions)
    plant = Plant(RIG)
    plant.rest(positions[0], turned[0].as_quat())
    motion = plant.move(positions, turned.as_quat())
    for name, values in motion._asdict().items():
        size = np.abs(values[values != 0.0])
        assert size.min() > TINY, name
    # 9.9 s of rest at 300 rad/s would leave exp(-2970), and at 60 rad/s exp(-594)
    assert not motion.velocity[-1].any()
    assert np.abs(motion.velocity).max() > 5e-3
