"""Claims about what the sensors say: weight, Newton and Euler, noise as stated."""

from dataclasses import replace

from effects_runs import BIAS, clean, HOME, resting, RIG, RIGID
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.sim.rig.simulator import simulate
from hypothesis import given, settings, strategies
import numpy as np
import pytest
from scipy.spatial.transform import Rotation


def swinging(n):
    """Smooth motion of position and orientation, in free air."""
    t = 0.004 * np.arange(n)
    ramp = (1.0 - np.cos(np.pi * np.minimum(t, 1.0))) / 2.0
    position = HOME - [0.2, 0.0, 0.0] + 0.03 * ramp[:, None] * np.sin(
        np.outer(t, [7.0, 9.0, 11.0]))
    turn = 0.4 * ramp[:, None] * np.sin(np.outer(t, [6.0, 5.0, 8.0]))
    return PoseStream(t, position, RIG.home.R_base_sensor @ rotation_from_vector(turn))


@settings(max_examples=20, deadline=None)
@given(seed=strategies.integers(0, 2 ** 32 - 1))
def test_at_rest_the_wire_reads_weight_in_sensor_plus_bias(seed):
    R = Rotation.random(random_state=seed).as_matrix()
    recording = clean(RIG, resting(R))
    weight = 13.0 * R.T @ RIG.gravity
    lever = np.array(RIG.tool.com) + [weight[0] / 5000.0, 0.0, 0.0]
    expected = np.concatenate([weight, np.cross(lever, weight)]) + BIAS
    assert recording.wrench.values == pytest.approx(np.tile(expected, (20, 1)), abs=1e-5)
    volts = -0.2937 * (-R.T @ RIG.gravity) + 5.0938
    assert recording.accelerometer.values == pytest.approx(np.tile(volts, (20, 1)), abs=1e-6)


def test_rigid_tool_is_the_limit_of_a_stiff_one():
    stiff = replace(RIG, optidrive=replace(RIG.optidrive, stiffness=1e10, damping=7e5))
    target = swinging(100)
    difference = clean(stiff, target).wrench.values - clean(RIGID, target).wrench.values
    assert np.abs(difference).max() < 0.005  # [N], [N m]; it slides by some nm
    assert clean(RIGID, target).optidrive is None


def within(deviation, sigma, n, k=5.0):
    """Whether mean and scatter of n draws are those of white noise, to k standard errors."""
    return (np.abs(deviation.mean(axis=0)) < k * sigma / np.sqrt(n)).all() and (
        np.abs(deviation.std(axis=0) / sigma - 1.0) < k / np.sqrt(2.0 * n)).all() and (
        np.abs(np.mean(deviation[1:] * deviation[:-1], axis=0)) < k * sigma ** 2 / np.sqrt(n)
    ).all()


def test_noise_is_white_and_as_large_as_stated():
    target = resting(n=2500)
    noisy, still = simulate(RIG, target, seed=4), clean(RIG, target)
    wrench = noisy.wrench.values - still.wrench.values
    assert within(wrench[:, :3], 0.25, 10000) and within(wrench[:, 3:], 0.02, 10000)
    volts = noisy.accelerometer.values - still.accelerometer.values
    slide = noisy.optidrive.values - still.optidrive.values
    assert within(volts, 0.01, 10000) and within(slide, 20e-6, 10000)
    correlation = np.corrcoef(np.hstack([wrench, volts, slide]).T) - np.eye(10)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(10000)
    assert within(noisy.pose.position - still.pose.position, 20e-6, 2500)
    turn = Rotation.from_matrix(
        np.swapaxes(still.pose.R_base_sensor, 1, 2) @ noisy.pose.R_base_sensor).as_rotvec()
    assert within(turn, 20e-6, 2500)
    assert np.array_equal(noisy.contact_truth.values, still.contact_truth.values)


def test_gain_and_bias_act_on_the_wire_as_stated():
    gain, bias = np.linspace(0.9, 1.1, 6), np.arange(6.0)
    changed = replace(RIG, wrench_sensor=replace(RIG.wrench_sensor, gain=gain, bias=bias))
    target = swinging(100)
    expected = (clean(RIG, target).wrench.values - BIAS) * gain + bias
    assert clean(changed, target).wrench.values == pytest.approx(expected, abs=1e-12)
