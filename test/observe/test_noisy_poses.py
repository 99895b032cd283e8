"""Poses noisier than expected: the recording shows it, and no noise is called contact."""

from dataclasses import replace

from forcecal_ros.core.calibration import Calibration, Estimate, Noise
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.observe import ObserverSettings, replay
from forcecal_ros.observe.playback import with_pose_noise
from forcecal_ros.observe.settings import POSE_RATE_HZ
from longer import first
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

MASS, COM = 0.95, np.array([0.012, -0.006, 0.065])
BIAS = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.1])
SIGMA = np.repeat([0.08, 0.004], 3)
POSITION_NOISE, ROTATION_NOISE = 1e-4, 2e-4
HOME = Rotation.from_euler('xyz', [2.8, 0.3, 0.2])
SECONDS, TOUCH = 20.0, (10.0, 12.0)


def known(value, unit):
    return Estimate(np.asarray(value, float), 0.0, unit)


CALIBRATION = Calibration(
    mass=known(MASS, 'kg'), com=known(COM, 'm'), wrench_bias=known(BIAS, 'N, N m'),
    inertia=known(np.diag([0.003, 0.003, 0.001]), 'kg m^2'),
    noise=Noise(known(np.eye(2), '(m, m/s)^2 s'), known(np.eye(3), '(m, m/s, m/s^2)^2 s'),
                known(np.diag(SIGMA ** 2), '(N, N m)^2'), None, 500.0))


def poses(rate, noise=1.0, swing=0.0, jitter=0.0, seed=3):
    """Poses of an arm that rests, or swings by ``swing`` [rad] and as many decimetres at 1 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, round(SECONDS * rate)) / rate
    t += jitter / rate * rng.uniform(-0.5, 0.5, len(t))
    angle = swing * np.sin(2 * np.pi * t)
    R = HOME * Rotation.from_rotvec(angle[:, None] * [0.0, 1.0, 0.0])
    R = R * Rotation.from_rotvec(noise * ROTATION_NOISE * rng.normal(size=(len(t), 3)))
    place = [0.4, 0.1, 0.5] + 0.1 * angle[:, None] + noise * POSITION_NOISE * rng.normal(
        size=(len(t), 3))
    return PoseStream(t, place, R.as_matrix())


@pytest.fixture(scope='module')
def at_rest():
    """Complete rest, wrench at 500 Hz, pose at 125 Hz, a push of 1 N for two seconds."""
    rng = np.random.default_rng(4)
    t = np.arange(round(SECONDS * 500)) / 500
    weight = MASS * HOME.inv().apply([0.0, 0.0, -9.80665])
    wrench = BIAS + np.r_[weight, np.cross(COM, weight)] + SIGMA * rng.normal(size=(len(t), 6))
    wrench[(t >= TOUCH[0]) & (t < TOUCH[1]), 0] += 1.0
    return Recording(wrench=Stream(t, wrench), pose=poses(125.0))


def test_at_rest_only_the_push_is_contact(at_rest):
    found = replay(at_rest, CALIBRATION, ObserverSettings('ukf'))
    free = (found.t > 0.5) & ((found.t < TOUCH[0]) | (found.t > TOUCH[1] + 1.0))
    assert not found.learned.touching[free].any()
    assert found.learned.touching[(found.t > TOUCH[0] + 0.1) & (found.t < TOUCH[1])].all()
    # chi-square with 6 degrees of freedom; the pose's part is correlated over some readings
    assert found.learned.nis[free].mean() == pytest.approx(6.0, rel=0.1)


def test_the_pose_filters_slow_down_for_noisy_poses(at_rest):
    noisy, quiet = (replay(replace(at_rest, pose=poses(125.0, noise)), CALIBRATION)
                    for noise in (1.0, 0.01))
    ours, best = (one.contact[500:4500].std(axis=0) for one in (noisy, quiet))
    # 3.2 times in the torque where the filters expect poses of 0.02 mrad
    assert (ours < 2.5 * best).all()


@pytest.mark.parametrize('rate, swing, jitter', first([
    (125.0, 0.3, 0.8), (500.0, 0.0, 0.5), (125.0, 0.0, 0.0), (125.0, 0.3, 0.0), (250.0, 0.3, 0.0)],
    2))
def test_the_noise_is_that_of_the_poses_in_rest_and_motion(rate, swing, jitter):
    found = with_pose_noise(ObserverSettings(), poses(rate, 5.0, swing, jitter))
    scale = 5.0 * np.sqrt(POSE_RATE_HZ / rate)
    # the quieter quarter of blocks of 50 is 5 % below the mean
    assert found.pose_position_std == pytest.approx(scale * POSITION_NOISE, rel=0.1)
    assert found.pose_rotation_std == pytest.approx(scale * ROTATION_NOISE, rel=0.1)


@pytest.mark.parametrize('pose', [
    None, poses(125.0, 0.01), poses(250.0, 0.01, 0.3), poses(20.0, 1.0, 0.3)],
    ids=['none', 'quiet', 'quiet, moving', 'slow'])
def test_quiet_and_slow_poses_leave_the_settings(pose):
    assert with_pose_noise(ObserverSettings(), pose) == ObserverSettings()
