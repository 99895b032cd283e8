"""The gap between recording and simulator: named, measured, or denied."""

from dataclasses import replace

from changed import with_values
from forcecal_ros.checks.signals import quantisation
from forcecal_ros.core.streams import CHANNELS, Recording, Stream
from forcecal_ros.diagnose.dataset import CHANNELS as DIAGNOSED
from forcecal_ros.diagnose.judge.named_effects import from_checks
from forcecal_ros.diagnose.recordings import Corrected
from forcecal_ros.diagnose.result import to_document
from forcecal_ros.diagnose.search.posterior import listed_once
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.effects import with_effects
from forcecal_ros.io.bags import read_recording
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import posterior_cases
import pytest
from rig_recordings import bare, FREE, own_recording, swaying


def test_commands_that_come_unevenly_are_a_note_and_no_effect():
    uneven = Corrected(Recording(), (), {}, {'target': 0.1})
    effects, notes = from_checks([uneven], np.ones(16), None)
    assert not effects and notes == ('samples are lost: target 10.00 %',)


def test_a_lattice_of_values_gives_its_step_and_noise_gives_none():
    values = np.random.default_rng(2).standard_normal((5000, 6))
    coarse = Recording(wrench=Stream(np.arange(5000.0), 0.5 * np.round(values / 0.5)))
    fine = Recording(wrench=Stream(np.arange(5000.0), values))
    noise = dict.fromkeys(CHANNELS['wrench'], 1.0)
    assert set(quantisation(coarse, noise).values()) == {0.5}
    assert not quantisation(fine, noise)


@pytest.fixture(scope='module')
def sample(second_rig):
    return read_recording(second_rig / 'bag')


@pytest.mark.parametrize('by', ['second_rig', pytest.param('rig_sample', marks=pytest.mark.long)])
def test_a_sound_recording_by_other_code_has_no_gap(by, request):
    recording = read_recording(request.getfixturevalue(by) / 'bag')
    diagnosis = RigSource(load_rig()).diagnose(recording).diagnosis
    assert diagnosis.verdict == 'no_gap'
    assert not diagnosis.effects


@pytest.mark.long
def test_the_end_of_an_accelerometers_range_is_told_though_its_gain_is_off():
    rig = load_rig()
    target, sensor = swaying(rig, 0.5, [0.0016, 0.0016, 0.008], 3.5), rig.accelerometer
    off = replace(sensor.acc1, gain=tuple(1.005 * g for g in sensor.acc1.gain))
    real = with_effects(replace(rig, accelerometer=replace(sensor, acc1=off)),
                        {'accel_saturation': {'limit': 13.0}})
    effect, = RigSource(rig).diagnose(simulate(real, target, seed=3)).diagnosis.effects
    assert effect.name == 'accel_saturation'
    # by the gain of its file it would be off by 0.5 %
    assert effect.parameters['z'].value == pytest.approx(13.0, rel=0.002)


def test_what_no_effect_explains_is_unknown_and_stays_out_of_the_rig(sample):
    rig = load_rig()
    pose, wrench = sample.pose, sample.wrench
    place = np.interp(wrench.t, pose.t, pose.position[:, 0])
    cogging = 1.5 * np.sin(2.0 * np.pi * (place - place[0]) / 0.0025)
    wrong = with_values(sample, lambda values: values + np.outer(cogging, np.eye(6)[1]))
    found = RigSource(rig).diagnose(wrong).outcome
    assert found.diagnosis.verdict == 'unknown'
    assert [e.name for e in found.diagnosis.effects] == ['unknown']
    assert not found.rig.effects
    gap = found.diagnosis.gap
    assert gap.closed == 0.0
    _, recalibrated, explained = gap.channels['force.y'][:3]
    assert explained == recalibrated
    assert abs(explained - np.std(cogging)) < 0.2 * np.std(cogging)


@pytest.mark.long
def test_what_only_held_out_blocks_show_is_no_gap():
    # the turns about x are held out: an inertia of 0.3 spreads, from noise, was left there
    diagnosis = RigSource(load_rig()).diagnose(own_recording(29)).diagnosis
    assert (diagnosis.verdict, diagnosis.effects) == ('no_gap', ())


def _stepped(recording, channel, height):
    """Let one channel of the wrench jump half-way; return the recording and when it jumps."""
    t = recording.wrench.t
    instant = float(t.mean())
    step = np.outer(t >= instant, height * np.eye(6)[channel])
    return with_values(recording, lambda values: values + step), instant


@pytest.mark.parametrize(('seed', 'channel', 'name', 'height'), [
    (8, 1, 'fy', 0.5), pytest.param(9, 0, 'fx', 3.0, marks=pytest.mark.long)])
def test_a_step_of_bias_is_named_with_its_instant(seed, channel, name, height):
    recording, instant = _stepped(bare(own_recording(seed, FREE)), channel, height)
    diagnosis = RigSource(load_rig()).diagnose(recording).diagnosis
    assert diagnosis.verdict == 'identified'
    effect, = to_document(diagnosis, {c.name: c.unit for c in DIAGNOSED}, None)['effects']
    assert effect['name'] == 'wrench_bias_step'
    found = effect['parameters'][name]
    assert found['value'] == pytest.approx(height, abs=4.0 * found['std'])
    low, high = effect['from_ci95']
    # twice the interval: it misses one in 20 by a little
    assert abs(effect['from'] - instant) <= max(2.0 * (high - low), 2e-3)
    assert high - low < 0.02
    assert f'at {effect["from"]:.2f}' in diagnosis.reason
    # the rig's noise of 0.25 N, to the square root of 2 / 4,700 samples and what is fitted
    assert diagnosis.gap.channels[CHANNELS['wrench'][channel]][3] == pytest.approx(0.25, rel=0.05)


@pytest.mark.long
def test_of_two_small_effects_neither_is_given_to_a_discrepancy():
    effects = {'wrench_crosstalk': {'fx_of_fz': 0.00426},
               'tool_friction': {'force': 0.0276, 'velocity_scale': 0.002}}
    diagnosis = RigSource(load_rig()).diagnose(*(
        own_recording(seed, effects=effects) for seed in (1100, 1101))).diagnosis
    assert {e.name for e in diagnosis.effects} == {'wrench_crosstalk', 'tool_friction'}
    assert diagnosis.verdict == 'identified', diagnosis.reason


def test_two_effects_are_named():
    effects = {'tool_mass': {'change': 0.1}, 'wrench_crosstalk': {'fx_of_fz': 0.05}}
    found = RigSource(load_rig()).diagnose(bare(own_recording(3, FREE[:5], effects))).diagnosis
    assert found.verdict == 'identified'
    assert {e.name for e in found.effects} == {*effects}


@pytest.mark.long
def test_two_effects_of_one_size_are_named():
    case = {'name': 'cable_force', 'size': 0.4, 'second': 'accel_gain', 'second_size': 0.4,
            'seed': 3}
    found = RigSource(load_rig()).diagnose(posterior_cases.make(case)).diagnosis
    assert found.verdict == 'identified'
    assert {e.name for e in found.effects} == {'cable_force', 'accel_gain'}


def slow_noise(rng, shape, knee):
    """Return 1/f noise of unit density above its knee [Hz], at 1 kHz."""
    frequency = np.maximum(np.fft.rfftfreq(shape[0], 1e-3), 1e3 / shape[0])
    white = np.fft.rfft(rng.standard_normal(shape), axis=0)
    return np.fft.irfft(white * np.sqrt(knee / frequency)[:, np.newaxis], shape[0], axis=0)


def with_slow_noise(seed):
    out, rng = own_recording(seed, FREE), np.random.default_rng(seed)
    wrench, pose = out.wrench, out.pose
    return replace(out, wrench=replace(wrench, values=wrench.values + np.repeat(
        [0.1, 0.005], 3) * slow_noise(rng, wrench.values.shape, 20.0)), pose=replace(
            pose, position=pose.position + 2e-5 * slow_noise(rng, pose.position.shape, 20.0)))


@pytest.mark.long
def test_slow_noise_that_does_not_repeat_is_no_gap_and_is_told():
    found = RigSource(load_rig()).diagnose(with_slow_noise(21), with_slow_noise(22)).diagnosis
    assert found.verdict == 'no_gap'
    assert any(note.startswith('slow noise or a part') for note in found.notes)
    assert 'if slow variation is noise' in found.reason


def test_a_name_is_listed_once_with_the_most_that_speaks_for_it():
    found = listed_once([('cable_force', 0.15), ('unknown', 0.32), ('cable_force', 0.25)])
    assert found == [('unknown', 0.32), ('cable_force', 0.25)]
