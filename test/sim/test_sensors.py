"""Claims about what the sensors say: weight, Newton and Euler, noise as stated."""

from dataclasses import replace

from effects_runs import BIAS, clean, HOME, resting, RIG, RIGID
from forcecal_ros.core.geometry import rotation_about, rotation_from_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.sim.rig.plant import kernel_parameters
from forcecal_ros.sim.rig.robot import Motion, move, robot_at_rest
from forcecal_ros.sim.rig.sensors import highpass_settled, respond, Response
from forcecal_ros.sim.rig.simulator import simulate
from forcecal_ros.sim.rig.tool import Slide, slide_along, tool_at_rest
from hypothesis import given, settings, strategies
import numpy as np
import pytest
from scipy.signal import lsim, TransferFunction
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


def internals(rig, target, steps):
    """Motion, slide and response, from the compiled parts."""
    p, period = kernel_parameters(rig)[()], rig.robot.period
    xyzw = Rotation.from_matrix(np.array(target.R_base_sensor)).as_quat()
    n = len(target) * steps
    motion, slide, response = Motion.empty(2 * n + 1), Slide.empty(n + 1), Response.empty(n)
    R = target.R_base_sensor[0]
    move(p, robot_at_rest(target.position[0], xyzw[0])[0], np.array(target.position), xyzw, steps,
         motion)
    slide_along(p, tool_at_rest(p, target.position[0], R)[0], motion, period / steps, slide)
    respond(p, highpass_settled(p, R)[0], motion, slide, period / steps, response)
    return motion, slide, response


def derivative(values, h):
    """Fourth-order central difference, two samples lost at each end."""
    return (values[:-4] - 8.0 * values[1:-3] + 8.0 * values[3:-1] - values[4:]) / (12.0 * h)


@pytest.mark.parametrize('rig', [RIG, RIGID], ids=['compliant', 'rigid'])
@pytest.mark.long
def test_momentum_changes_by_weight_and_the_reaction_of_the_sensor(rig):
    steps = 64
    motion, slide, response = internals(rig, swinging(500), steps)
    h, m, J = rig.robot.period / steps, rig.tool.mass, np.array(rig.tool.inertia)
    R, omega = motion.R_base_sensor[2::2], motion.omega[2::2]
    lever = np.array(rig.tool.com) + slide.slide[1:, None] * [1.0, 0.0, 0.0]
    com = motion.position[2::2] + np.einsum('nij,nj->ni', R, lever)
    # on the tool: its weight, and what the sensor does to it, which is minus the wire
    force = -np.einsum('nij,nj->ni', R, response.wrench[:, :3])
    torque = -np.einsum('nij,nj->ni', R, response.wrench[:, 3:])
    acceleration = derivative(derivative(com, h), h)
    assert m * acceleration == pytest.approx((force + m * np.array(rig.gravity))[4:-4], abs=0.01)
    spin = np.einsum('nij,nj->ni', R, omega @ J)
    about_com = torque - np.cross(np.einsum('nij,nj->ni', R, lever), force)
    assert derivative(spin, h) == pytest.approx(about_com[2:-2], abs=0.001)
    assert np.abs(m * acceleration).max() > 20.0 and np.abs(about_com).max() > 1.0


@pytest.mark.long
def test_accelerometer_feels_the_acceleration_of_its_place_on_the_tool():
    steps = 64
    motion, slide, response = internals(RIG, swinging(500), steps)
    h, R = RIG.robot.period / steps, motion.R_base_sensor[2::2]
    place = np.array(RIG.accelerometer.position) + slide.slide[1:, None] * [1.0, 0.0, 0.0]
    acceleration = derivative(derivative(
        motion.position[2::2] + np.einsum('nij,nj->ni', R, place), h), h)
    felt = np.einsum('nij,nj->ni', R, response.specific_force)[4:-4]
    assert felt == pytest.approx(acceleration - np.array(RIG.gravity), abs=0.002)


def test_contact_wrench_is_the_push_of_the_wall_at_the_tip():
    n = 500
    position = np.tile(HOME, (n, 1))
    position[:, 0] += 0.083 * np.minimum(1.0, np.arange(n) / 300.0)
    tilted = RIG.home.R_base_sensor @ rotation_about('y', 0.1)
    target = PoseStream(0.004 * np.arange(n), position, np.tile(tilted, (n, 1, 1)))
    motion, slide, response = internals(RIG, target, 4)
    force = -slide.push[1:, None] * motion.R_base_sensor[2::2, 0]
    tip = np.array(RIG.tool.tip) + slide.slide[1:, None] * [1.0, 0.0, 0.0]
    assert slide.push.max() > 10.0
    assert response.contact[:, :3] == pytest.approx(force, abs=1e-12)
    assert response.contact[:, 3:] == pytest.approx(np.cross(tip, force), abs=1e-12)


def test_rigid_tool_is_the_limit_of_a_stiff_one():
    stiff = replace(RIG, optidrive=replace(RIG.optidrive, stiffness=1e10, damping=7e5))
    target = swinging(100)
    difference = clean(stiff, target).wrench.values - clean(RIGID, target).wrench.values
    assert np.abs(difference).max() < 0.005  # [N], [N m]; it slides by some nm
    assert clean(RIGID, target).optidrive is None


def test_coupled_accelerometer_says_what_a_first_order_high_pass_leaves():
    target = swinging(1000)
    force = clean(RIG, target, unit='m/s^2').accelerometer
    volts = clean(RIG, target, accelerometer='acc2').accelerometer.values - 5.9616
    cutoff = 2.0 * np.pi * 0.01
    passed = np.column_stack([
        lsim(TransferFunction([1.0, 0.0], [1.0, cutoff]), axis - axis[0], force.t - force.t[0])[1]
        for axis in force.values.T])
    assert volts == pytest.approx(0.2525 * passed, abs=1e-5)  # [V]; linear between samples


def test_coupled_accelerometer_forgets_gravity_within_16_s():
    n, time_constant = 5000, 1.0 / (2.0 * np.pi * 0.01)  # 15.9 s
    turned = RIG.home.R_base_sensor @ rotation_about('y', np.radians(45.0))
    target = PoseStream(0.004 * np.arange(n), np.tile(HOME - [0.3, 0.0, 0.0], (n, 1)),
                        np.concatenate([[RIG.home.R_base_sensor], np.tile(turned, (n - 1, 1, 1))]))
    volts = clean(RIG, target, accelerometer='acc2').accelerometer.values - 5.9616
    lag = round(1000 * time_constant)
    assert np.abs(volts[0]).max() < 1e-9  # settled at the first specific force
    assert np.abs(volts[4000, [0, 2]]).min() > 0.5  # the sway is over, gravity is left
    assert volts[4000 + lag] == pytest.approx(
        volts[4000] * np.exp(-lag / 1000 / time_constant), abs=1e-6)


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
