"""The paper's observer: what it is, and that its noise is that of u - m a."""

from dataclasses import replace

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.observe import ObserverSettings, replay
from forcecal_ros.observe.contact import newton_step, NewtonState
from longer import first
import numpy as np
from observing import calibration, K1, K2, push, record, Swing
import pytest
from scipy.signal import welch

MASS, DT = 13.0, 0.001
FAST = np.array([[600.0, 0.0, 0.0], [9e4, 300.0, 1.0]])
"""Poles at 300 rad/s and beyond."""


def gain(K):
    return tuple(float(x) for x in K.ravel())


def run(u, a, x, v, K):
    """Return the force of [Gamez2005] Eq. 3 over time."""
    state, force = NewtonState(x[0], v[0]), []
    for row in zip(u, a, x, v):
        state, f = newton_step(state, DT, *(*map(float, row), MASS, gain(K)))
        force.append(f)
    return np.array(force)


def noise(n=20000, seed=0):
    """White noise of the rig's sensors; x and dx/dt as a pose filter has them."""
    rng = np.random.default_rng(seed)
    u, a = rng.normal(scale=0.25, size=n), rng.normal(scale=0.034, size=n)
    return u, a, rng.normal(scale=2e-5, size=n), rng.normal(scale=2e-3, size=n)


def decibels(K, low=50.0, high=200.0):
    u, a, x, v = noise()
    f, out = welch(run(u, a, x, v, K), 1 / DT, nperseg=1024)
    _, inside = welch(u - MASS * a, 1 / DT, nperseg=1024)
    band = (f >= low) & (f <= high)
    return 10 * np.log10(out[band].mean() / inside[band].mean())


@pytest.mark.parametrize('K', first([K1, K2]), ids=['accelerometer 1', 'accelerometer 2'])
def test_with_k23_of_one_the_noise_of_u_minus_m_a_passes_undiminished(K):
    """0 dB with the gains of Eq. 32 and 33: Fig. 6 cannot come from Eq. 3 as printed."""
    assert decibels(K) == pytest.approx(0.0, abs=0.01)


def test_error_dynamics_are_those_of_equation_4():
    """From a wrong start the error fades with the eigenvalues of A - K C."""
    K = np.array([[30.0, 0.0, 0.0], [200.0, 5.0, 1.0]])
    n = 400
    state, error = NewtonState(0.01, 0.1), []
    for _ in range(n):
        state, _ = newton_step(state, DT, 0.0, 0.0, 0.0, 0.0, MASS, gain(K))
        error.append(state)
    A = np.array([[0.0, 1.0], [0.0, 0.0]]) - K @ np.array([[1.0, 0], [0, 1.0], [0, 0]])
    from scipy.linalg import expm
    wanted = expm(A * n * DT) @ [0.01, 0.1]
    assert np.array(error[-1]) == pytest.approx(wanted, abs=1e-5)


def test_force_is_u_minus_m_times_the_observers_own_acceleration():
    rng = np.random.default_rng(1)
    state = NewtonState(0.01, -0.02)
    for _ in range(50):
        u, a, x, v = rng.normal(size=4)
        after, force = newton_step(state, DT, u, a, x, v, MASS, gain(FAST))
        k = FAST
        own = (u / MASS + k[1, 0] * (x - after.x) + k[1, 1] * (v - after.v)
               + k[1, 2] * (a - u / MASS))
        assert force == pytest.approx(u - MASS * own, rel=1e-9)
        state = after


def test_mode_newton_publishes_newtons_law_on_all_axes():
    swing = Swing(place=(0.012, 0.004, 0.006), slide=0.003)
    recording = record(3.0, swing, push(0, 20.0, 1.0), seed=3)
    estimate = replay(recording, calibration(K=K1), ObserverSettings('newton'))
    assert estimate.contact[:, 1:] == pytest.approx(estimate.measured[:, 1:])
    late = estimate.t > 2.0
    ratio = estimate.contact[late, 0].std() / estimate.measured[late, 0].std()
    assert 20 * np.log10(ratio) == pytest.approx(0.0, abs=0.2)
    assert estimate.contact[late, 0].mean() == pytest.approx(20.0, abs=0.1)


def test_the_calibration_names_the_mode_and_the_settings_override_it():
    known = calibration()
    named = replace(known, observer=replace(known.observer, mode='newton'))
    recording = record(0.5)
    newton = replay(recording, named)
    kalman = replay(recording, named, ObserverSettings('kalman'))
    assert newton.contact[-50:, 1].std() > 2 * kalman.contact[-50:, 1].std()
    with pytest.raises(ConfigError, match='observer.K'):
        replay(recording, replace(known, observer=None), ObserverSettings('newton'))
