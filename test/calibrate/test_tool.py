"""Tool from static poses, its spring and damper from ringing, its inertia from turning."""

from functools import cache

from forcecal_ros.calibrate.accelerometer import in_words, split_matrix
from forcecal_ros.calibrate.ringing import follow, Ring, stiffness_and_damping
from forcecal_ros.calibrate.tool import identify_tool, refuse_negative, Statics
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import rotation_from_vector
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp

MASS, COM, K, D = 13.0, np.array([0.03, -0.01, 0.14]), 5000.0, 130.0
FORCE_BIAS, TORQUE_BIAS = np.array([4.0, -3.0, 8.0]), np.array([0.3, -0.2, 0.1])
G = 9.80665
X = np.array([1.0, 0.0, 0.0])
THREE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-0.866, -0.483, 0.129]])


def statics_of(directions, noise=0.0, seed=0, slide=True, sigma=(5e-3, 4e-4)):
    g = G * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    s = MASS * g[:, 0] / K if slide else np.zeros(len(g))
    force = MASS * g + FORCE_BIAS
    torque = np.cross(COM + s[:, None] * X, MASS * g) + TORQUE_BIAS
    std = np.repeat(sigma, 3)
    rng = np.random.default_rng(seed)
    wrench = np.hstack([force, torque]) + noise * std * rng.standard_normal((len(g), 6))
    return Statics(g, wrench, np.tile(np.diag(std**2), (len(g), 1, 1)), s, np.zeros(len(g)))


@pytest.mark.parametrize('directions, axis', [([[0, 0, 1], [1, 0, 0]], 'x'),
                                              ([[0, 0, 1], [0, 1, 0]], 'y')])
def test_poses_along_one_line_name_the_axis_to_tilt_about(directions, axis):
    with pytest.raises(UnobservableError, match=f'tilted about {axis} of ft_sensor'):
        identify_tool(statics_of(np.array(directions, dtype=float)))


def test_a_turned_wrench_is_refused():
    statics = statics_of(THREE)
    tool = identify_tool(statics._replace(wrench=-statics.wrench))
    with pytest.raises(DataError, match='has the opposite sign; set wrench.sign to 1 '):
        refuse_negative(tool.mass, -1)


@cache
def let_go(k, d, n):
    """Time, displacement and velocity of a tool let go at 5 mm."""
    t = np.arange(n) * 1e-3
    return t, solve_ivp(lambda _, y: [y[1], -(k * y[0] + d * y[1]) / MASS], (0, t[-1]),
                        [0.005, 0.02], t_eval=t, rtol=1e-10, atol=1e-13).y


def ringing(k=K, d=D, delay=0.0, noise=1.0, seed=0, n=700, way=0.0):
    """Force and late displacement of a tool let go at 5 mm; noise of 0.25 N and 20 um."""
    t, end = let_go(k, d, n)
    slide, force = follow(way, t, k, d, MASS)
    rng = np.random.default_rng(seed)
    return Ring(t, 4.0 + k * end[0] + d * end[1] + force + noise * 0.25 * rng.standard_normal(n),
                t + delay, end[0] + slide + noise * 2e-5 * rng.standard_normal(n))


def fit_ring(*rings, stiffness=None):
    return stiffness_and_damping(list(rings), MASS, 0.25**2 * 1e-3, 2e-5**2 * 1e-3, stiffness)


def test_a_late_optidrive_is_found_and_does_not_enter_the_damping():
    late = ringing(delay=0.008, noise=0)
    fit = fit_ring(late)
    assert fit.slide_delay == pytest.approx(0.008, abs=1e-7)
    assert fit.damping == pytest.approx(D, rel=1e-6)
    # the regression of force on displacement and its rate is off by stiffness times delay
    s = np.interp(late.t, late.slide_t, late.slide)
    rows = np.column_stack([s, np.gradient(s, late.t), np.ones(len(s))])
    naive = np.linalg.lstsq(rows[20:], late.force[20:])[0][1]
    assert abs(naive - D) > 0.5 * K * 0.008


def test_the_force_alone_will_do():
    fit = fit_ring(ringing()._replace(slide_t=np.empty(0), slide=np.empty(0)))
    assert fit.stiffness == pytest.approx(K, abs=4.5 * np.sqrt(fit.covariance[0, 0]))
    assert fit.damping == pytest.approx(D, abs=4.5 * np.sqrt(fit.covariance[1, 1]))


def test_what_the_robot_still_moves_is_taken_out():
    moved = ringing(noise=0, way=2e-5)
    assert abs(fit_ring(moved).damping - D) > 0.02
    assert fit_ring(moved._replace(way=2e-5)).damping == pytest.approx(D, rel=1e-6)


def test_noise_does_not_ring():
    rng = np.random.default_rng(4)
    t = np.arange(700) * 1e-3
    assert fit_ring(Ring(t, 0.25 * rng.standard_normal(700), np.empty(0), np.empty(0))) is None


VECTOR = st.lists(st.floats(-5, 5), min_size=3, max_size=3).map(np.array)


@given(VECTOR, st.sampled_from([-0.3, 0.25]))
def test_gain_and_map_multiply_to_the_matrix_and_the_map_is_right_handed(turn, gain):
    matrix = gain * rotation_from_vector(turn)
    axes = split_matrix(matrix, np.zeros((9, 9)), scaled=False)
    np.testing.assert_allclose(axes.gain[:, None] * axes.map, matrix, atol=1e-12)
    np.testing.assert_allclose(axes.gain, gain)
    assert np.linalg.det(axes.map) > 0


def test_a_scaled_left_handed_sensor_is_said_to_be_one():
    axes = split_matrix(np.diag([1.0, -1.0, 1.0]), np.eye(9) * 1e-8, scaled=True)
    assert (axes.gain > 0).all()
    _, y, _, hand = in_words(axes.gain, axes.map)
    assert 'left-handed with positive gains' in hand
    assert 'y of the accelerometer points along -y' in y


def test_errors_of_the_map_hold_along_and_across_its_axes():
    rng = np.random.default_rng(7)
    sigma, off = 1e-3, []
    for _ in range(400):
        matrix = 0.3 * np.eye(3) + sigma * rng.standard_normal((3, 3))
        axes = split_matrix(matrix, sigma**2 * np.eye(9), scaled=False)
        off.append(np.concatenate([(axes.gain - 0.3) / axes.gain_std,
                                   ((axes.map - np.eye(3)) / axes.map_std).ravel()]))
    spread = np.sqrt((np.array(off)**2).mean(axis=0))
    along = [3, 7, 11]
    assert (np.abs(np.delete(spread, along) - 1) < 4 / np.sqrt(2 * 400)).all()
    # of second order there, and rather too wide than too narrow
    assert (spread[along] > 0.5).all() and (spread[along] < 1.1).all()
