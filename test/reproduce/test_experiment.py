"""The contact experiment: reference, feedbacks, loop and figures, without any ROS."""

from dataclasses import replace

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.impedance.design import design
from forcecal_ros.impedance.law import Regulator
from forcecal_ros.impedance.plant.file import load_plant
from forcecal_ros.impedance.program import Program, Stage, Task
from forcecal_ros.observe import ObserverSettings, replay
from forcecal_ros.reproduce.assess import (
    assess,
    exceptions,
    Figures,
    losses,
    settling_time,
)
from forcecal_ros.reproduce.closed_loop import feedback_of, run_closed_loop
from forcecal_ros.reproduce.error_analysis import error_poles, with_printed_gain
from forcecal_ros.reproduce.experiment import rehearse
from forcecal_ros.sim.rig.file import load_rig, true_calibration
from forcecal_ros.sim.rig.simulator import Simulator
import numpy as np
import pytest

RIG = load_rig()
SHORT = Task(swings=1, hold=0.4)
PROGRAM = SHORT.program()
LAW = design(load_plant()).law


@pytest.fixture(scope='module')
def calibration():
    return rehearse(RIG, 'acc1', 1)


def run(calibration, source):
    return run_closed_loop(RIG, PROGRAM, feedback_of(source, calibration), Regulator(LAW),
                           accelerometer='acc1', seed=2)


@pytest.fixture(scope='module')
def runs(calibration):
    return {source: run(calibration, source) for source in ('true', 'static', 'kalman')}


def test_the_task_lasts_ten_seconds_as_in_figure_5():
    assert Task().program().duration == pytest.approx(10.0)


def test_the_reference_neither_jumps_nor_kinks():
    program = Task().program(cycles=2)
    t = np.arange(0.0, program.duration, 1e-3)
    x, v = np.array([program.at(time)[:2] for time in t]).T
    assert np.abs(np.diff(x) - 1e-3 * (v[1:] + v[:-1]) / 2).max() < 1e-6
    assert program.at(program.duration + 5.0).position == 0.0


def test_a_stage_without_duration_is_refused():
    with pytest.raises(ConfigError, match='duration'):
        Program((Stage('free', 0.1, 0.0),))


def test_a_calibration_is_identified_not_handed_over(calibration):
    truth = true_calibration(RIG, 'acc1')
    mass = calibration.mass
    assert float(mass) != float(truth['mass'])
    assert abs(float(mass) - float(truth['mass'])) < 5 * float(mass.std)


def test_static_feedback_takes_off_the_weight_where_x_is_not_level(calibration):
    tilted = replace(RIG, home=replace(RIG.home, orientation_xyzw=(0.6, 0.0, 0.8, 0.0)))
    samples = Simulator(tilted, 'acc1', 3).advance(noise=False)
    assert abs(samples.wrench[-1, 0]) > 50.0
    (_, left), *_ = feedback_of('static', calibration).update(samples)
    assert abs(left) < 5 * np.hypot(calibration.wrench_bias.std[0],
                                    9.81 * float(calibration.mass.std))


def test_observer_in_the_loop_is_the_observer_of_the_replay(calibration, runs):
    kalman = runs['kalman']
    again = replay(kalman.recording, calibration, ObserverSettings('kalman'))
    n = len(kalman.feedback)
    assert n > 0.99 * len(again.t)
    assert np.abs(again.contact[:n, 0] - kalman.feedback.values[:, 0]).max() < 1e-9


def test_observer_takes_the_phantom_force_out_of_free_movement(runs):
    static, kalman = (assess(runs[source], runs['true'], PROGRAM)
                      for source in ('static', 'kalman'))
    assert static.phantom_rms > 5.0
    assert kalman.phantom_rms < static.phantom_rms / 20
    assert kalman.strayed < static.strayed / 20
    assert kalman.phantom_peak < static.phantom_peak / 20


def test_observer_knows_the_force_in_contact(runs):
    kalman = assess(runs['kalman'], runs['true'], PROGRAM)
    assert kalman.contact_force > 5.0
    assert kalman.force_error < 0.2 * kalman.contact_force


def test_the_gain_that_the_paper_prints_closes_the_loop(calibration, runs):
    paper = with_printed_gain(calibration, 'acc1')
    poles = error_poles(paper.observer.K.value)
    assert poles == pytest.approx((4.6, 1.08), rel=0.01)
    fed_back = run(calibration, 'printed')
    again = replay(fed_back.recording, paper, ObserverSettings('newton'))
    n = len(fed_back.feedback)
    assert n > 0.99 * len(again.t)
    assert np.abs(again.contact[:n, 0] - fed_back.feedback.values[:, 0]).max() < 1e-9
    assert assess(fed_back, runs['true'], PROGRAM).force_error < 1.0


def test_true_force_has_no_error_to_assess(runs):
    ideal = assess(runs['true'], runs['true'], PROGRAM)
    assert ideal.phantom_peak == ideal.strayed == ideal.force_error == 0.0


def test_each_loss_of_contact_counts_once():
    assert losses(np.array([True, True, False, False, True, False, True])) == 2
    assert losses(np.array([True, True])) == 0


def test_settling_ends_where_the_force_stays_within_its_band():
    t = np.arange(0.0, 4.0, 1e-3)
    force = 20.0 + 10.0 * np.exp(-2.0 * t)
    # 5 % of 20 N is 1 N, and 10 exp(-2 t) falls below it at ln(10) / 2
    assert settling_time(t, force) == pytest.approx(np.log(10.0) / 2, abs=0.01)
    assert np.isnan(settling_time(t, 20.0 + 5.0 * np.sin(30.0 * t)))


def test_unknown_feedback_is_refused_with_the_choices(calibration):
    with pytest.raises(ConfigError, match='raw, static, printed, newton, kalman'):
        feedback_of('guess', calibration)


def test_what_the_observer_does_not_win_is_said_with_its_reason():
    best = Figures(0.1, 0.5, 1e-5, 40.0, 0, 0.4, 0.2, 18.0)
    slower = best._replace(phantom_rms=10.0, phantom_peak=20.0, strayed=1e-3, force_error=0.4)
    assert not [note for note in exceptions(
        {'true': best, 'static': slower._replace(peak=60.0, settling=1.0, bounces=2),
         'kalman': best}) if 'within 5 %' not in note]
    biased = slower._replace(peak=30.0, contact_force=14.0)
    (peak, even) = exceptions({'true': best, 'raw': biased, 'kalman': best})
    assert peak.startswith('Peak at contact [N]: kalman 40, raw 30') and 'bias' in peak
    assert 'within 5 %' in even and 'bounces, settling. There' in even
    never = best._replace(settling=float('nan'), bounces=3)
    notes = list(exceptions({'true': never, 'static': slower, 'kalman': never}))
    assert any('Settling [s]: kalman nan, static 0.4' in note and 'The true force fares no '
               'better' in note for note in notes)
