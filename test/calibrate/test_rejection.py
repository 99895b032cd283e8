"""The rejection test names the pose that is off and no other, and what changed between poses."""

from dataclasses import replace
from re import search

from calibration_runs import run
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.rejection import PoseError, rejected, what_changed
from forcecal_ros.calibrate.static_readings import Statics
from forcecal_ros.core.streams import Stream
from forcecal_ros.nodes.collector import Collector
from forcecal_ros.report.calibration import in_words
import numpy as np
import pytest


@pytest.fixture(scope='module')
def recording():
    return run(seed=2)


def pulled(recording, pose, force):
    """Return the quality where a cable pulls along y while one pose is measured."""
    phase = [one for one in recording.phases if one.name == 'measure'][pose - 1]
    wrench = recording.wrench
    values = np.array(wrench.values)
    values[(wrench.t >= phase.start - 0.5) & (wrench.t < phase.end), 1] += force
    return identify(replace(recording, wrench=Stream(wrench.t, values, wrench.frame))).quality


def test_a_sound_run_rejects_no_pose(recording):
    quality = identify(recording).quality
    assert quality['rejection']['pose'] is None and len(quality['rejection']['poses']) == 4
    assert dict(in_words(quality))['Rejection test'].startswith('No pose is off')


@pytest.mark.parametrize('pose', [1, 2, 3, 4])
def test_a_pose_that_a_cable_pulls_in_is_named_with_the_pull(recording, pose):
    """0.15 N: 15 standard errors of what the others predict, 0.1 % of the weight."""
    quality = pulled(recording, pose, 0.15)
    assert quality['rejection']['pose'] == pose
    off = quality['rejection']['poses'][pose - 1]['off']
    assert off[1] == pytest.approx(0.15, abs=0.05)
    assert any(f'pose {pose} is off by' in line for line in quality['warnings'])
    assert f'Pose {pose} would be rejected' in dict(in_words(quality))['Rejection test']


def test_the_threshold_is_for_all_poses_together():
    def errors(*chances):
        return [PoseError(np.zeros(6), 0.0, one) for one in chances]

    assert rejected(errors(0.5, 2e-4, 0.5, np.nan), 1e-3) == 1
    assert rejected(errors(0.5, 3e-4, 0.5, 0.5), 1e-3) is None
    assert rejected(errors(np.nan, np.nan), 1e-3) is None and rejected([], 1e-3) is None


def test_a_rejected_pose_counts_no_more():
    collector = Collector('V', 1)
    for k in range(10):
        collector.add('wrench', k * 10**8, (0.0,) * 6)
        collector.add('pose', k * 10**8, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    for k, phase in enumerate(('measure', 'move', 'measure', 'move', 'measure')):
        collector.enter(phase, 2 * k * 10**8)
    collector.reject(1)
    assert [phase.name for phase in collector.recording().phases] == [
        'measure', 'move', 'idle', 'move', 'measure']


N = 12
TIMES = 5.0 * np.arange(N)
AFTER = (np.arange(N) >= 7)[:, None]


def said(change, seed=0):
    """Return what is said of poses whose wrench is changed by ``change(gravity)``, (n, 6)."""
    rng = np.random.default_rng(seed)
    down = rng.standard_normal((N, 3))
    g = 9.8 * down / np.linalg.norm(down, axis=1)[:, None]
    std = np.array([0.01] * 3 + [3e-4] * 3)
    wrench = load(g, 1.3, [0.01, 0.0, 0.07]) + [3, -5, 8, 0.1, -0.2, 0.05]
    wrench = wrench + change(g) + std * rng.standard_normal((N, 6))
    zeros = np.zeros(N)
    return what_changed(Statics(g, wrench, np.broadcast_to(np.diag(std**2), (N, 6, 6)), zeros,
                                zeros), TIMES)


def load(g, mass, com):
    return np.hstack([mass * g, np.cross(com, mass * g)])


def touched(g):
    off = np.zeros((N, 6))
    off[[2, 9], 0], off[[2, 9], 4] = [5.0, -3.0], [0.2, 0.4]
    return off


@pytest.mark.parametrize('change, words', [
    (lambda g: AFTER * [-2.0, 3.0, -8.0, -0.1, 0.1, 0.0],
     r'a bias that jumps between pose 7 and pose 8 \(30.0 to 35.0 s\): a sensor tared'),
    (lambda g: AFTER * load(g, 0.4, [0.0, 0.0, 0.15]),
     'a load that changes between pose 7 and pose 8'),
    (lambda g: AFTER * (load(g, 1.3, [0.01, 0.004, 0.07]) - load(g, 1.3, [0.01, 0.0, 0.07])),
     'a load that changes between pose 7 and pose 8'),
    (lambda g: 2.0 * (1.0 - np.exp(-TIMES / 60.0))[:, None] * np.ones(6), 'a bias that drifts'),
    (touched, 'without poses 3, 10 they fit one tool: a cable or a hand pulled')])
def test_the_one_change_is_named(change, words):
    for seed in range(10):
        assert search(words, said(change, seed)), said(change, seed)


def test_noise_and_a_cable_are_no_change():
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        assert not said(lambda g: np.zeros((N, 6)), seed)
        assert not said(lambda g, rng=rng: 0.5 * rng.standard_normal((N, 6)), seed)
