"""Claims about the rig as a whole, against recordings from independent implementations."""

from dataclasses import replace

from forcecal_ros.core.streams import PoseStream
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import pytest


@pytest.fixture(scope='module')
def clean(other_rig):
    with np.load(other_rig / 'clean.npz') as arrays:
        return {key: arrays[key].astype(float) for key in arrays}


@pytest.fixture(scope='module')
def accuracy(clean):
    """To how much the other implementation is converged [N]; 0.005 is asked for."""
    return float(clean.get('accuracy', 1e-4))


@pytest.fixture(scope='module')
def target(clean):
    return PoseStream(clean['target_t'], clean['target_position'], clean['target_rotation'])


@pytest.fixture(scope='module')
def simulated(clean, target):
    return simulate_alike(clean, target)


def simulate_alike(clean, target, **options):
    """Simulate for as long as the other implementation did."""
    whole = simulate(load_rig(), target, noise=False, **options)
    end = clean['t'][-1] + 1e-9
    return replace(whole, **{name: getattr(whole, name).between(-1.0, end) for name in (
        'wrench', 'accelerometer', 'optidrive', 'pose', 'contact_truth')})


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def test_samples_are_at_the_same_times(clean, simulated):
    assert np.allclose(simulated.wrench.t, clean['t'], rtol=0.0, atol=1e-9)
    assert np.allclose(simulated.accelerometer.t, clean['t'], rtol=0.0, atol=1e-9)
    assert np.allclose(simulated.optidrive.t, clean['t'], rtol=0.0, atol=1e-9)
    assert np.allclose(simulated.pose.t, clean['t'][3::4], rtol=0.0, atol=1e-9)


def test_wrench_agrees(clean, simulated, accuracy):
    difference = rms(simulated.wrench.values - clean['wrench'])
    assert (difference[:3] < accuracy).all()
    assert (difference[3:] < 0.1 * accuracy).all()  # [N m]; the centre of mass is 0.14 m away


@pytest.mark.parametrize('accelerometer, key', [('acc1', 'volts'), ('acc2', 'volts_acc2')])
def test_volts_agree(accelerometer, key, clean, target, accuracy):
    recording = simulate_alike(clean, target, accelerometer=accelerometer)
    # [V]: 1 N moves 13 kg by 0.08 m/s^2, which is 0.02 V
    assert (rms(recording.accelerometer.values - clean[key]) < 0.1 * accuracy).all()


def test_contact_force_agrees_and_begins_and_ends_with_it(clean, simulated, accuracy):
    force = simulated.contact_truth.values[:, :3]
    touching = np.abs(clean['contact_force']).max(axis=1) > 0.0
    assert touching.sum() > 1000
    assert (rms((force - clean['contact_force'])[touching]) < accuracy).all()
    assert ((np.abs(force).max(axis=1) > 0.0) == touching).mean() > 1.0 - 1e-3


def test_displacement_and_position_agree(clean, simulated, accuracy):
    # [m]: 1 N bends the spring by 2e-4 m
    assert rms(simulated.optidrive.values[:, 0] - clean['optidrive']) < 1e-4 * accuracy
    assert (rms(simulated.pose.position - clean['position'][3::4]) < 1e-9).all()  # [m]


def test_default_step_is_converged_to_a_tenth_of_a_millinewton(clean, target, simulated):
    fine = simulate_alike(clean, target, steps=32)
    difference = np.abs(simulated.wrench.values - fine.wrench.values).max(axis=0)
    assert (difference < 1e-4).all()  # [N], [N m]
