"""The contact experiment of [Gamez2005] as an example: feedbacks, loop, figures, printed gains."""

from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from forcecal_ros.calibrate.paper import gain_error, mass_from_weight, step_gain
from forcecal_ros.calibrate.poses import orientation_h, orientation_v
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.impedance.law import design
from forcecal_ros.impedance.plant import load_plant
from forcecal_ros.impedance.session import Task
from forcecal_ros.observe import ObserverSettings, replay
from forcecal_ros.sim.rig.file import load_rig, true_calibration
from forcecal_ros.sim.rig.simulator import Simulator
from gamez_assess import Figures, losses, rms, settling_time
from gamez_figures import _cells, pictures, text
from gamez_gains import error_poles, with_printed_gain
from gamez_loop import feedback_of
import numpy as np
import pytest

pytestmark = pytest.mark.long

RIG = load_rig()
G = 9.80665


@pytest.fixture(scope='module')
def experiment():
    path = Path(__file__).parents[2] / 'examples/gamez2005/__main__.py'
    spec = spec_from_file_location('gamez2005', path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.conduct(RIG, ['acc1'], design(load_plant()).law, seed=2,
                          task=Task(swings=1, hold=0.4), tell=lambda what: None)


@pytest.fixture(scope='module')
def figures(experiment):
    return {row.feedback: row.figures for row in experiment.rows}


@pytest.fixture(scope='module')
def calibration(experiment):
    return experiment.calibrations['acc1']


def test_the_calibration_is_identified_not_handed_over(calibration):
    truth, mass = float(true_calibration(RIG, 'acc1')['mass']), calibration.mass
    assert 0.0 < abs(float(mass) - truth) < 5 * float(mass.std)


def test_the_observer_removes_the_phantom_force_of_free_motion(figures):
    static, kalman = figures['static'], figures['kalman']
    assert static.phantom_rms > 5.0
    assert kalman.phantom_rms < static.phantom_rms / 20
    assert kalman.strayed < static.strayed / 20
    assert kalman.phantom_peak < static.phantom_peak / 20


def test_the_observer_knows_the_force_in_contact(figures):
    assert figures['kalman'].contact_force > 5.0
    assert figures['kalman'].force_error < 0.2 * figures['kalman'].contact_force
    assert figures['printed'].force_error < 1.0
    ideal = figures['true']
    assert ideal.phantom_peak == ideal.strayed == ideal.force_error == 0.0


@pytest.mark.parametrize('source, mode', [('kalman', 'kalman'), ('printed', 'newton')])
def test_the_observer_in_the_loop_is_that_of_the_replay(experiment, calibration, source, mode):
    run = experiment.runs['acc1', source]
    used = with_printed_gain(calibration, 'acc1') if source == 'printed' else calibration
    again = replay(run.recording, used, ObserverSettings(mode))
    n = len(run.feedback)
    assert n > 0.99 * len(again.t)
    assert np.abs(again.contact[:n, 0] - run.feedback.values[:, 0]).max() < 1e-9


def test_the_printed_gain_has_critically_damped_poles(calibration):
    paper = with_printed_gain(calibration, 'acc1')
    assert error_poles(paper.observer.K.value) == pytest.approx((4.6, 1.08), rel=0.01)


def test_tables_and_pictures_show_every_feedback(experiment):
    shown = text(experiment)
    assert all(word in shown for word in ('raw sensor', 'kalman', 'K of the paper', 'k23'))
    files = pictures(experiment)
    assert len(files) == 4 and all(data.startswith(b'\x89PNG') for data in files.values())


def test_static_feedback_removes_the_weight_of_a_tilted_sensor(calibration):
    tilted = replace(RIG, home=replace(RIG.home, orientation_xyzw=(0.6, 0.0, 0.8, 0.0)))
    samples = Simulator(tilted, 'acc1', 3).advance(noise=False)
    assert abs(samples.wrench[-1, 0]) > 50.0
    (_, residual), *_ = feedback_of('static', calibration).update(samples)
    assert abs(residual) < 5 * np.hypot(calibration.wrench_bias.std[0],
                                        9.81 * float(calibration.mass.std))


def test_an_unknown_feedback_is_refused_with_the_choices(calibration):
    with pytest.raises(ConfigError, match='raw, static, printed, newton, kalman'):
        feedback_of('guess', calibration)


def test_each_loss_of_contact_counts_once_and_settling_ends_in_the_band():
    assert losses(np.array([True, True, False, False, True, False, True])) == 2
    t = np.arange(0.0, 4.0, 1e-3)
    # 5 % of 20 N is 1 N, and 10 exp(-2 t) falls below it at ln(10) / 2
    assert settling_time(t, 20.0 + 10.0 * np.exp(-2.0 * t)) == pytest.approx(
        np.log(10.0) / 2, abs=0.01)
    assert np.isnan(settling_time(t, 20.0 + 5.0 * np.sin(30.0 * t)))


def test_a_feedback_that_runs_away_has_a_word_for_it_and_no_number():
    away = Figures(rms(np.array([1e200, 1.0])), 1e200, 1e190, 1e200, 3, np.nan, 1e200, 1e200)
    assert _cells(away) == ['runs away'] + 7 * ['-']
    assert _cells(away._replace(phantom_rms=0.2, phantom_peak=1.5))[:2] == ['0.200', '1.50']


def test_mass_from_weight_is_the_mass():
    weight = 13.0 * G * np.array([0.0, 0.0, -1.0])
    assert mass_from_weight(orientation_h(), orientation_v(), weight, weight, G) \
        == pytest.approx(13.0)


def test_the_gain_error_is_that_of_the_step():
    """A step of 20 N as steps 5 to 8 take it, with another mass and another offset."""
    true = {'offset': 5.0, 'mass': 13.0, 'u': 20.0, 'u_assumed': 20.0}
    u = np.linspace(-20.0, 20.0, 41)
    volts = 5.0 - 0.2937 * u / 13.0
    found = step_gain(volts - 5.0, u / 13.1)
    assert gain_error(volts[-1], **true, offset_error=0.0, mass_error=0.1) == pytest.approx(
        -0.2937 - found)
    assert gain_error(volts[-1], **true, offset_error=0.0, mass_error=0.0) == 0
    assert gain_error(volts[-1], **true, offset_error=0.01, mass_error=0.0) == pytest.approx(
        0.01 * 13.0 / 20.0)
