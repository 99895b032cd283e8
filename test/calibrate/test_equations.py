"""The paper's equations one by one, and what it leaves out of each."""

from forcecal_ros.calibrate.accelerometer import identify_static_accelerometer
from forcecal_ros.calibrate.paper import (
    acceleration_error,
    force_error,
    gravity_leak,
    mass_error,
    offset_error,
    operation_count,
    plain_offset,
    step_gain,
)
from forcecal_ros.calibrate.poses import orientation_h, orientation_v, window_mean
from forcecal_ros.calibrate.tool import mass_from_tilt
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import rotation_about, rotation_from_vector
from forcecal_ros.core.streams import Stream
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

G = 9.80665
ANGLES = st.floats(0.0, 2 * np.pi)


@given(ANGLES, ANGLES, ANGLES)
def test_pose_1_is_the_matrix_the_paper_writes_out(alpha, delta, theta):
    ca, sa, cd, sd = np.cos(alpha), np.sin(alpha), np.cos(delta), np.sin(delta)
    ct, s_t = np.cos(theta), np.sin(theta)
    eq10 = [[ca * ct + sa * sd * s_t, -ca * s_t + sa * sd * ct, sa * cd],
            [cd * s_t, cd * ct, -sd],
            [-sa * ct + ca * sd * s_t, sa * s_t + ca * sd * ct, ca * cd]]
    np.testing.assert_allclose(orientation_h(theta, alpha, delta), eq10, atol=1e-12)


@given(ANGLES, ANGLES)
def test_pose_3_is_the_matrix_the_paper_writes_out(delta, theta):
    cd, sd, ct, s_t = np.cos(delta), np.sin(delta), np.cos(theta), np.sin(theta)
    eq13 = [[ct, -s_t, 0], [cd * s_t, cd * ct, -sd], [sd * s_t, sd * ct, cd]]
    np.testing.assert_allclose(orientation_v(theta, delta), eq13, atol=1e-12)


@given(ANGLES)
def test_x_is_horizontal_in_v_and_off_the_vertical_by_theta_in_h(theta):
    assert abs(orientation_v(theta)[2, 0]) < 1e-12
    assert orientation_h(theta)[2, 0] == pytest.approx(-np.cos(theta), abs=1e-12)


def x_force(R, mass, bias):
    return -float(mass * G * -R[2, 0] + bias)


@pytest.mark.parametrize('theta', [0.0, 0.2, -0.5, 2.9])
def test_mass_is_short_by_cos_theta_when_theta_is_not_zero(theta):
    u_h, u_v = (x_force(R(theta), 13.0, 4.0) for R in (orientation_h, orientation_v))
    assert mass_from_tilt(u_h, u_v, G) == pytest.approx(13.0 * abs(np.cos(theta)))
    assert mass_from_tilt(u_h, u_v, G, theta) == pytest.approx(13.0)



def test_a_mass_with_x_as_good_as_horizontal_is_refused():
    with pytest.raises(UnobservableError, match='carries'):
        mass_from_tilt(0.1, 0.0, G, np.pi / 2)


def test_mean_takes_the_window_alone():
    stream = Stream(np.arange(10.0), np.arange(20.0).reshape(10, 2))
    np.testing.assert_array_equal(window_mean(stream, 2.0, 5.0), [6.0, 7.0])


def test_volts_at_rest_are_offset_less_gain_times_gravity_on_three_axes():
    """Eq. 2 for gravity of 10 m/s^2 along each axis; y and z stand for each other."""
    gravity = 10.0 * np.vstack([np.eye(3), -np.eye(3)])
    volts = np.array([[8.0, 4.0, 6.0], [5.0, 4.0, 8.5], [5.0, 1.0, 6.0],
                      [2.0, 4.0, 6.0], [5.0, 4.0, 3.5], [5.0, 7.0, 6.0]])
    found = identify_static_accelerometer(gravity, volts)
    np.testing.assert_allclose(found.offset, [5.0, 4.0, 6.0])
    np.testing.assert_allclose(
        found.matrix, [[-0.3, 0.0, 0.0], [0.0, 0.0, 0.3], [0.0, -0.25, 0.0]], atol=1e-12)


def ringing(delay=0.0, noise=0.0, n=1000, gain=-0.2937, seed=1):
    """Volts less offset and (u - u^v) / m of a 3 Hz ringing, the volts ``delay`` late."""
    t = np.arange(n) * 1e-3

    def f(t):
        return 2 * np.exp(-5 * np.maximum(t, 0)) * np.sin(19 * np.maximum(t, 0)) * (t > 0)

    rng = np.random.default_rng(seed)
    return gain * f(t - delay) + noise * rng.standard_normal(n), f(t)


def test_step_gain_is_exact_without_noise_and_delay():
    assert step_gain(*ringing()) == pytest.approx(-0.2937, rel=1e-12)


def test_noise_of_the_regressor_pulls_the_plain_gain_up_and_correction_takes_it_off():
    plain, corrected = [], []
    for seed in range(40):
        theta, Y = ringing(noise=0.1, seed=seed)
        plain.append(step_gain(theta, Y) / -0.2937 - 1)
        corrected.append(step_gain(theta, Y, 0.01) / -0.2937 - 1)
    theta, Y = ringing()
    attenuation = 0.01 * len(theta) / (theta @ theta)
    # variance of theta^T theta for noise 0.1, over 40 seeds
    std = np.sqrt(2 * 0.01**2 * len(theta) + 4 * 0.01 * (theta @ theta)) / (theta @ theta)
    assert abs(np.mean(plain) - attenuation) < 4 * std / np.sqrt(40)
    assert abs(np.mean(corrected)) < 4 * std / np.sqrt(40)
    assert attenuation > 10 * std / np.sqrt(40)



def test_a_step_that_does_not_stand_out_is_refused():
    with pytest.raises(UnobservableError, match='within the noise'):
        step_gain(np.full(100, 0.01), np.zeros(100), 0.01)


def test_plain_offset_is_the_mean_and_wrong_by_what_an_ac_sensor_remembers():
    t = np.arange(0, 6, 1e-3)
    tau = 1 / (2 * np.pi * 0.01)
    # settled in h, 4 s after it was left for v
    volts = 5.9616 + 0.2525 * G * np.exp(-(t + 0.0) / tau)
    assert plain_offset(np.full((10, 1), 5.0)) == pytest.approx(5.0)
    assert abs(plain_offset(volts[:, None])[0] - 5.9616) > 0.4


def test_operations_count_the_samples_of_the_procedure():
    assert operation_count((0, 2, 5, 7, 8), 1000.0) == 7000


WEIGHT = 13.0 * G * np.array([0.0, 0.0, -1.0])


@given(st.floats(-0.2, 0.2))
def test_mass_error_is_the_difference_of_the_two_masses(tilt):
    assumed = orientation_h() @ rotation_about('y', tilt)
    error = mass_error(orientation_h(), assumed, orientation_v(), orientation_v(), WEIGHT, WEIGHT,
                       G)
    assert error == pytest.approx(13.0 * (1 - np.cos(tilt)), abs=1e-9)


def test_offset_error_vanishes_where_the_frames_are_aligned():
    offset = np.array([5.0938, 0.0, 0.0])
    R = orientation_v()
    assert offset_error(R, R, offset) == 0
    turned = R @ rotation_about('z', 0.1)
    assert offset_error(R, turned, offset) == pytest.approx(5.0938 * (1 - np.cos(0.1)))


def test_gravity_leaks_into_the_offset_of_a_tilted_sensor():
    tilted = orientation_v() @ rotation_about('y', 0.01)
    felt = tilted.T @ np.array([0.0, 0.0, G])
    assert gravity_leak(tilted, -0.2937, G) == pytest.approx(-0.2937 * felt[0])


def test_acceleration_error_is_that_of_the_inverted_map():
    volts = 5.0938 - 0.2937 * 3.0
    wrong = (volts - 5.1) / -0.29
    assert acceleration_error(volts, 5.0938, -0.2937, 5.1 - 5.0938, 0.2937 - 0.29) \
        == pytest.approx(3.0 - wrong)


def test_force_error_vanishes_with_its_causes_and_grows_with_each():
    R = orientation_v()
    a = 3.0 * R[:, 0]
    assert force_error(13.0, 0.0, R, R, a, np.zeros(3)) == pytest.approx(0.0, abs=1e-12)
    assert force_error(13.0, 0.1, R, R, a, np.zeros(3)) == pytest.approx(0.3)
    assert force_error(13.0, 0.0, R, R, a, 0.01 * R[:, 0]) == pytest.approx(0.13)
    turned = R @ rotation_from_vector(np.array([0.0, 0.2, 0.0]))
    assert force_error(13.0, 0.0, R, turned, a, np.zeros(3)) == pytest.approx(
        39 * (np.cos(0.2) - 1))
