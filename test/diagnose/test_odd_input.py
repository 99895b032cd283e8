"""Rates, stamps, units and numbers as real rigs have them: used, or refused in words."""

from dataclasses import replace

from forcecal_ros.core.streams import PoseStream
from forcecal_ros.diagnose.dataset import split_by_phase
from forcecal_ros.diagnose.model.linearised import Diverged, linearised_model
from forcecal_ros.diagnose.recordings import (
    convert_to_volts,
    correct_clocks,
    recognise_accelerometer,
)
from forcecal_ros.diagnose.search.model_comparison import Accepted, joint_fit_if_finite
from forcecal_ros.diagnose.sources.rig import prepare_commanded, RigSource
from forcecal_ros.effects import with_effects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import pytest
from rig_recordings import commands, FREE, MOTION, own_recording, PERIOD

SENSORS = ('wrench', 'accelerometer', 'optidrive', 'pose')


def _slower(recording, rate, names=SENSORS):
    """Keep every so many samples of some streams."""
    return replace(recording, **{name: (s := getattr(recording, name)).rows(slice(
        None, None, round(1.0 / (rate * float(np.median(np.diff(s.t))))))) for name in names})


def _commanded(every, effects=None):
    """Return a rig of that period, and what it records of every so manyth command."""
    nominal = load_rig()
    rig = replace(nominal, robot=replace(nominal.robot, period=every * PERIOD))
    target, phases = commands(FREE)
    target = target.rows(slice(None, None, every))
    recording = simulate(with_effects(rig, effects) if effects else rig, target, seed=20)
    return rig, replace(recording, phases=phases)


@pytest.mark.parametrize('every', [
    pytest.param(every, marks=pytest.mark.long) for every in (2, 5)])
def test_all_of_a_recording_counts_whatever_the_period_of_the_commands(every):
    rig, recording = _commanded(every)
    diagnosis = RigSource(rig).diagnose(recording).diagnosis
    assert diagnosis.verdict == 'no_gap', diagnosis.reason
    # the last period may end within a block
    assert min(diagnosis.used.values()) > 0.99


def test_commands_of_1_ms_make_blocks_of_4_ms():
    rig = load_rig()
    rig = replace(rig, robot=replace(rig.robot, period=0.001),
                  pose_sensor=replace(rig.pose_sensor, rate=1000.0))
    target = PoseStream(1e-3 * np.arange(1000), np.tile([1.0, 0.0, 1.0], (1000, 1)),
                        np.tile(np.diag([1.0, -1.0, -1.0]), (1000, 1, 1)))
    replay = Replay(rig, target, 0.0, 1.0, 'acc1')
    assert (replay.n_blocks, len(replay.signals(rig).wrench)) == (250, 1000)


@pytest.mark.long
@pytest.mark.parametrize('rate, parts', [
    pytest.param(125, FREE, id='125'), pytest.param(20, MOTION, id='20')])
def test_slow_sensors_are_looked_at(rate, parts):
    diagnosis = RigSource(load_rig()).diagnose(_slower(own_recording(20, parts), rate)).diagnosis
    assert diagnosis.verdict == 'no_gap', diagnosis.reason
    assert min(diagnosis.used.values()) > 0.99
    assert 'not compared' not in diagnosis.reason


def test_sensors_that_are_too_slow_are_named():
    slow = RigSource(load_rig()).diagnose(_slower(own_recording(20, FREE), 10)).diagnosis
    assert slow.verdict == 'invalid_data'
    assert 'too few samples' in slow.reason and 'wrench 93' in slow.reason
    one = RigSource(load_rig()).diagnose(
        _slower(own_recording(20, FREE), 10, ('wrench',))).diagnosis
    assert 'not compared: wrench (94 samples' in one.reason
    assert 'explains the recording down to its noise' not in one.reason
    assert one.used['wrench'] == 0.0 and one.used['pose'] > 0.99
    assert 'wrench_gain' in one.not_excited


def test_commands_of_which_most_are_missing_are_refused_and_seldom_ones_are_not():
    every, phases = commands(FREE)
    seldom, rig = every.rows(slice(None, None, 12)), load_rig()
    led, held = (_slower(replace(simulate(rig, told, seed=23), phases=phases, target=seldom), 20)
                 for told in (every, seldom))
    refused = RigSource(rig).diagnose(led).diagnosis
    assert refused.verdict == 'invalid_data'
    assert 'recorded every 48 ms, the rig takes one every 4 ms' in refused.reason
    assert 'give --calibration' in refused.reason
    assert prepare_commanded(held, rig).groups.any()
    # the same commands, taken by a robot that is 6 ms later
    late = with_effects(rig, {'robot_delay': {'delay': 0.006}})
    assert prepare_commanded(_slower(simulate(late, seldom, seed=23), 20), rig).groups.any()


def test_stamps_that_jitter_are_no_lost_samples():
    recording, rng = own_recording(20), np.random.default_rng(0)
    wrench = recording.wrench
    t = np.sort(wrench.t + 2e-3 * rng.standard_normal(len(wrench)))
    jittering = replace(recording, wrench=replace(wrench, t=t))
    found = correct_clocks(jittering, load_rig(), 5.0)
    assert not found.lost and not found.skew
    # the mean over a second of a jitter of 2 ms: 2 ms / sqrt(1000)
    assert np.abs(found.recording.wrench.t - wrench.t).max() < 5.0 * 2e-3 / np.sqrt(500.0)
    assert any('jitter by' in note for note in found.notes)


def test_an_offset_that_the_rig_knows_is_no_bias_of_a_sensor_in_m_s2():
    nominal = load_rig()
    model = replace(nominal.accelerometer.acc1, offset=(0.3, -0.2, 0.25))
    rig = replace(nominal, accelerometer=replace(nominal.accelerometer, acc1=model,
                                                 mounted='acc1'))
    target, _ = commands(FREE[:1])
    converted = simulate(rig, target, seed=22, unit='m/s^2')
    force = converted.accelerometer
    shift = np.array(model.offset) / np.array(model.gain)
    held = replace(converted, accelerometer=replace(force, values=force.values + shift))
    assert recognise_accelerometer(converted, rig) == 'acc1'
    volts = convert_to_volts(converted, rig, 'acc1').accelerometer
    np.testing.assert_allclose(volts.values, force.values * model.gain + model.offset)
    np.testing.assert_allclose(convert_to_volts(held, rig, 'acc1').accelerometer.values,
                               volts.values)


def test_a_hypothesis_whose_simulation_diverges_is_rejected():
    rig = load_rig()
    p = linearised_model(rig, (split_by_phase(prepare_commanded(own_recording(20, FREE), rig)),))
    p = replace(p, effects={'cable_force': {'x': 50.0, 'stiffness': 100.0}})
    name = 'tool_stiffening'
    with pytest.raises(Diverged):
        p.simulate({**p.effects, name: {'cubic': -7e4}}, 0)
    effect = Accepted(name, np.array([-7e4]), np.zeros(1), np.array([0]), frozenset())
    pulled = np.array([p.effects['cable_force'].get(q.name, q.nominal)
                       for q in p.library['cable_force'].parameters])
    cable = Accepted('cable_force', pulled, np.zeros(len(pulled)), np.array([0, 3]), frozenset())
    assert joint_fit_if_finite(p, [cable, effect]) is None
