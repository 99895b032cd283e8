"""Claims about effects on signals and stamps: delays, filters, hysteresis, clipping, losses."""

from effects_runs import (
    AIM,
    BIAS,
    clean,
    GRAVITY,
    having,
    pressing,
    resting,
    RIG,
    streams,
)
from forcecal_ros.core.geometry import rotation_about, rotation_from_vector
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.effects.signals import (
    AccelerometerEffects,
    Delay,
    Hysteresis,
    specific_force_of,
    WrenchEffects,
)
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import pytest

T = 0.001 * np.arange(1, 4001)


def wired(signal, name, **values):
    """Pass a force along x through the wrench sensor with one effect."""
    wrench = np.tile(BIAS, (len(signal), 1))
    wrench[:, 0] += signal
    effects = WrenchEffects(having(name, **values), 0.001)
    return effects.after_noise(effects.before_noise(wrench))[:, 0] - BIAS[0]


def felt(signal, name, **values):
    """Pass a specific force along x through the accelerometer with one effect."""
    model = RIG.accelerometer.acc1
    force = np.zeros((len(signal), 3))
    force[:, 0] = signal
    effects = AccelerometerEffects(having(name, **values), 'acc1', 0.001)
    volts = effects.after_noise(effects.before_noise(force * model.gain + model.offset))
    return (volts[:, 0] - model.offset[0]) / model.gain[0]


def gain_at(frequency, through):
    """Complex gain of a path at one frequency, once it has settled."""
    late = T > 3.0
    wave = np.exp(-2j * np.pi * frequency * T[late])
    return 2j * np.mean(through(np.sin(2 * np.pi * frequency * T))[late] * wave)


@pytest.mark.parametrize('delay', [0.0001, 0.0005, 0.0013, 0.0025, 0.004, 0.0376])
def test_delay_shifts_by_any_fraction_of_a_sample_and_damps_nothing(delay):
    for frequency in (1.0, 20.0, 50.0, 100.0):
        gain = gain_at(frequency, lambda x: wired(x, 'wrench_delay', delay=delay))
        expected = np.exp(-2j * np.pi * frequency * delay)
        assert gain == pytest.approx(expected, abs=1.3e-3 if frequency > 50.0 else 1e-4)
        same = gain_at(frequency, lambda x: felt(x, 'accel_delay', delay=delay))
        assert same == pytest.approx(gain)


def test_delay_of_whole_samples_is_exact():
    signal = np.random.default_rng(1).standard_normal((100, 2))
    delayed = Delay(0.007, 0.001)(signal)
    assert np.array_equal(delayed[7:], signal[:-7])
    assert np.array_equal(delayed[:7], np.tile(signal[0], (7, 1)))


def test_lowpass_of_first_order_reaches_63_percent_after_its_time_constant():
    step = wired(np.where(T > 1.0, 10.0, 0.0), 'wrench_lowpass', time_constant=0.05)
    assert np.interp(1.05, T, step) == pytest.approx(10.0 * (1.0 - np.exp(-1.0)), rel=0.02)
    for frequency in (1.0, 10.0, 60.0):
        gain = gain_at(frequency, lambda x: wired(x, 'wrench_lowpass', time_constant=0.05))
        assert gain == pytest.approx(1.0 / (1.0 + 2j * np.pi * frequency * 0.05), rel=0.02)


def test_lowpass_of_second_order_can_be_a_butterworth():
    corner = 1.0 / (2.0 * np.pi * 10.0)
    values = {'time_constant': np.sqrt(2.0) * corner, 'second_order': 0.5}
    gain = gain_at(10.0, lambda x: wired(x, 'wrench_lowpass', **values))
    assert abs(gain) == pytest.approx(np.sqrt(0.5), rel=0.01)


def test_drift_grows_from_the_start_and_can_settle():
    still = np.zeros(len(T))
    assert wired(still, 'wrench_bias_drift', fx=0.5) == pytest.approx(0.5 * T)
    settling = wired(still, 'wrench_bias_drift', fx=0.5, settling=2.0)
    assert settling == pytest.approx(0.25 * (1.0 - np.exp(-2.0 * T)))


def test_gain_and_crosstalk_leave_the_bias_alone():
    rig = with_effects(RIG, {'wrench_gain': {'fz': 0.1}, 'wrench_crosstalk': {'fx_of_fz': 0.02}})
    still = clean(RIG, resting()).wrench.values[0] - BIAS
    wrench = clean(rig, resting()).wrench.values[0] - BIAS
    assert wrench[2] == pytest.approx(1.1 * still[2])
    assert wrench[0] == pytest.approx(still[0] + 0.02 * wrench[2])
    assert wrench[[1, 3, 4, 5]] == pytest.approx(still[[1, 3, 4, 5]])


def test_hysteresis_leaves_a_loop_twice_as_high_as_its_height():
    sweep = 20.0 * np.sin(2.0 * np.pi * T)
    out = wired(sweep, 'wrench_hysteresis', height=1.5, width=4.0)
    up, down = (T > 0.9) & (np.abs(T - 1.0) < 2e-4), np.abs(T - 1.5) < 2e-4
    assert (out - sweep)[up] == pytest.approx(-1.5) and (out - sweep)[down] == pytest.approx(1.5)
    small = np.sin(2.0 * np.pi * T)
    assert wired(small, 'wrench_hysteresis', height=1.5, width=4.0) - small == pytest.approx(
        -1.5 / 4.0 * (small - small[0]))


def test_soft_hysteresis_nears_its_height_exponentially_and_comes_back_along_a_line():
    there = 0.001 * np.arange(8001)
    path = np.concatenate([there, there[-2::-1][:2000]])[:, None]
    out = (path - Hysteresis(1.5, 4.0, softness=1.0)(path))[:, 0]
    assert out[:8001] == pytest.approx(1.5 * -np.expm1(-there / 4.0), abs=2e-4)
    assert np.diff(out[8001:]) == pytest.approx(-1.5 / 4.0 * 0.001)
    hard = path - Hysteresis(1.5, 4.0)(path)
    assert path - Hysteresis(1.5, 4.0, softness=0.03)(path) == pytest.approx(hard, abs=0.1)


def test_hysteresis_does_not_hang_on_the_rate():
    path = np.cumsum(np.random.default_rng(2).standard_normal(500))[:, None]
    once = Hysteresis(1.0, 2.0)(path)
    often = Hysteresis(1.0, 2.0)(np.repeat(path, 3, axis=0))[2::3]
    assert often == pytest.approx(once)


def test_saturation_clips_the_wire_noise_and_bias_included():
    rig = having('wrench_saturation', limit=100.0, torque_limit=2.0)
    wrench = simulate(rig, pressing(200), seed=1).wrench.values
    assert np.abs(wrench[:, :3]).max() == 100.0 and np.abs(wrench[:, 3:]).max() == 2.0


def test_quantisation_rounds_the_noise_too():
    rig = having('wrench_quantisation', step=0.5, torque_step=0.04)
    target = pressing(200)
    wrench, plain = (simulate(r, target, seed=1).wrench.values for r in (rig, RIG))
    steps = wrench / np.repeat([0.5, 0.04], 3)
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert np.abs(wrench - plain).max(axis=0) == pytest.approx(
        np.repeat([0.25, 0.02], 3), rel=0.05)


def test_misaligned_accelerometer_reads_gravity_along_its_own_axes():
    turn = np.array([0.02, -0.03, 0.01])
    recording = clean(having('accel_misalignment', **dict(zip('xyz', turn))), resting(),
                      unit='m/s^2')
    expected = (AIM @ rotation_from_vector(turn)).T @ -GRAVITY
    assert recording.accelerometer.values[0] == pytest.approx(expected, abs=1e-9)


def test_accelerometer_gain_and_bias_are_of_its_volts():
    rig = with_effects(RIG, {'accel_gain': {'z': 0.1}, 'accel_bias': {'x': 0.2, 'z': -0.1}})
    volts = clean(rig, resting(), accelerometer='acc1').accelerometer.values[0]
    up = (AIM.T @ -GRAVITY)[2]
    assert volts == pytest.approx([5.0938 + 0.2, 5.0938, 5.0938 - 0.1 - 0.2937 * 1.1 * up])


@pytest.mark.parametrize('before', [0.0, 0.5, 1e4])
def test_highpass_forgets_gravity_from_when_it_was_switched_on(before):
    constant = felt(np.full(len(T), 9.8), 'accel_highpass', rate=0.8, before=before)
    assert constant == pytest.approx(9.8 * np.exp(-0.8 * (T + before)), abs=1e-9)
    gain = gain_at(3.0, lambda x: felt(x, 'accel_highpass', rate=10.0))
    w = 2j * np.pi * 3.0
    assert gain == pytest.approx(w / (w + 10.0), rel=1e-3)


def test_accelerometer_saturates_symmetrically_about_no_specific_force():
    out = felt(20.0 * np.sin(2.0 * np.pi * T), 'accel_saturation', limit=15.0)
    assert out.max() == pytest.approx(15.0) and out.min() == pytest.approx(-15.0)


@pytest.mark.parametrize('damping', [0.05, 0.2])
def test_accelerometer_on_a_spring_rings_at_its_frequency(damping):
    gain = gain_at(40.0, lambda x: felt(x, 'accel_resonance', amplitude=1.0, damping=damping))
    assert gain == pytest.approx(-0.5j / damping, rel=0.01)
    assert felt(np.ones(len(T)), 'accel_resonance', amplitude=1.0) == pytest.approx(1.0)


def test_a_skewed_clock_stretches_the_stamps_of_its_stream_alone_and_not_those_of_the_truth():
    target = pressing(100)
    recording = clean(having('clock_skew', wrench=1e-3), target)
    skewed, plain = streams(recording), streams(clean(RIG, target))
    assert skewed['wrench'][0] == pytest.approx(1.001 * plain['wrench'][0], abs=1e-12)
    assert np.array_equal(skewed['wrench'][1], plain['wrench'][1])
    for name in ('accelerometer', 'optidrive', 'pose'):
        assert np.array_equal(skewed[name][0], plain[name][0])
    assert recording.contact_truth.t == pytest.approx(0.001 * np.arange(1, 401))


def test_dropouts_lose_their_fraction_at_random_and_leave_the_rest_as_it_was():
    target, fraction = pressing(500), 0.1
    lossy, plain = (streams(simulate(rig, target, seed=1))
                    for rig in (having('dropouts', wrench=fraction, pose=0.5), RIG))
    kept = np.isin(plain['wrench'][0], lossy['wrench'][0])
    sigma = np.sqrt(fraction * (1.0 - fraction) / len(kept))
    assert 1.0 - kept.mean() == pytest.approx(fraction, abs=4.0 * sigma)
    assert np.array_equal(lossy['wrench'][1], plain['wrench'][1][kept])
    assert len(lossy['pose'][0]) == pytest.approx(250, abs=4.0 * np.sqrt(500 * 0.25))
    assert np.array_equal(lossy['accelerometer'][1], plain['accelerometer'][1])


def test_losses_hang_on_the_seed_alone():
    rig, target = having('dropouts', wrench=0.1), pressing(100)
    first, again, other = (simulate(rig, target, seed=seed).wrench.t for seed in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert len(clean(rig, target).wrench) == 400


def test_tilted_base_tilts_weight_and_leaves_the_wall():
    tilt = rotation_about('x', 0.02)
    recording = clean(having('base_tilt', x=0.02), resting(), unit='m/s^2')
    expected = AIM.T @ tilt.T @ GRAVITY
    assert recording.wrench.values[0, :3] - BIAS[:3] == pytest.approx(
        RIG.tool.mass * expected, abs=1e-6)
    assert recording.accelerometer.values[0] == pytest.approx(-expected, abs=1e-9)
    assert EFFECTS['base_tilt'].stage == 'robot'


def test_static_effects_of_the_accelerometer_can_be_undone():
    rig = having('accel_gain', x=0.05, y=-0.03, z=0.02)
    for name, values in (('accel_bias', [0.1, -0.2, 0.05]),
                         ('accel_misalignment', [0.03, -0.02, 0.04])):
        rig = with_effects(rig, {name: dict(zip('xyz', values))})
    force = np.random.default_rng(3).normal(0.0, 9.0, (20, 3))
    model = rig.accelerometer.acc1
    volts = AccelerometerEffects(rig, 'acc1', 0.001).before_noise(force * model.gain
                                                                  + model.offset)
    assert np.abs((volts - model.offset) / model.gain - force).min() > 1e-6
    np.testing.assert_allclose(specific_force_of(rig, 'acc1', volts), force, atol=1e-12)
