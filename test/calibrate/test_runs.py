"""Whole calibration runs of the simulated rig, and of another implementation of it."""

from dataclasses import replace

from calibration_runs import run
from changed import with_values
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.poses import orientation_h, orientation_v
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.streams import Phase, Stream
from forcecal_ros.io.bags import read_recording
from forcecal_ros.motion.plan import Timing
from forcecal_ros.motion.profiles import nominal_poses, orientation, Pose
from forcecal_ros.report.rows import table
from forcecal_ros.sim.rig.file import load_rig, true_calibration
from identification_coverage import coverage
from longer import first
import numpy as np
import pytest
from scipy.signal import lfilter

RIG = load_rig()
PLACE = nominal_poses()['v'].position
DELAY = 0.0087
THREE = {name: nominal_poses()[name] for name in 'vh'} | {
    'tilt': Pose(PLACE, orientation(np.radians(-60.0), np.radians(105.0)))}


def truth_of(rig, name='acc1', delay=0.0):
    truth = true_calibration(rig, name) | {'accelerometer.delay': delay}
    del truth['accelerometer.map']
    return truth


def assert_within(calibration, truth, sigmas=4.5):
    rows = [row for row in table(calibration, truth) if row.truth is not None]
    assert len(rows) >= 10
    off = {row.key: (row.value - row.truth) / row.std for row in rows}
    assert not {key: one for key, one in off.items() if not abs(one) < sigmas}


@pytest.fixture(scope='module')
def recording():
    return run(delay=DELAY, seed=1)


@pytest.fixture(scope='module')
def calibration(recording):
    return identify(recording)


@pytest.fixture(scope='module')
def coupled():
    return run(delay=DELAY, seed=2, accelerometer='acc2')


@pytest.mark.parametrize('settle', [0.2, 0.3])
@pytest.mark.long
def test_ringing_left_in_the_poses_pulls_nothing(settle):
    """
    Without noise what is off is off in every run: by a tenth of a standard error at most.

    Taken for rest, the means would put torque bias y off by 1.5 and stiffness by 1.3 of them.
    """
    std = {row.key: row.std for row in table(identify(run(seed=4, settle=settle)))}
    rows = table(identify(run(noise=False, settle=settle)), truth_of(RIG))
    off = {row.key: (row.value - row.truth) / std[row.key] for row in rows
           if row.truth is not None and row.key.startswith(('mass', 'com', 'wrench_bias', 'tool'))}
    assert len(off) == 12
    assert max(map(abs, off.values())) < 0.1, off


@pytest.mark.parametrize('accelerometer, coupling, offset, delay', first([
    ('acc1', 'dc', 5e-4, -0.01), ('acc2', 'ac', 3e-3, 0.01)]))
def test_the_demonstration_run_is_as_accurate_as_promised(accelerometer, coupling, offset, delay):
    found = identify(run(delay=delay, seed=3, accelerometer=accelerometer),
                     IdentificationSettings(coupling=coupling))
    model = getattr(RIG.accelerometer, accelerometer)
    assert abs(float(found.mass) / 13 - 1) < 3e-4
    assert np.abs(found.accelerometer.gain.value / model.gain - 1).max() < 1.5e-3
    assert np.abs(found.accelerometer.offset.value - model.offset).max() < offset
    off = np.abs(found.wrench_bias.value - RIG.wrench_sensor.bias)
    assert off[:3].max() < 0.02 and off[3:].max() < 0.003
    assert np.abs(found.com.value - RIG.tool.com).max() < 1e-4
    assert_within(found, truth_of(RIG, accelerometer, delay))
    assert not found.quality['warnings']


def test_without_noise_the_run_is_identified_to_a_few_millionths():
    found = identify(run(noise=False, delay=DELAY))
    assert float(found.mass) == pytest.approx(13, rel=1e-7)
    np.testing.assert_allclose(found.com.value, RIG.tool.com, atol=2e-7)
    np.testing.assert_allclose(found.wrench_bias.value, RIG.wrench_sensor.bias, atol=1e-4)
    np.testing.assert_allclose(found.accelerometer.gain.value, RIG.accelerometer.acc1.gain,
                               rtol=5e-6)
    np.testing.assert_allclose(found.accelerometer.offset.value, 5.0938, atol=5e-6)
    assert float(found.accelerometer.delay) == pytest.approx(DELAY, abs=1e-6)
    assert float(found.tool.stiffness) == pytest.approx(5000, rel=1e-6)
    assert float(found.tool.damping) == pytest.approx(130, rel=1e-4)
    # differences over blocks of 10 ms: a quarter of a standard error at the rig's noise
    np.testing.assert_allclose(found.inertia.value, RIG.tool.inertia, rtol=1e-3, atol=2e-5)
    assert not found.quality['warnings']


def test_raw_and_tared_readings_give_the_same_but_for_the_bias(recording, calibration):
    first = next(p for p in recording.phases if p.name == 'measure')
    tare = recording.wrench.between(first.start, first.end).values.mean(axis=0)
    found = identify(with_values(recording, lambda values: values - tare))
    for one, other in zip(table(found), table(calibration)):
        if not one.key.startswith('wrench_bias'):
            assert one.value == pytest.approx(other.value, abs=1e-3 * other.std), one.key
    np.testing.assert_allclose(found.wrench_bias.value + tare, calibration.wrench_bias.value,
                               atol=1e-5)
    for key in ('mass', 'gain', 'gain_aligned'):
        assert found.quality['paper'][key] == pytest.approx(calibration.quality['paper'][key])


@pytest.mark.long
def test_with_theta_the_plain_mass_is_short_and_the_joint_one_is_not():
    theta = 0.4
    poses = {'v': Pose(PLACE, orientation_v(theta)), 'h': Pose(PLACE, orientation_h(theta)),
             'tilt': THREE['tilt']}
    found = identify(run(seed=4, poses=poses))
    assert found.quality['paper']['mass'] == pytest.approx(13 * np.cos(theta), abs=0.01)
    assert found.quality['paper']['mass_theta'] == pytest.approx(13, abs=0.01)
    assert float(found.mass) == pytest.approx(13, abs=5 * float(found.mass.std))


@pytest.mark.long
def test_the_plain_offset_of_an_ac_sensor_is_wrong_and_the_joint_one_is_not():
    order = {name: THREE[name] for name in ('h', 'v', 'tilt')}
    recording = run(seed=5, accelerometer='acc2', poses=order, start=THREE['v'],
                    timing=Timing(measure=1.0))
    found = identify(recording, IdentificationSettings(coupling='ac'))
    assert 0.35 < abs(found.quality['paper']['offset'] - 5.9616) < 0.55
    assert abs(found.accelerometer.offset.value[0] - 5.9616) < 0.003
    assert float(found.accelerometer.cutoff) == pytest.approx(
        0.01, abs=4.5 * float(found.accelerometer.cutoff.std))


def test_the_standard_error_of_the_cutoff_is_that_of_its_scatter():
    found = [identify(run(seed=seed, accelerometer='acc2'), IdentificationSettings(
        coupling='ac')).accelerometer.cutoff for seed in (1, 2, 3, 4)]
    off = [(float(one) - 0.01) / one.std for one in found]
    # the root mean square of four normal numbers: 0.1 % have less, or more
    assert 0.15 < np.sqrt(np.mean(np.square(off))) < 2.15


def test_a_known_cutoff_is_taken_as_it_is_and_what_fades_behind_it_is_no_noise(coupled):
    found = identify(coupled, IdentificationSettings(coupling='ac', cutoff=0.01))
    assert float(found.accelerometer.cutoff) == 0.01
    assert_within(found, truth_of(RIG, 'acc2', DELAY))
    np.testing.assert_allclose(np.sqrt(np.diag(found.noise.specific_force.value)), 0.010 / 0.2525,
                               rtol=0.06)


def test_an_ac_sensor_taken_for_a_dc_one_is_noticed(coupled):
    warnings = identify(coupled, IdentificationSettings(coupling='dc')).quality['warnings']
    assert any('accelerometer.coupling: ac' in line for line in warnings)


def test_the_delay_biases_equation_17_and_the_note_says_so(calibration):
    paper = calibration.quality['paper']
    true = abs(RIG.accelerometer.acc1.gain[0])
    assert abs(paper['gain']) / true - 1 > 0.01
    assert abs(abs(paper['gain_aligned']) / true - 1) < 0.004
    delay = f'delay of {1e3 * float(calibration.accelerometer.delay):.2f} ms'
    assert any('Eq. 17' in line and delay in line
               for line in calibration.quality['notes'])


@pytest.mark.long
def test_a_wrench_that_comes_late_is_set_against_pose_and_slide():
    found = identify(run(delay=-0.008, seed=6))
    assert_within(found, truth_of(RIG, delay=-0.008))
    assert found.quality['pose_delay'] == pytest.approx(
        -0.008, abs=4.5 * found.quality['pose_delay_std'])
    assert found.quality['optidrive_delay'] == pytest.approx(-0.008, abs=3e-4)


def test_without_optidrive_the_ringing_tells_the_sag(recording):
    found = identify(replace(recording, optidrive=None))
    truth = truth_of(RIG, delay=DELAY)
    assert_within(found, truth)
    assert float(found.tool.stiffness.std) < 0.005 * 5000


@pytest.mark.long
def test_leaving_the_sag_out_widens_the_errors_and_is_told(recording, calibration):
    rigid = identify(replace(recording, optidrive=None),
                     IdentificationSettings(tool_compliance='no'))
    assert rigid.tool is None
    assert (abs(rigid.com.value - RIG.tool.com) < 2.0 * rigid.com.std).all()
    assert rigid.com.std.max() > 100.0 * calibration.com.std.max()
    assert any('do not fit one tool' in line and 'widens' in line
               for line in rigid.quality['warnings'])


def test_a_sag_that_nothing_shows_is_found_by_the_poses_themselves(recording):
    poses = {**nominal_poses(), 'other': Pose(PLACE, orientation(-0.4, 2.4))}
    quiet = replace(run(seed=7, poses=poses), optidrive=None)
    phases = tuple(replace(p, name='settle') if p.name == 'step' else p for p in quiet.phases)
    found = identify(replace(quiet, phases=phases), IdentificationSettings(tool_compliance='yes'))
    assert found.tool is None
    assert_within(found, {key: value for key, value in truth_of(RIG).items()
                          if not key.startswith('inertia')})


@pytest.mark.long
def test_a_rigid_tool_is_taken_for_one():
    rig = load_rig('rigid_tool.yaml')
    found = identify(run(rig, seed=8, delay=0.003))
    assert found.tool is None
    assert_within(found, truth_of(rig, delay=0.003))


def test_a_stated_place_of_the_accelerometer_and_stated_poles_are_used(recording):
    found = identify(recording, IdentificationSettings(
        accelerometer_position=(0.05, 0.0, 0.18), observer_design='poles',
        observer_poles=(-30.0, -40.0)))
    np.testing.assert_array_equal(found.accelerometer.position.value, [0.05, 0.0, 0.18])
    assert_within(found, truth_of(RIG, delay=DELAY))
    observer = found.observer
    poles = np.linalg.eigvals(observer.A.value - observer.K.value @ observer.C.value)
    np.testing.assert_allclose(np.sort(poles.real), [-40, -30], rtol=1e-6)


def test_the_place_of_an_inverted_accelerometer_is_found_with_negative_gains(calibration):
    place = calibration.accelerometer.position
    assert (calibration.accelerometer.gain.value < 0).all()
    assert np.linalg.det(calibration.accelerometer.map.value) > 0
    assert (np.abs(place.value - RIG.accelerometer.position) < 4.5 * place.std).all()
    assert place.std.max() < 0.002


def only(recording, keep):
    """Take other phases for stretches of which nothing is known."""
    return replace(recording, phases=tuple(
        p if p.name in keep else replace(p, name='idle') for p in recording.phases))


def test_inertia_is_not_identified_without_a_rotation(recording):
    found = identify(replace(only(recording, ('measure', 'step')), accelerometer=None))
    assert found.inertia is None
    assert any('inertia not identified' in line for line in found.quality['notes'])


@pytest.fixture(scope='module')
def three():
    return run(delay=DELAY, seed=1, poses=THREE, timing=Timing(measure=1.0))


def test_three_poses_alone_do_not_tell_the_accelerometers_map(three):
    found = identify(only(three, ('measure',)))
    assert found.accelerometer is None
    assert any('accelerometer: not identified' in line for line in found.quality['warnings'])


def test_three_poses_and_the_step_do(three):
    found = identify(only(three, ('measure', 'step')))
    assert found.accelerometer.position is None
    assert_within(found, {k: v for k, v in truth_of(RIG, delay=DELAY).items() if k != 'inertia'})


def test_permuted_left_handed_axes_are_found_and_said(recording):
    P = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    felt = (recording.accelerometer.values - 5.0938) / -0.2937
    scaled = replace(recording, accelerometer_unit='m/s^2',
                     accelerometer=Stream(recording.accelerometer.t, felt @ P.T))
    assert np.linalg.det(P) == pytest.approx(-1)
    found = identify(scaled)
    np.testing.assert_allclose(found.accelerometer.map.value, P, atol=0.005)
    assert (found.accelerometer.gain.value > 0).all()
    words = ' '.join(found.quality['notes'])
    assert 'x of the accelerometer points along -z' in words
    assert 'left-handed with positive gains' in words
    assert found.accelerometer.gain.unit == '1' and found.accelerometer.offset.unit == 'm/s^2'


def test_one_pose_is_refused_with_what_to_add(recording):
    phases = [p for p in recording.phases if p.name == 'measure']
    end = phases[0].end
    one = replace(recording, phases=(phases[0],), contact_truth=None, **{
        name: getattr(recording, name).between(0.0, end)
        for name in ('wrench', 'accelerometer', 'optidrive', 'pose', 'target')})
    with pytest.raises(UnobservableError, match='1 static pose .* add a pose'):
        identify(one)


def test_one_pose_and_motion_give_the_tool(recording):
    phases = [p for p in recording.phases if p.name == 'measure']
    found = identify(replace(
        recording, phases=(phases[0], Phase('idle', phases[0].end, 17.0))))
    assert float(found.mass) == pytest.approx(RIG.tool.mass, rel=2e-3)
    np.testing.assert_allclose(found.com.value, RIG.tool.com, atol=1e-3)
    assert found.quality['method'] == 'motion'


def test_two_poses_without_motion_name_what_is_short(recording):
    phases = [p for p in recording.phases if p.name == 'measure'][:2]
    with pytest.raises(UnobservableError, match='centre of mass and torque bias .* add a pose'):
        identify(replace(recording, phases=tuple(phases)))


def test_two_poses_and_the_motion_give_the_centre_of_mass(recording):
    third = [p for p in recording.phases if p.name == 'measure'][2]
    phases = tuple(replace(p, name='settle') if p is third else p for p in recording.phases)
    found = identify(replace(recording, phases=phases))
    assert_within(found, truth_of(RIG, delay=DELAY))
    assert found.com.std.max() < 1e-4


@pytest.mark.long
def test_a_channel_at_the_end_of_its_range_is_refused(recording):
    most = np.where(np.arange(6) == 0, 100.0, np.inf)
    with pytest.raises(DataError, match='force.x is clipped at 100 in pose 2'):
        identify(with_values(recording, lambda values: np.minimum(values, most)))


def test_a_channel_clipped_in_motion_is_reported(three):
    most = np.where(np.arange(6) == 3, 10.0, np.inf)  # 8.8 at rest, 12.9 on the way
    clipped = with_values(three, lambda values: np.minimum(values, most))
    warnings = identify(clipped).quality['warnings']
    count = (clipped.wrench.values[:, 3] == 10.0).sum()
    assert any(f'torque.x is clipped at 10 ({count} samples' in line
               and 'increase the range' in line for line in warnings)


@pytest.mark.long
def test_other_rates_dropouts_and_samples_that_are_no_numbers_do_no_harm(recording):
    wrench, force = recording.wrench, recording.accelerometer
    values, volts = np.array(wrench.values), np.array(force.values)
    values[5000:5030, 2] = np.nan
    volts[9001:9010] = np.inf
    kept = np.random.default_rng(1).random(len(wrench)) > 0.03
    kept[5000:5030], kept[8000:8100] = True, False
    found = identify(replace(recording, wrench=Stream(wrench.t[kept], values[kept]),
                             accelerometer=Stream(force.t[1::3], volts[1::3])))
    assert found.quality['removed_samples'] == {'wrench': 30, 'accelerometer': 3}
    assert_within(found, truth_of(RIG, delay=DELAY))


def test_poses_are_found_without_phases(recording):
    found = identify(replace(recording, phases=()))
    assert len(found.quality['poses']) >= 3
    truth = truth_of(RIG, delay=DELAY)
    assert_within(found, {k: v for k, v in truth.items() if not k.startswith('tool')})


def test_a_weak_estimate_is_named_with_where_to_look(recording):
    loud = np.random.default_rng(2).standard_normal(recording.wrench.values.shape)
    warnings = identify(with_values(recording, lambda v: v + 24 * loud)).quality['warnings']
    assert any(line.startswith('mass: relative standard error') and 'measure in more poses' in line
               for line in warnings)


def test_contact_between_the_poses_does_not_enter(recording, calibration):
    phases = (*recording.phases, Phase('contact', recording.phases[-1].end, 30.0))
    wrench, t0 = recording.wrench, recording.wrench.t[-1]
    t = np.concatenate([wrench.t, t0 + 0.001 + np.arange(2000) * 0.001])
    noise = np.random.default_rng(4).standard_normal((2000, 6)) * wrench.values[-2000:].std(axis=0)
    values = np.vstack([wrench.values, wrench.values[-1] + 50 + noise])
    found = identify(replace(recording, wrench=Stream(t, values), phases=phases))
    assert float(found.mass) == pytest.approx(float(calibration.mass), abs=1e-9)
    assert_within(found, truth_of(RIG, delay=DELAY))


def test_noise_at_rest_is_what_the_sensors_have(calibration):
    noise = calibration.noise
    np.testing.assert_allclose(np.sqrt(np.diag(noise.wrench.value)), [0.25] * 3 + [0.02] * 3,
                               rtol=0.06)
    np.testing.assert_allclose(np.sqrt(np.diag(noise.specific_force.value)), 0.010 / 0.2937,
                               rtol=0.06)
    assert noise.wrench_rate == pytest.approx(1000) and noise.accelerometer_rate == \
        pytest.approx(1000)
    R = noise.R.value / 0.004
    # pose and Optidrive, 20 um each; the difference of two over 4 ms; four samples averaged
    assert R[0, 0] == pytest.approx(2 * (20e-6)**2, rel=0.2)
    assert R[1, 1] == pytest.approx(2 * R[0, 0] / 0.004**2, rel=0.2)
    assert R[0, 1] == pytest.approx(R[0, 0] / 0.004, rel=0.2)
    assert R[2, 2] == pytest.approx((0.010 / 0.2937)**2 / 4, rel=0.25)


def test_the_observer_gain_is_the_papers_with_k23_of_one(calibration):
    K = calibration.observer.K
    assert K.value.shape == (2, 3) and K.value[1, 2] == 1 and K.value[0, 2] != 0
    assert np.isfinite(K.std).all()
    assert calibration.observer.dt == pytest.approx(0.001)


@pytest.mark.long
def test_coloured_noise_widens_the_intervals(recording, calibration):
    rng = np.random.default_rng(3)
    rho = 0.9
    white = rng.standard_normal(recording.wrench.values.shape)
    white *= np.sqrt((1 + rho) * (1 - rho)) * np.array([0.25] * 3 + [0.02] * 3)
    coloured = lfilter([1.0], [1.0, -rho], white, axis=0)
    found = identify(with_values(recording, lambda values: values + coloured))
    # white of variance 1 plus coloured of variance 1 whose sum over lags is (1 + rho)/(1 - rho)
    wider = np.sqrt(1 + (1 + rho) / (1 - rho))
    ratio = np.concatenate([
        getattr(found, name).std.ravel() / getattr(calibration, name).std.ravel()
        for name in ('mass', 'com', 'wrench_bias')])
    assert ratio.mean() == pytest.approx(wider, rel=0.25)
    assert_within(found, {k: v for k, v in truth_of(RIG, delay=DELAY).items()
                          if k in ('mass', 'com', 'wrench_bias')})


def test_another_implementation_of_the_rig_is_identified(other_rig):
    found = identify(read_recording(other_rig / 'bag'))
    # two turns tell the inertia hardly or not at all
    assert_within(found, {key: value for key, value in truth_of(RIG).items()
                          if key != 'inertia' or found.inertia is not None})


@pytest.mark.long
def test_intervals_cover_over_redrawn_rigs():
    result = coverage(3, first=1000)
    z = np.array([row['rms_sigmas'] for row in result['parameters'].values()])
    n = np.array([row['n'] for row in result['parameters'].values()])
    # some twenty independent numbers a run
    assert np.average(z**2, weights=n) == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / (20 * 3)))
    assert result['pooled']['95'] > 0.9
