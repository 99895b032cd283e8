"""Poses that are off are named and no others; a drift at rest is, and noise is none."""


from calibration_runs import run
from changed import with_values
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.residuals import drift, PoseError, rejected, touched
from forcecal_ros.calibrate.tool import Statics
from forcecal_ros.report.calibration import in_words
from longer import first
import numpy as np
import pytest
from scipy.signal import lfilter


@pytest.fixture(scope='module')
def recording():
    return run(seed=2)


@pytest.fixture(scope='module')
def sound(recording):
    return identify(recording)


def pulled(recording, pose, force):
    """Calibrate where a cable pulls along y while one pose is measured."""
    phase = [one for one in recording.phases if one.name == 'measure'][pose - 1]
    t = recording.wrench.t
    pull = np.outer((t >= phase.start - 0.5) & (t < phase.end), force * np.eye(6)[1])
    return identify(with_values(recording, lambda values: values + pull))


def test_a_sound_run_rejects_no_pose(sound):
    quality = sound.quality
    assert quality['rejection']['pose'] is None and len(quality['rejection']['poses']) == 4
    assert dict(in_words(quality))['Rejection test'].startswith('No pose differs')


@pytest.mark.parametrize('pose', first([2, 1, 3, 4]))
def test_a_pose_that_a_cable_pulls_in_is_named_with_the_pull_and_widens_errors(
        recording, sound, pose):
    """0.15 N: 15 standard errors of what the others predict, 0.1 % of the weight."""
    found = pulled(recording, pose, 0.15)
    quality = found.quality
    assert 2.5 < found.mass.std / sound.mass.std < 50.0
    assert abs(float(found.mass) - 13.0) < 2e-4 * 13.0
    assert quality['rejection']['pose'] == pose
    off = quality['rejection']['poses'][pose - 1]['off']
    assert off[1] == pytest.approx(0.15, abs=0.05)
    assert any(f'pose {pose} deviates by' in line for line in quality['warnings'])
    assert f'Pose {pose} would be rejected' in dict(in_words(quality))['Rejection test']


def test_the_threshold_is_for_all_poses_together():
    def errors(*chances):
        return [PoseError(np.zeros(6), 0.0, one) for one in chances]

    assert rejected(errors(0.5, 2e-4, 0.5, np.nan), 1e-3) == 1
    assert rejected(errors(0.5, 3e-4, 0.5, 0.5), 1e-3) is None
    assert rejected(errors(np.nan, np.nan), 1e-3) is None and rejected([], 1e-3) is None
    # too small for a number
    beyond = [PoseError(np.zeros(6), 0.0, 0.0, one) for one in (3e3, 9e5, 2e3)]
    assert rejected(beyond, 1e-3) == 1


def poses(change, seed, n=12):
    """Return poses whose wrench is changed by ``change`` (n, 6)."""
    rng = np.random.default_rng(seed)
    down = rng.standard_normal((n, 3))
    g = 9.8 * down / np.linalg.norm(down, axis=1)[:, None]
    std = np.array([0.01] * 3 + [3e-4] * 3)
    load = np.hstack([1.3 * g, np.cross([0.01, 0.0, 0.07], 1.3 * g)])
    wrench = load + [3, -5, 8, 0.1, -0.2, 0.05] + change + std * rng.standard_normal((n, 6))
    return Statics(g, wrench, np.broadcast_to(np.diag(std**2), (n, 6, 6)), np.zeros(n),
                   np.zeros(n))


@pytest.mark.parametrize('seed', first(range(10), 2))
def test_poses_that_are_touched_are_named_where_the_others_fit_one_tool(seed):
    off = np.zeros((12, 6))
    off[[2, 9], 0], off[[2, 9], 4] = [5.0, -3.0], [0.2, 0.4]
    assert touched(poses(off, seed)) == [2, 9]
    assert touched(poses(0.0, seed)) == []
    rng = np.random.default_rng(100 + seed)
    assert touched(poses(0.5 * rng.standard_normal((12, 6)), seed)) == []


def test_a_drift_is_found_where_it_is_and_noise_is_none():
    rng = np.random.default_rng(11)
    t = np.arange(0, 4, 0.001)
    values = 0.01 * rng.standard_normal((len(t), 3))
    assert drift([values[:2000], values[2000:]])[0] < 5
    values[2000:, 1] += 0.01 * np.exp(-(t[2000:] - 2) / 0.5)
    sigmas, pose, channel = drift([values[:2000], values[2000:]])
    assert sigmas > 6 and (pose, channel) == (1, 1)


def test_noise_that_a_filter_of_two_hertz_has_passed_is_no_drift():
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 40.0, 0.004)
    a = np.exp(-2 * np.pi * 2.0 * 0.004)
    values = lfilter([1.0 - a], [1.0, -a], rng.standard_normal((len(t), 6)), axis=0)
    parts = [values[1000 * i:1000 * i + 750] for i in range(10)]
    assert drift(parts)[0] < 6
    values[:750, 2] += 1.0 * t[:750]
    assert drift(parts) > (6, 0, 2)
