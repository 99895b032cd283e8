"""High-passes of block means; a sensor that drifts at rest has one, another a loose mount."""

from types import SimpleNamespace

from forcecal_ros.calibrate.accelerometer import fading, lowpassed
from forcecal_ros.calibrate.findings import _accelerometer_remedy
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.streams import Stream
import numpy as np
import pytest


def test_the_highpass_of_block_means_is_that_of_the_signal():
    cutoff, dt, length = 0.2, 1e-4, 0.02
    t = np.arange(0, 6, dt) + dt / 2
    f = np.sin(3 * t) + (t > 2)
    keep = np.exp(-2 * np.pi * cutoff * dt)
    w, state = np.empty_like(t), 1.5
    for i, value in enumerate(f):
        w[i] = state + (value - state) * (1 - keep) / 2
        state = keep * state + (1 - keep) * value
    blocks = f.reshape(-1, 200).mean(axis=1)
    found = lowpassed(blocks, length, cutoff) + 1.5 * fading(len(blocks), length, cutoff)
    np.testing.assert_allclose(found, w.reshape(-1, 200).mean(axis=1), atol=2e-4)


@pytest.mark.parametrize('decays, coupling, said', [
    (True, 'dc', 'calibrate with --coupling ac'), (False, 'dc', 'tighten its mount'),
    (True, 'ac', 'tighten its mount')])
def test_the_advice_follows_from_what_the_readings_do_at_rest(decays, coupling, said):
    t = np.arange(0.0, 4.0, 0.001)
    values = np.random.default_rng(1).normal(0.0, 0.02, (len(t), 3))
    if decays:
        values += 3.0 * np.exp(-(t % 2.0) / 1.5)[:, None]
    stages = SimpleNamespace(
        recording=SimpleNamespace(accelerometer=Stream(t, values, 'accelerometer')),
        poses=[SimpleNamespace(start=0.1, end=1.9), SimpleNamespace(start=2.1, end=3.9)])
    settings = IdentificationSettings(coupling=coupling)
    assert said in _accelerometer_remedy(stages, settings)
