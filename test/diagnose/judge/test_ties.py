"""A lag of less than a sample is a delay or a low-pass, whichever the driver's samples make it."""

from types import SimpleNamespace

from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.judge.probabilities import probabilities
from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.judge.ties import note_of, tied, with_tie
from forcecal_ros.diagnose.say.advice import advice
from forcecal_ros.effects.filters import Delay, Filter
from forcecal_ros.simulators.rig.file import load_rig
import numpy as np
import pytest

DT, LAG = 1e-3, 4e-4


def test_a_delay_between_two_samples_is_a_low_pass_to_the_next_reader():
    t = DT * np.arange(8000)
    force = 40 * np.sin(2 * np.pi * (1 + 1.5 * t) * t)[:, None]  # to 25 Hz
    read = np.interp(t - LAG, t, force[:, 0])[:, None]
    by_delay = read - Delay(LAG, DT)(force)
    by_lowpass = read - Filter([1.0], [LAG, 1.0], DT)(force)
    # by what each takes off the amplitude: ((2 a - 1) / (1 - a))^2 for a = 0.4 of a sample
    assert np.square(by_lowpass).sum() < 0.12 * np.square(by_delay).sum()


@pytest.mark.parametrize('name, number, other', [
    ('wrench_delay', 'delay', 'wrench_lowpass'),
    ('wrench_lowpass', 'time_constant', 'wrench_delay')])
def test_they_share_the_probability_below_a_sample_and_not_above(name, number, other):
    def said(lag, odds=-40.0):
        found = tied(name, {number: Parameter(lag, 1e-6, 's')}, DT)
        slots = [(name, with_tie({other: odds}, found))]
        return probabilities(slots, UnexplainedPart(0.1, 'nothing'), 0.99)

    named, candidates = said(LAG)
    assert named[name] == dict(candidates)[other] < 0.5
    named, candidates = said(4e-3)
    assert named[name] > 0.9 and other not in dict(candidates)
    assert said(LAG, odds=2.0)[0] == said(LAG)[0]
    assert '1 ms' in note_of(name, other, DT)


def test_no_other_effect_is_tied():
    assert tied('accel_delay', {'delay': Parameter(LAG, 1e-6, 's')}, DT) == ''
    assert tied('wrench_delay', {}, DT) == ''
    assert with_tie({'base_tilt': -1.0}, '') == {'base_tilt': -1.0}


def test_no_motion_is_asked_for_that_would_not_tell_them_apart():
    effect = SimpleNamespace(name='wrench_lowpass',
                             parameters={'time_constant': Parameter(LAG, 1e-6, 's')})
    diagnosis = SimpleNamespace(
        effects=[effect], verdict='ambiguous', not_excited=(),
        candidates=[('wrench_lowpass', 0.49), ('wrench_delay', 0.49)])
    assert advice(diagnosis, load_rig()) == ''
