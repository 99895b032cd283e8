"""The paper's observer gain: Riccati equation, pole placement, what k23 = 1 does and does not."""

from forcecal_ros.calibrate.gain import (
    error_dynamics,
    measurement_covariance,
    observer_model,
    pole_gain,
    process_covariance,
    riccati_gain,
    sample_covariance,
    stream_covariance,
    with_unit_k23,
)
from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.streams import PoseStream, Stream
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp

MODEL = observer_model(13.0)
Q = process_covariance(0.25**2, 1000.0, 13.0)
R_SAMPLE = np.array([[4e-10, 1e-7, -2e-8], [1e-7, 5e-5, 3e-6], [-2e-8, 3e-6, 3e-4]])
R = R_SAMPLE * 0.004


def test_the_gain_solves_the_riccati_equation():
    K = riccati_gain(MODEL.A, MODEL.C, Q, R)
    # P from K = P C^T R^-1, its first two columns; then Eq. 19
    P = K @ R @ np.linalg.pinv(MODEL.C.T)
    left = P @ MODEL.A.T + MODEL.A @ P - P @ MODEL.C.T @ np.linalg.inv(R) @ MODEL.C @ P + Q
    np.testing.assert_allclose(left, 0, atol=1e-9 * np.abs(Q).max())
    np.testing.assert_allclose(P, P.T, rtol=1e-6)
    np.testing.assert_allclose(K, P @ MODEL.C.T @ np.linalg.inv(R), rtol=1e-6)


def observe(K, contact, u, duration=3.0):
    """Integrate tool and observer (Eq. 4, 5) and Eq. 3 as printed; return the error, the force."""
    m = 13.0

    def flow(_, state):
        x, v, e1, e2 = state
        a = (u - contact) / m
        y = np.array([x, v, a])
        guess = np.array([x - e1, v - e2])
        rate = MODEL.A @ guess + MODEL.B * u + K @ (y - MODEL.C @ guess - MODEL.D_u * u)
        return [v, a, v - rate[0], a - rate[1]]

    end = solve_ivp(flow, (0, duration), [0.1, 0.0, 0.01, -0.02], rtol=1e-9, atol=1e-12,
                    method='LSODA').y[:, -1]
    error, a = end[2:], (u - contact) / m
    return error, K[1, 2] * u - K[1, 2] * m * a - K[1, 0] * m * error[0]


def test_the_observers_error_follows_equation_4():
    K = with_unit_k23(riccati_gain(MODEL.A, MODEL.C, Q, R))
    F, b = error_dynamics(MODEL, K)
    predicted = solve_ivp(lambda _, e: F @ e + b * 20.0, (0, 0.05), [0.01, -0.02], rtol=1e-10,
                          atol=1e-14).y[:, -1]
    error, _ = observe(K, 20.0, 5.0, 0.05)
    np.testing.assert_allclose(error, predicted, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize('k23', [0.0, 0.5, 1.0])
def test_k23_moves_the_static_gain_of_equation_3(k23):
    K = pole_gain(MODEL.A, MODEL.C, (-30.0, -40.0))
    K[1, 2] = k23
    error, force = observe(K, 20.0, 20.0)
    F, b = error_dynamics(MODEL, K)
    static = -np.linalg.solve(F, b)
    np.testing.assert_allclose(error, static * 20.0, atol=1e-6)
    gain = k23 - 13.0 * K[1, 0] * static[0]
    assert force == pytest.approx(20.0 * gain, rel=1e-5)
    if k23 == 1.0:
        assert force == pytest.approx(20.0, rel=1e-5)


@given(st.floats(-200, -1), st.floats(1.1, 5))
def test_poles_are_put_where_they_are_wanted(pole, ratio):
    K = with_unit_k23(pole_gain(MODEL.A, MODEL.C, (pole, ratio * pole)))
    found = np.sort(np.linalg.eigvals(error_dynamics(MODEL, K)[0]).real)
    np.testing.assert_allclose(found, np.sort([pole, ratio * pole]), rtol=1e-6)
    assert K[1, 2] == 1


def test_a_measurement_without_noise_is_refused():
    with pytest.raises(UnobservableError, match='singular'):
        riccati_gain(MODEL.A, MODEL.C, Q, np.diag([1.0, 1.0, 0.0]))


def test_process_noise_is_the_forces_through_b():
    np.testing.assert_allclose(Q, [[0, 0], [0, 0.25**2 / 13**2 / 1000]])


def test_a_covariance_at_rest_leaves_each_poses_own_mean_out():
    rng = np.random.default_rng(5)
    L = np.array([[1.0, 0.0], [0.6, 0.8]])
    n = 4000
    t = np.arange(2 * n) * 1e-3
    values = rng.standard_normal((2 * n, 2)) @ L.T
    values[n:] += [100.0, -50.0]
    poses = [StaticPose(0.0, n * 1e-3, np.eye(3)),
             StaticPose(n * 1e-3, 2 * n * 1e-3, np.eye(3))]
    found = stream_covariance(Stream(t, values), poses)
    assert (np.abs(found.value - L @ L.T) < 4 * found.std).all()
    assert found.rate == pytest.approx(1000.0)
    np.testing.assert_allclose(found.density, found.value / 1000)


def test_the_noise_of_position_enters_its_difference_and_makes_the_two_correlated():
    """R of y = [x, dx/dt, d2x/dt2] at 250 Hz: 2e-5 m in x, 0.04 m/s^2 at 1 kHz."""
    rng, n = np.random.default_rng(8), 20_000
    t, fine = 0.004 * np.arange(n), 0.001 * np.arange(4 * n)
    pose = PoseStream(t, [1.0, 0.0, 1.0] + 2e-5 * rng.standard_normal((n, 3)),
                      np.broadcast_to(np.eye(3), (n, 3, 3)))
    force = Stream(fine, 0.04 * rng.standard_normal((4 * n, 3)))
    still = StaticPose(0.1, t[-1], np.eye(3))
    found = measurement_covariance([still], pose, None, force)
    # (2e-5)^2; (2e-5)^2 / 4 ms; 2 (2e-5)^2 / (4 ms)^2
    expected = np.array([[4e-10, 1e-7, 0.0], [1e-7, 5e-5, 0.0], [0.0, 0.0, found.value[2, 2]]])
    assert (np.abs(found.value - expected) < 5 * found.std).all()
    assert 0.04**2 / 5 < found.value[2, 2] < 0.04**2 / 4  # averages of four to five samples
    assert found.rate == pytest.approx(250.0)
    np.testing.assert_allclose(found.density, found.value * 0.004)


def test_standard_errors_of_a_covariance_hold():
    rng = np.random.default_rng(6)
    off = []
    for _ in range(200):
        found = sample_covariance([rng.standard_normal((200, 2)) for _ in range(2)], 100.0)
        off.append((found.value - np.eye(2)) / found.std)
    spread = np.std(off, axis=0)
    assert (np.abs(spread - 1) < 4 / np.sqrt(2 * 200)).all()


def test_too_few_samples_give_no_covariance():
    assert sample_covariance([np.ones((5, 2))], 100.0) is None
