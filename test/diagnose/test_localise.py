"""Colour of noise from octave to octave."""

from forcecal_ros.diagnose import localise
import numpy as np
import pytest


def test_noise_that_grows_from_octave_to_octave_is_expected_and_one_strong_octave_is_not():
    dof = np.full(len(localise.BANDS), 100.0)
    pink = np.array([8.0, 4.0, 2.0, 1.2, 1.0, 1.0, 1.0, 1.0])
    assert localise._expected_colour([(pink * dof, dof)] * 3) == pytest.approx(pink)
    alone = np.array([1.0, 1.0, 50.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert localise._expected_colour([(alone * dof, dof)] * 3)[2] == localise.MAX_OCTAVE_RATIO


def test_a_robot_ahead_of_its_simulation_is_earlier():
    early = localise.Difference(1e-3, -0.0015, 0.00025, 1e-4).delay_words('mm')
    assert early == '; the robot is 1.5 ± 0.5 ms earlier; 0.1 mm remain without this delay'


@pytest.mark.parametrize('degrees', [3.0, 4.0, 8.0])
def test_a_heavy_tail_makes_no_impulses_and_knocks_do(degrees):
    rng = np.random.default_rng(4)
    white = rng.standard_t(degrees, 20000) / np.sqrt(degrees / (degrees - 2.0))
    assert np.sum(np.abs(white) > localise.IMPULSE_SIGMA) >= (4 if degrees < 5.0 else 0)
    assert localise._impulses_beyond_tail(white) < localise.MIN_IMPULSES
    knocked = rng.standard_normal(20000)
    knocked[100::2500] += 12.0
    assert localise._impulses_beyond_tail(knocked) == 8
    loud = np.where(np.arange(20000) % 2500 < 50, 6.0, 1.0) * rng.standard_normal(20000)
    assert localise._impulses_beyond_tail(loud) < localise.MIN_IMPULSES


def test_a_burst_of_noise_is_no_octave_and_a_mode_of_the_same_length_is():
    rng = np.random.default_rng(2)
    white = rng.standard_normal(2000)
    t = 0.004 * np.arange(2000)
    shaken = white + np.where((t > 3.0) & (t < 3.4), 6.0 * np.sin(2.0 * np.pi * 20.0 * t), 0.0)
    loud = np.where((t > 3.0) & (t < 3.2), 7.0, 1.0) * white

    def ratios(innovations):
        energy, dof = localise._octaves(innovations, np.ones(2000, dtype=bool), 1.0)
        return energy[3:] / dof[3:]

    assert ratios(loud).min() > 1.5
    assert ratios(localise._level_bursts(loud)) == pytest.approx(1.0, abs=0.2)
    assert ratios(localise._level_bursts(shaken))[2] > 3.0
    assert np.array_equal(localise._level_bursts(white), white)


def test_a_floor_that_is_low_by_chance_makes_no_line_and_a_hump_is_followed():
    width = localise.FLOOR_BINS
    power = np.ones(31 * width)
    power[15 * width:16 * width] = 0.45
    power[20 * width:27 * width] = 8.0
    floor = localise._floor(power)
    assert floor[15 * width:16 * width] == pytest.approx(1.0)
    assert floor[21 * width:26 * width] == pytest.approx(8.0)


@pytest.mark.parametrize('phase, touched, stage', [
    ('move', {'pose.x', 'optidrive'}, 'robot'), ('contact', {'optidrive'}, 'environment'),
    ('move', {'optidrive'}, 'tool'), ('contact', {'force.x'}, 'wrench_sensor')])
def test_an_excess_is_of_the_first_stage_that_accounts_for_it(phase, touched, stage):
    assert localise.stage_of('force.x', phase, touched) == stage


def test_white_noise_has_no_line_and_a_steady_sine_is_one():
    rng = np.random.default_rng(11)
    noise = rng.standard_normal((20000, 12))
    assert localise.spectral_lines(noise, 1000.0, 'wrench') == ()
    noise[:, 4] += 0.12 * np.sin(2.0 * np.pi * 97.7 * np.arange(20000) / 1000.0)
    (line,) = localise.spectral_lines(noise[:, :6], 1000.0, 'wrench')
    assert line.channel == 'torque.y'
    assert line.frequency == pytest.approx(97.7, abs=0.01)
