"""Claims about every effect of the library: nothing at nominal, visible at typical, live alike."""

from dataclasses import replace
from functools import cache
from itertools import cycle

from changed import with_values
from effects_runs import changed, clean, having, nominal, pressing, RIG, RIGID, typical
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.streams import Stream
from forcecal_ros.effects import (
    AccelerometerEffects,
    applicable,
    EFFECTS,
    named_effects,
    physical_rig,
    with_effects,
    WrenchEffects,
)
from forcecal_ros.sim.rig.file import dump_rig, load_rig
from forcecal_ros.sim.rig.plant import enough_steps
from forcecal_ros.sim.rig.simulator import checked_commands, Samples, SIGNALS, simulate, Simulator
from longer import first
import numpy as np
import pytest
import yaml

MOVES = {
    'robot': {'wrench', 'accelerometer', 'optidrive'},
    'tool': {'wrench'},
    'environment': {'wrench', 'accelerometer', 'optidrive'},
    'wrench_sensor': {'wrench'},
    'accelerometer': {'accelerometer'},
    'timing': {'wrench', 'accelerometer', 'optidrive', 'pose'},
}
KEEPS = {
    'robot': set(),
    'tool': {'pose'},
    'environment': {'pose'},
    'wrench_sensor': {'accelerometer', 'optidrive', 'pose'},
    'accelerometer': {'wrench', 'optidrive', 'pose'},
    'timing': set(),
}
TARGET = pressing()
NOISE = {'wrench': 0.02, 'accelerometer': 0.01, 'optidrive': 20e-6, 'pose': 20e-6}
every_effect = pytest.mark.parametrize('effect', EFFECTS.values(), ids=list(EFFECTS))
ONE_OF_A_KIND = {'wrench_delay', 'wrench_lowpass', 'wrench_hysteresis', 'accel_highpass',
                 'tool_friction', 'robot_resonance', 'spindle_vibration', 'wall_position',
                 'clock_skew', 'dropouts'}
"""With a memory of its own each, random, or at rest in the wall at a limit."""

some_effects = pytest.mark.parametrize('effect', [
    pytest.param(effect, id=name, marks=() if name in ONE_OF_A_KIND else pytest.mark.long)
    for name, effect in EFFECTS.items()])
signal_effects = pytest.mark.parametrize('effect', [
    effect for effect in EFFECTS.values() if effect.where == 'signal'], ids=lambda e: e.name)


@cache
def reference():
    return clean(RIG, TARGET)


@cache
def with_noise():
    return simulate(RIG, TARGET, seed=1)


@every_effect
def test_parameters_lie_within_their_limits(effect):
    assert len({q.name for q in effect.parameters}) == len(effect.parameters) > 0
    for q in effect.parameters:
        assert q.low < q.high and q.typical != q.nominal
        assert all(q.low <= x <= q.high for x in (q.nominal, q.typical, *q.starts))
        assert q.unit
    assert effect.where in ('rig', 'signal', 'stamps')
    assert effect.excited_by


@every_effect
def test_nuisance_is_a_spread_and_its_effect_nothing_but_a_change_of_it(effect):
    if effect.nuisance:
        assert getattr(RIG.spreads, effect.nuisance) > 0.0
        assert all(q.nominal == 0.0 for q in effect.parameters)


@every_effect
def test_at_nominal_it_changes_nothing(effect):
    rig = with_effects(RIG, nominal(effect))
    assert not changed(clean(rig, TARGET), reference())
    assert not changed(simulate(rig, TARGET, seed=1), with_noise())


@every_effect
def test_at_typical_size_it_shows_in_the_streams_of_its_stage_and_in_none_before(effect):
    moved = changed(simulate(with_effects(RIG, typical(effect)), TARGET, seed=1), with_noise())
    assert {name for name in moved if moved[name] > 3.0 * NOISE[name]} >= MOVES[effect.stage]
    assert not set(moved) & KEEPS[effect.stage]


@some_effects
def test_live_periods_few_at_a_time_give_the_recording(effect):
    rig = with_effects(RIG, typical(effect))
    recording = simulate(rig, TARGET, seed=1)
    simulator, blocks, k = Simulator(rig, seed=1), [], 0
    positions, xyzw = checked_commands(TARGET.position, TARGET.R_base_sensor)
    for size in cycle([1, 1, 2, 30]):
        blocks.append(simulator.run(positions[k:k + size], xyzw[k:k + size]))
        k += size
        if k >= len(positions):
            break
    live = Samples(*map(np.concatenate, zip(*blocks)))
    for t, values, stream in (
            (live.wrench_t, live.wrench, recording.wrench),
            (live.accelerometer_t, live.volts, recording.accelerometer),
            (live.optidrive_t, live.optidrive[:, None], recording.optidrive),
            (live.pose_t, live.position, Stream(recording.pose.t, recording.pose.position)),
            (live.contact_t, live.contact, recording.contact_truth)):
        assert np.array_equal(t, stream.t)
        assert values == pytest.approx(stream.values, abs=1e-9)


@some_effects
def test_at_its_limits_everything_stays_finite(effect):
    shorter = pressing(50)
    for q, value in ((one, x) for one in effect.parameters for x in (one.low, one.high)):
        values = {**typical(effect)[effect.name], q.name: value}
        recording = clean(with_effects(RIG, {effect.name: values}), shorter)
        assert np.isfinite(recording.wrench.values).all()
        assert np.abs(recording.accelerometer.values).max() < 1e3


def apply_signal_effects(recording, rig):
    """Apply a rig's effects on sampled signals to a recording that lacks them."""
    model = rig.accelerometer.model()
    gain, offset = ((np.ones(3), np.zeros(3)) if recording.accelerometer_unit == 'V'
                    else (np.array(model.gain), np.array(model.offset)))
    period = 1.0 / recording.wrench.rate
    wrench, accelerometer = WrenchEffects(rig, period), AccelerometerEffects(rig, None, period)
    recording = with_values(
        recording, lambda values: wrench.after_noise(wrench.before_noise(values)))
    return with_values(recording, lambda felt: (accelerometer.after_noise(
        accelerometer.before_noise(felt * gain + offset)) - offset) / gain, 'accelerometer')


@signal_effects
@pytest.mark.parametrize('unit', first(['m/s^2', 'V']))
def test_laid_on_a_simulated_signal_it_is_as_if_simulated(effect, unit):
    rig = with_effects(RIG, typical(effect))
    laid = apply_signal_effects(clean(RIG, TARGET, unit=unit), rig)
    simulated = clean(rig, TARGET, unit=unit)
    assert all(size < 1e-9 for size in changed(laid, simulated).values())
    assert changed(laid, clean(RIG, TARGET, unit=unit))


@every_effect
def test_only_effects_of_a_slide_do_not_apply_to_a_rigid_tool(effect):
    assert applicable(effect, RIG)
    if applicable(effect, RIGID):
        clean(with_effects(RIGID, typical(effect)), pressing(5))
    else:
        assert effect.stage == 'tool'
        with pytest.raises(ConfigError, match=f'{effect.name} requires an optidrive'):
            with_effects(RIGID, typical(effect))


@every_effect
def test_rig_file_holds_it(effect, tmp_path):
    rig = with_effects(RIG, typical(effect))
    text = dump_rig(rig)
    (tmp_path / 'rig.yaml').write_text(text)
    assert load_rig(tmp_path / 'rig.yaml') == rig != RIG
    assert hash(rig) == hash(load_rig(tmp_path / 'rig.yaml'))
    assert all(' # ' in line for line in text.splitlines() if line)
    assert named_effects(rig.effects) == typical(effect)


def test_rig_file_without_the_section_has_no_effects(tmp_path):
    document = yaml.safe_load(dump_rig(RIG))
    assert 'effects' not in document
    for empty in (None, {}):
        (tmp_path / 'rig.yaml').write_text(yaml.safe_dump({**document, 'effects': empty}))
        assert load_rig(tmp_path / 'rig.yaml') == RIG


@pytest.mark.parametrize('effects, expected', [
    ({'wrench_dealy': {'delay': 0.004}}, 'unknown effect wrench_dealy; did you mean wrench_delay'),
    ({'hum': {}}, 'unknown effect hum; expected one of wrench_delay, '),
    ({'wrench_delay': {'lag': 0.004}}, ('effects.wrench_delay: unknown key lag; expected only '
                                        'delay [s]')),
    ({'wrench_delay': 0.004}, 'effects.wrench_delay: expected delay [s], got 0.004'),
    ({'wrench_delay': {'delay': '4 ms'}}, "delay is '4 ms', expected a number from 0 to 0.05 [s]"),
    ({'wrench_delay': {'delay': -0.001}}, ('effects.wrench_delay.delay is -0.001, expected a '
                                           'number from 0 to 0.05 [s]')),
    ({'tool_mass': {'change': -1.0}}, 'change is -1.0, expected a number from -0.5 to 9 [1]'),
    (['wrench_delay'], "expected effect names with parameters, got ['wrench_d"),
])
def test_wrong_effect_is_refused_in_one_line_with_key_unit_and_range(
        effects, expected, tmp_path):
    document = {**yaml.safe_load(dump_rig(RIG)), 'effects': effects}
    (tmp_path / 'changed.yaml').write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError) as error:
        load_rig(tmp_path / 'changed.yaml')
    message = str(error.value)
    assert expected in message and 'changed.yaml' in message and '\n' not in message
    if isinstance(effects, dict):
        with pytest.raises(ConfigError):
            with_effects(RIG, effects)


def test_effects_compose_in_whatever_order_they_are_named_and_a_later_one_replaces_its_own():
    one, other = {'wrench_gain': {'fx': 0.1}}, {'tool_mass': {'change': 0.05}}
    both = with_effects(RIG, {**one, **other})
    assert both == with_effects(RIG, {**other, **one})
    assert both == with_effects(with_effects(RIG, one), other)
    assert with_effects(with_effects(RIG, {'tool_mass': {'change': 0.2}}), other) == with_effects(
        RIG, other)
    heavier = clean(with_effects(RIG, other), TARGET).wrench.values
    expected = heavier.copy()
    expected[:, 0] += 0.1 * (heavier[:, 0] - RIG.wrench_sensor.bias[0])
    assert clean(both, TARGET).wrench.values == pytest.approx(expected, abs=1e-9)


def test_noise_does_not_hang_on_effects():
    rig = with_effects(RIG, {'tool_mass': {'change': 0.1}, 'wrench_delay': {'delay': 0.003},
                             'accel_gain': {'x': 0.1}, 'tool_friction': {'force': 2.0}})
    noise = with_noise().wrench.values - reference().wrench.values
    noisy, quiet = simulate(rig, TARGET, seed=1), clean(rig, TARGET)
    assert noisy.wrench.values - quiet.wrench.values == pytest.approx(noise, abs=1e-9)
    volts = with_noise().accelerometer.values - reference().accelerometer.values
    assert noisy.accelerometer.values - quiet.accelerometer.values == pytest.approx(
        volts, abs=1e-9)


def test_other_numbers_are_the_same_rig_with_these_numbers():
    rig = with_effects(RIG, {'tool_mass': {'change': 0.1}, 'wall_position': {'shift': 0.001},
                             'contact_stiffness': {'change': -0.5},
                             'tool_damping': {'change': 1.0}, 'tool_com': {'y': 0.002}})
    written = replace(
        RIG, tool=replace(RIG.tool, mass=RIG.tool.mass * 1.1, com=(0.03, -0.008, 0.14)),
        wall=replace(RIG.wall, position=1.281, stiffness=5000.0),
        optidrive=replace(RIG.optidrive, damping=260.0))
    assert physical_rig(rig).effects == ()
    assert clean(rig, TARGET).wrench.values == pytest.approx(
        clean(written, TARGET).wrench.values, abs=1e-9)


@pytest.mark.parametrize('name, values', first([
    ('tool_friction', {'force': 10.0, 'velocity_scale': 2e-4}),
    ('spindle_vibration', {'sine_x': 5.0, 'cosine_z': 5.0, 'frequency': 50.0}),
    ('robot_resonance', {'gain': 0.5, 'frequency': 25.0}),
    ('tool_friction', {'force': 3.0}),
    ('tool_backlash', {'gap': 1e-3}),
    ('tool_stiffening', {'cubic': 1e8}),
    ('cable_force', {'x': 5.0, 'z': 5.0, 'stiffness': 500.0}),
    ('robot_delay', {'delay': 0.0037})], 3))
def test_finer_steps_change_nothing_that_a_sensor_could_tell(name, values):
    rig, shorter = having(name, **values), pressing(300)
    coarse = clean(rig, shorter)
    fine = clean(rig, shorter, steps=8 * enough_steps(rig))
    off = coarse.wrench.values - fine.wrench.values
    assert np.sqrt(np.mean(off[:, :3] ** 2)) < 1e-4  # as on the nominal rig [N]
    assert np.abs(coarse.optidrive.values - fine.optidrive.values).max() < 1e-6


def test_samples_are_listed_by_stream_for_what_gets_lost():
    listed = {name for names in SIGNALS.values() for name in names}
    assert listed == set(Samples._fields) - {'contact_t', 'contact'}
