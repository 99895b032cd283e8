"""What an effect, or a discrepancy, has to bring."""

from types import SimpleNamespace

from forcecal_ros.core.noise.autoregression import fit_autoregression
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.residual_summary import of_slow_noise, WITHOUT_NAME
import numpy as np
from scipy.signal import lfilter, zpk2tf

N = 6000
SLOW = np.cos(np.pi * np.outer((np.arange(N) + 0.5) / N, np.arange(1, 14)))
"""As many slow cosines as a discrepancy has."""


def pink(rng):
    """Return 1/f noise above a floor, blocks of 4 ms."""
    poles = np.array([0.05, 0.5, 5.0])
    b, a = zpk2tf(np.exp(-2 * np.pi * 10**0.5 * poles / 250), np.exp(-2 * np.pi * poles / 250), 1)
    return lfilter(b, a, rng.standard_normal(2 * N))[N:]


def of_noise_and_gain(residual, features):
    """Follow a residual by features; return what is noise of it, and what it brings."""
    columns = np.zeros((N, len(CHANNELS)))
    columns[:, 0] = residual
    after = columns.copy()
    after[:, 0] -= features @ np.linalg.lstsq(features, residual, rcond=None)[0]
    present = np.zeros(columns.shape, dtype=bool)
    present[:, 0] = True
    noise = [fit_autoregression(after, present, np.ones(N, dtype=int))]
    models = [SimpleNamespace(noise=noise, residuals=[rows]) for rows in (columns, after)]
    white = [noise[0].whiten(rows[np.newaxis, :, 0], 0)[0] for rows in (columns, after)]
    return of_slow_noise(*models), 0.5 * (np.sum(white[0] ** 2) - np.sum(white[1] ** 2))


def test_what_follows_noise_with_a_long_memory_is_mostly_no_discrepancy():
    slow, gain = np.sum([of_noise_and_gain(pink(np.random.default_rng(seed)), SLOW)
                         for seed in range(5)], axis=0)
    assert gain > 5 * 50.0
    # what thirteen weights gain in white noise, 6.5 each time, stays
    assert slow > 0.7 * gain


def test_a_function_of_the_motion_still_shows_beside_such_noise():
    swift = np.cos(2.0 * np.pi * np.outer(np.arange(N) / 250.0, [0.7, 1.0, 1.4, 2.0]))
    residual = np.random.default_rng(1).standard_normal(N) + 0.4 * swift[:, 1]
    slow, gain = of_noise_and_gain(residual, swift)
    # ten times the log-evidence from which something is unexplained
    assert gain - slow > 10.0 * WITHOUT_NAME
