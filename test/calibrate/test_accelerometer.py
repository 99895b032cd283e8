"""High-passes of block means."""
from forcecal_ros.calibrate.accelerometer import fading, lowpassed
import numpy as np


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
