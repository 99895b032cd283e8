"""Claims about running the rig: live and offline alike, commands held, seeds, rates."""

from dataclasses import replace

from effects_runs import pressing, RIG
from forcecal_ros.core.errors import ConfigError, DataError, MotionError
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.sim.rig.plant import enough_steps
from forcecal_ros.sim.rig.simulator import held_commands, Samples, simulate, Simulator
import numpy as np
import pytest

GRID = 0.004 * np.arange(2000)


def signals(recording):
    return (recording.wrench.values, recording.accelerometer.values, recording.optidrive.values,
            recording.pose.position, recording.pose.R_base_sensor, recording.contact_truth.values)


@pytest.mark.parametrize('noise', [False, True])
def test_period_by_period_gives_the_recording_exactly(noise):
    target = pressing(1300)  # some blocks
    recording = simulate(RIG, target, seed=5, noise=noise)
    simulator, periods = Simulator(RIG, seed=5), []
    for position, R_base_sensor in zip(target.position, target.R_base_sensor):
        simulator.command(position, R_base_sensor)
        periods.append(simulator.advance(noise))
    live = Samples(*map(np.concatenate, zip(*periods)))
    assert np.abs(recording.contact_truth.values).max() > 10.0
    assert np.array_equal(live.wrench_t, recording.wrench.t)
    assert np.array_equal(live.pose_t, recording.pose.t)
    for one, other in zip((live.wrench, live.volts, live.optidrive[:, None], live.position,
                           live.R_base_sensor, live.contact), signals(recording)):
        assert np.array_equal(one, other)


def test_a_period_holds_four_samples_the_last_at_its_end():
    simulator = Simulator(RIG)
    simulator.advance()
    samples = simulator.advance()
    assert samples.wrench_t == pytest.approx([0.005, 0.006, 0.007, 0.008], abs=1e-12)
    assert samples.wrench.shape == samples.contact.shape == (4, 6)
    assert samples.volts.shape == samples.specific_force.shape == (4, 3)
    assert samples.optidrive.shape == (4,)
    assert samples.pose_t == pytest.approx([0.008], abs=1e-12)
    assert samples.position.shape == (1, 3) and samples.R_base_sensor.shape == (1, 3, 3)
    assert simulator.time == pytest.approx(0.008)


def test_noise_of_one_sensor_does_not_hang_on_another():
    target = pressing(50)
    one, other = (simulate(RIG, target, accelerometer=a, seed=1) for a in ('acc1', 'acc2'))
    assert np.array_equal(one.wrench.values, other.wrench.values)
    rigid = simulate(replace(RIG, optidrive=None), target, seed=1)
    clean = simulate(replace(RIG, optidrive=None), target, noise=False)
    assert rigid.wrench.values - clean.wrench.values == pytest.approx(
        one.wrench.values - simulate(RIG, target, noise=False).wrench.values, abs=1e-12)


def test_rig_rests_at_its_first_command():
    simulator = Simulator(RIG)
    simulator.command([0.5, 0.1, 0.8], np.eye(3))
    samples = simulator.advance(noise=False)
    assert samples.position[0] == pytest.approx([0.5, 0.1, 0.8], abs=1e-12)
    assert samples.R_base_sensor[0] == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize('position, R_base_sensor', [
    ([np.nan, 0.0, 1.0], np.eye(3)),
    ([1.0, 0.0, 1.0], np.full((3, 3), np.inf)),
    ([1.0, 0.0, 1.0], 1.01 * np.eye(3)),
    ([1.0, 0.0, 1.0], -np.eye(3)),
])
def test_command_that_is_no_pose_is_refused_and_the_one_before_stays(position, R_base_sensor):
    simulator = Simulator(RIG)
    simulator.command([0.5, 0.1, 0.8], np.eye(3))
    with pytest.raises(MotionError):
        simulator.command(position, R_base_sensor)
    assert simulator.advance(noise=False).position[0] == pytest.approx([0.5, 0.1, 0.8])


def test_regular_stamps_hold_one_period_each_wherever_the_clock_starts():
    for start in (0.0, 0.1, 1234.567):
        for stamps in (start + 0.004 * np.arange(5000), start + np.cumsum(np.full(5000, 0.004))):
            held = held_commands(stamps, stamps[0] + 0.004 * np.arange(5000), 0.002)
            assert np.array_equal(held, np.arange(5000))


def test_jitter_neither_drops_nor_doubles_a_command():
    jitter = np.random.default_rng(3).uniform(-0.0009, 0.0009, 2000)
    stamps = GRID + jitter
    assert np.array_equal(held_commands(stamps, GRID, 0.002), np.arange(2000))


def test_missing_commands_leave_the_one_before():
    keep = np.delete(np.arange(100), [10, 50, 51, 52])
    held = held_commands(0.004 * keep, GRID[:100], 0.002)
    expected = np.arange(100)
    expected[10], expected[50:53] = 9, 49
    assert np.array_equal(keep[held], expected)


@pytest.mark.parametrize('rate', [249.0, 251.0])
def test_another_rate_of_commands_keeps_up_with_their_stamps(rate):
    stamps = np.arange(1000) / rate
    held = held_commands(stamps, GRID[:900], 0.002)
    assert np.abs(stamps[held] - GRID[:900]).max() < 0.00201
    assert np.diff(held).min() >= 0 and np.diff(held).max() <= 2


def test_recording_keeps_the_clock_of_its_commands():
    target = pressing(50)
    later = replace(target, t=target.t + 7.0)
    one, other = simulate(RIG, target, noise=False), simulate(RIG, later, noise=False)
    assert other.wrench.t == pytest.approx(one.wrench.t + 7.0, abs=1e-12)
    assert np.array_equal(one.wrench.values, other.wrench.values)
    assert other.target is later


def test_commands_without_position_are_refused():
    target = pressing(3)
    with pytest.raises(DataError, match='record target_frame'):
        simulate(RIG, replace(target, position=np.full((3, 3), np.nan)))
    with pytest.raises(DataError, match='0 commands'):
        simulate(RIG, PoseStream(np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3))))


def test_unknown_accelerometer_is_refused():
    with pytest.raises(ConfigError, match='acc1, acc2'):
        Simulator(RIG, 'acc3')


def test_sensors_keep_their_own_rates():
    rig = replace(RIG, wrench_sensor=replace(RIG.wrench_sensor, rate=4000.0),
                  accelerometer=replace(RIG.accelerometer, rate=500.0),
                  pose_sensor=replace(RIG.pose_sensor, rate=1000.0))
    target = pressing(200)
    fast, nominal = (simulate(r, target, noise=False) for r in (rig, RIG))
    assert [round(s.rate) for s in (fast.wrench, fast.accelerometer, fast.optidrive)] == [
        4000, 500, 1000]
    assert len(fast.pose) == 800
    assert fast.wrench.t[3::4] == pytest.approx(nominal.wrench.t, abs=1e-12)
    assert fast.wrench.values[3::4] == pytest.approx(nominal.wrench.values, abs=1e-3)
    assert fast.accelerometer.values == pytest.approx(
        nominal.accelerometer.values[1::2], abs=1e-4)
    with pytest.raises(ConfigError, match='multiple of 16'):
        Simulator(rig, steps=8)


def test_stiff_tool_gets_steps_short_enough_to_stay_finite():
    stiff = replace(RIG, optidrive=replace(RIG.optidrive, stiffness=1e9, damping=1e4))
    assert enough_steps(stiff) > enough_steps(RIG)
    recording = simulate(stiff, pressing(300), noise=False)
    assert np.abs(recording.wrench.values).max() < 2000.0
