"""Identification of robot and slide: Eq. 28 to rounding, the rig within its standard errors."""

from contextlib import redirect_stdout
from dataclasses import replace
from importlib.resources import files
from io import StringIO
import json

from forcecal_ros.cli.main import main
from forcecal_ros.cli.sample import simulate_along_x
from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.impedance.plant import load_plant, Plant, Robot, Slide
from forcecal_ros.impedance.plant_fit import (
    excitation_commands,
    fit_output_error,
    identify_plant,
    identify_robot,
    identify_slide,
)
from forcecal_ros.io.bags import write_recording
from forcecal_ros.sim.rig.file import load_rig
from gamez_continuous import state_space
import numpy as np
import pytest
from scipy.signal import lfilter

RIG = load_rig()
FEEDBACK, FEEDFORWARD = (1.0494, -0.0775, 0.0006), (1.2348, -1.5084, 0.3011)
PERIOD = 0.004


def exact(value, unit='1'):
    return Estimate(value, 0.0, unit)


EQ_28 = Robot(PERIOD, 1, exact(FEEDBACK), exact(FEEDFORWARD))
NOMINAL = Slide(exact(13.0, 'kg'), exact(5000.0, 'N/m'), exact(130.0, 'N s/m'))


def prbs(n, amplitude=1e-3):
    code = np.random.default_rng(5).choice((-amplitude, amplitude), n)
    code[0] = 0.0
    return code


def answer_of_eq_28(command):
    return lfilter((0.0, *FEEDFORWARD), np.append(1.0, np.negative(FEEDBACK)), command)


def record(along_x, **options):
    return simulate_along_x(RIG, along_x, **options)


def shaken(seconds, seed):
    return record(excitation_commands(seconds, RIG.robot.period, seed=seed), seed=seed + 100)


def response(robot, frequency):
    """Return the complex response of a difference equation at frequencies [Hz]."""
    q = np.exp(-2j * np.pi * frequency * robot.period)
    return (np.polynomial.polynomial.polyval(q, robot.feedforward.value) * q**robot.delay
            / np.polynomial.polynomial.polyval(q, [1.0, *(-robot.feedback.value)]))


def true_response(frequency):
    """From what one command of 1 mm does, without noise; poses come at the end of a period."""
    pulse = np.zeros(1000)
    pulse[1] = 1e-3
    pose = record(pulse, noise=False).pose
    moved = (pose.position - RIG.home.position) @ RIG.home.R_base_sensor[:, 0] / 1e-3
    return np.exp(-2j * np.pi * np.outer(frequency, pose.t - RIG.robot.period)) @ moved


@pytest.fixture(scope='module')
def found(tmp_path_factory):
    """By the command, from a bag: the file, and what is printed."""
    folder, said = tmp_path_factory.mktemp('plant'), StringIO()
    write_recording(folder / 'bag', shaken(20.0, seed=1))
    with redirect_stdout(said):
        status = main(['fit-rig', str(folder / 'bag'), '--for', 'impedance', '-o',
                       str(folder / 'plant.yaml'), '--json'])
    assert status == 0
    return folder / 'plant.yaml', json.loads(said.getvalue())


def test_noise_free_answer_to_a_prbs_gives_the_coefficients_back():
    command = prbs(1500)
    robot, quality = identify_robot(command, answer_of_eq_28(command), PERIOD,
                                    orders=(1, 2, 3, 4))
    assert robot.delay == 1
    assert np.abs(robot.feedback.value - FEEDBACK).max() < 1e-6
    assert np.abs(robot.feedforward.value - FEEDFORWARD).max() < 1e-6
    assert quality['fit'] > 1.0 - 1e-9


def test_noise_of_20_um_hides_a_pole_and_a_zero_and_a_lower_order_is_chosen():
    command = prbs(2000)
    position = answer_of_eq_28(command) + np.random.default_rng(6).normal(0.0, 2e-5, len(command))
    robot, _ = identify_robot(command, position, PERIOD, orders=(1, 2, 3), delays=(1,))
    assert len(robot.feedback.value) == 2
    frequency = np.linspace(0.5, 40.0, 50)
    ratio = response(robot, frequency) / response(EQ_28, frequency)
    assert np.abs(ratio - 1.0).max() < 0.02


def test_standard_errors_of_the_coefficients_are_those_of_repetition():
    command, rng = prbs(1000), np.random.default_rng(7)
    clean = lfilter((0.0, 0.4), (1.0, -0.6), command)
    used, runs = slice(0, len(command)), 30
    fits = [fit_output_error(command, clean + rng.normal(0.0, 2e-5, len(clean)), 1, 1, used)
            for _ in range(runs)]
    values = np.array([np.append(fit.feedback, fit.feedforward) for fit in fits])
    claimed = np.sqrt(np.diag(fits[0].covariance))
    # the spread of 30 runs is itself known to 1 / sqrt(60)
    assert np.abs(values.std(axis=0, ddof=1) / claimed - 1.0).max() < 4.0 / np.sqrt(2 * runs)
    assert (np.abs(values.mean(axis=0) - (0.6, 0.4)) < 4.0 * claimed / np.sqrt(runs)).all()


def test_rig_is_identified_from_its_bag_to_99_5_percent_and_1_percent_up_to_40_hz(found):
    path, document = found
    assert document['quality']['fit'] >= 0.995
    frequency = np.linspace(0.5, 40.0, 80)
    ratio = response(load_plant(path).robot, frequency) / true_response(frequency)
    assert np.abs(ratio - 1.0).max() < 0.01


def test_mass_stiffness_and_damping_are_within_three_standard_errors(found):
    path, document = found
    plant = load_plant(path)
    slide = plant.slide
    assert document['robot']['feedback']['value'] == plant.robot.feedback.value.tolist()
    assert document['slide']['mass']['std'] == float(slide.mass.std)
    for one, truth, least in ((slide.mass, RIG.tool.mass, 0.02),
                              (slide.stiffness, RIG.optidrive.stiffness, 0.002),
                              (slide.damping, RIG.optidrive.damping, 0.005)):
        assert abs(float(one) - truth) < 3.0 * float(one.std)
        assert float(one.std) < least * truth


def test_signals_without_noise_give_the_slide_exactly():
    t = np.arange(0.0, 6.0, 1e-3)
    s, ds = (0.004 * np.real((20j)**n * np.exp(20j * t) + (33j)**n * np.exp(33j * t))
             for n in range(2))
    force = 5000.0 * s + 130.0 * ds + 4.0
    # then m (a_rb + d2s/dt2) = -(force - 4): x_rb is its double integral less s
    x_rb = -s + 0.004 * np.real(
        (5000.0 + 130.0 * 20j) / 13.0 / 20.0**2 * np.exp(20j * t)
        + (5000.0 + 130.0 * 33j) / 13.0 / 33.0**2 * np.exp(33j * t))
    slide, _ = identify_slide((t, force), (t, s), (t, x_rb))
    assert float(slide.mass) == pytest.approx(13.0, rel=1e-6)
    assert float(slide.stiffness) == pytest.approx(5000.0, rel=1e-6)
    assert float(slide.damping) == pytest.approx(130.0, rel=1e-6)


def test_continuous_form_is_eq_30_with_the_two_signs_lost_in_print():
    A, B, C = state_space(Plant(EQ_28, NOMINAL))
    np.testing.assert_allclose(A[:3, :3], [
        [49.5509, -55.8283, 0.394953], [658.2543, -641.2211, -4.813578],
        [-8022.6303, 9077.2025, -1262.97499]], rtol=1e-5)
    np.testing.assert_allclose(B[:3], [213.907, -444.347, 7578.283], rtol=1e-5)
    np.testing.assert_allclose(C[0, :3], FEEDFORWARD)
    # the tool hears x_rb = C x and its derivative C (A x + B x_r)
    np.testing.assert_allclose(A[4, :3], 5000.0 / 13.0 * C[0, :3] + 10.0 * C[0, :3] @ A[:3, :3])
    np.testing.assert_allclose(A[4, 3:], [-5000.0 / 13.0, -10.0])


def test_a_robot_with_more_delay_has_no_continuous_form():
    assert state_space(Plant(Robot(PERIOD, 2, EQ_28.feedback, EQ_28.feedforward), NOMINAL)) is None


def test_a_robot_that_stands_is_refused_with_the_remedy():
    with pytest.raises(DataError, match='move it'):
        identify_plant(record(np.zeros(1000), seed=1))


@pytest.mark.long
def test_a_recording_without_displacement_is_refused(tmp_path, capsys):
    write_recording(tmp_path / 'bag', replace(shaken(1.0, seed=1), optidrive=None))
    assert main(['fit-rig', str(tmp_path / 'bag'), '--for', 'impedance', '-o',
                 str(tmp_path / 'p.yaml')]) == 1
    error = capsys.readouterr().err
    assert 'optidrive' in error and error.count('\n') == 1
    assert not (tmp_path / 'p.yaml').exists()


@pytest.mark.parametrize(('old', 'new', 'message'), [
    ('forcecal-plant/1', 'forcecal-plant/9', 'forcecal-plant/9'),
    ('delay: 2', 'delay: 0', 'delay is 0, expected an integer of at least 1'),
    ('stiffness:', 'spring:', 'slide: missing key stiffness'),
    ('stiffness:', 'stifness:', r'slide: unknown key stifness; did you mean stiffness\?'),
])
def test_a_damaged_file_is_refused_by_name(tmp_path, old, new, message):
    text = (files('forcecal_ros') / 'config' / 'plant.yaml').read_text()
    assert old in text
    path = tmp_path / 'mine.yaml'
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=message):
        load_plant(path)


def test_an_unstable_robot_is_refused_with_its_pole():
    with pytest.raises(ConfigError, match='1.2000'):
        Robot(PERIOD, 1, exact([1.2]), exact([0.1]))
