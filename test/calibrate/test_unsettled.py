"""What still rings while the robot stands, and noise that seems to cancel, in static poses."""

from calibration_runs import run
from forcecal_ros.calibrate.means import grid_recording
from forcecal_ros.calibrate.poses import static_poses
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.statics import read_statics
from forcecal_ros.calibrate.unsettled import Mode, unsettled
from forcecal_ros.core.noise.autocovariance import Autocovariance
import numpy as np
import pytest

MODE = Mode(5.0, 19.0)
K, D = 13.0 * (MODE.decay ** 2 + MODE.omega ** 2), 2 * 13.0 * MODE.decay
T = np.arange(1000) * 1e-3
NOISE = 20e-6
SIZE, PHASE = 1e-4, 0.7
SLIDE = 2e-3 + SIZE * np.exp(-MODE.decay * T) * np.cos(MODE.omega * T + PHASE)
SPEED = np.gradient(SLIDE, 1e-3)


def truth():
    """Mean acceleration by the speed at the edges, mean displacement by the sum."""
    return (SPEED[-1] - SPEED[0]) / 1.0, (SLIDE - 2e-3).mean()


@pytest.mark.parametrize('force', [None, (K, D)])
def test_what_is_left_of_the_ringing_is_found_in_its_noise(force):
    acceleration, slide = truth()
    seen, noise = (SLIDE, NOISE) if force is None else (K * SLIDE + D * SPEED, 0.25)
    z = []
    for seed in range(100):
        values = seen + np.random.default_rng(seed).normal(scale=noise, size=len(T))
        found = unsettled(T, values, 1.0, MODE, force)
        z.append((found.acceleration - acceleration) / found.std)
    assert np.mean(z) == pytest.approx(0.0, abs=4 / np.sqrt(len(z)))
    assert np.std(z) == pytest.approx(1.0, abs=4 / np.sqrt(2 * len(z)))
    assert found.slide == pytest.approx(slide, rel=0.2)


def test_noise_that_seems_to_cancel_in_means_is_taken_for_white():
    """A few hundred values show it by accident, and means would be known too well by half."""
    recording, settings = run(seed=5), IdentificationSettings()
    poses = static_poses(recording)
    gridded = grid_recording(recording, poses, settings)
    white = gridded.noise.lags[0]
    cancels = Autocovariance(np.stack([white, -0.4 * white]), np.ones(1), 0.2)
    statics = read_statics(recording, poses, settings, gridded._replace(noise=cancels))
    span = poses[0].end - poses[0].start
    np.testing.assert_allclose(np.diag(statics.covariance[0]),
                               np.diag(white) * gridded.grid.length / span, rtol=1e-6)
