"""Steps are found where they are, noise and impulses are none, and no noise is made of them."""

from forcecal_ros.core.noise.autoregression import fit_autoregression
from forcecal_ros.core.noise.steps import steps, without_steps
import numpy as np
import pytest

SIGMA = 0.125


@pytest.fixture
def noise():
    """Return a minute of blocks of 4 ms."""
    return SIGMA * np.random.default_rng(0).standard_normal(15_000)


@pytest.mark.parametrize('height', [-0.5, 3.0])
def test_a_step_is_found_to_a_few_samples_with_its_height(noise, height):
    stepped = noise + height * (np.arange(len(noise)) >= 7000)
    step, = steps(stepped)
    # a jump is told from its neighbour by (height / SIGMA)^2 / 2 a sample: 10 are 80 nats
    assert abs(step.first - 7000) <= 10
    assert step.height == pytest.approx(height, abs=5.0 * step.std)


def test_two_steps_make_a_gap_between_them(noise):
    noise[5000:9000] += 1.0
    assert sorted(round(s.height) for s in steps(noise)) == [-1, 1]


def test_noise_impulses_and_slow_drift_are_no_steps(noise):
    assert not steps(noise)
    assert not steps(noise + np.linspace(0.0, 5.0, len(noise)))
    noise[[3000, 8000]] += 20.0
    assert not steps(noise)


def test_noise_is_not_estimated_over_a_step(noise):
    there = np.ones((len(noise), 1), dtype=bool)
    stepped = (noise + 3.0 * (np.arange(len(noise)) >= 7000))[:, np.newaxis]
    model = fit_autoregression(stepped, there, np.zeros(len(noise), dtype=np.intp))
    # 9 numbers of 15,000 samples: 1 %; with the step in it: 1.5 N
    assert model.rms()[0] == pytest.approx(SIGMA, rel=0.05)
    assert without_steps(stepped, there).std() == pytest.approx(SIGMA, rel=0.05)
