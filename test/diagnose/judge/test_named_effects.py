"""An effect that is as large as the library allows is no explanation."""

import json
import math

from forcecal_ros.diagnose.dataset import units
from forcecal_ros.diagnose.judge.named_effects import (
    at_limit,
    at_tolerance,
    ends,
    NamedEffect,
    not_identified,
    Parameter,
    parameters_of,
    readable,
)
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.result import Diagnosis, load_diagnosis, to_document
from forcecal_ros.diagnose.search.calibration import Features, stored
from forcecal_ros.diagnose.search.model_comparison import Accepted
from forcecal_ros.diagnose.search.posterior import Posterior, ties_of
from forcecal_ros.diagnose.sources.simulator import Changed
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.nuisances import Nuisance, of_sensors
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest


@pytest.mark.parametrize('name, key, value, std, unit, said', [
    ('wrench_gain', 'fx', -0.9, 0.001, '1', ['wrench_gain.fx = -0.9']),
    ('wrench_gain', 'fx', -0.895, 0.001, '1', ['wrench_gain.fx = -0.895']),
    ('wrench_gain', 'fx', -0.88, 0.001, '1', []),
    ('wrench_gain', 'fx', -0.9, 0.4, '1', []),
    ('tool_mass', 'change', -0.5, 1e-4, '1', ['tool_mass.change = -0.5']),
    ('tool_com', 'x', 0.2, 1e-4, 'm', ['tool_com.x = 0.2 m']),
    ('wrench_saturation', 'fy', 0.95, 0.0, 'N', []),
    ('wrench_delay', 'delay', 0.05, 1e-4, 's', []),
    ('accel_highpass', 'no such number', 0.9, 0.0, '1', []),
    ('an effect of a simulator of the user', 'kp', 0.9, 0.0, '1', [])])
def test_numbers_at_their_limit_are_named_if_they_are_known(name, key, value, std, unit, said):
    assert at_limit(name, {key: Parameter(value, std, unit)}) == said


def test_a_number_is_at_its_tolerance_unless_it_is_released():
    rig = load_rig('rigid_tool.yaml')
    found = tuple(of_sensors('acc1', ('wrench',)))
    own = Nuisance('kp[joint_1]', 'kp[joint_1]', found[0].apply, prior_std=1.0)
    model = LinearisedModel(rig, (), (*found, own), np.ones(len(found) + 1))
    model.centre = np.array([n.limit for n in model.nuisances])
    at = {n.name: i for i, n in enumerate(model.nuisances)}
    model.centre[at['wrench.bias.1']] *= 0.99
    model.centre[at['wrench.gain.5']] *= -1.0
    model.released = frozenset({'wrench.gain.2'})
    named = [readable(n.name) for n in at_tolerance(model)]
    assert {'wrench.bias.fx', 'wrench.gain.tz', 'kp[joint_1]'} <= {*named}
    assert not {'wrench.bias.fy', 'wrench.gain.fz'} & {*named}


def test_a_number_at_its_bound_is_told_without_a_standard_error(tmp_path):
    constant, order = EFFECTS['wrench_lowpass'].parameters
    assert ends(constant, constant.high) and ends(order, 2.0)
    # where it does nothing it is not there, whatever its range
    assert not ends(constant, constant.nominal) and not ends(constant, 0.004)
    assert str(Changed('kp[elbow]', '1', 2000.0, 100.0, 0.0)) == (
        'kp[elbow] 2000 -> 100 (at its bound)')
    assert str(Changed('rub', 'N m', 0.5, 0.0, 0.1, at_bound=True)) == (
        'rub 0.5 -> 0 N m (at its bound)')
    assert str(Changed('rub', 'N m', 0.5, 0.7, 0.1)) == 'rub 0.5 -> 0.70 ± 0.20 N m'
    found = NamedEffect('wrench_lowpass', {
        'time_constant': Parameter(0.2, 0.0, 's', at_bound=True),
        'second_order': Parameter(1.5, 0.1, '1')}, 0.9)
    (tmp_path / 'diagnosis.json').write_text(json.dumps(to_document(
        Diagnosis('identified', '', (found,)), units(), None)))
    assert load_diagnosis(tmp_path)[0].effects[0].parameters == found.parameters


def test_a_number_that_only_its_prior_bounds_is_not_stated():
    misalignment = EFFECTS['accel_misalignment'].parameters
    theta, free = np.array([0.1, 0.002, -0.1]), np.arange(3)
    std = np.array([0.003, 3.0 * misalignment[1].typical, 0.004])
    a = Accepted('accel_misalignment', theta, std, free, frozenset())
    model = LinearisedModel(load_rig(), ())
    assert set(parameters_of(model, a)) == {'x', 'z'}
    assert not_identified(model, a) == ('accel_misalignment: this motion does not identify y',)
    known = a._replace(std=np.full(3, 0.003))
    assert set(parameters_of(model, known)) == {'x', 'y', 'z'}
    assert not_identified(model, known) == ()


def test_an_alias_is_noted_from_odds_of_one_to_twenty_on():
    def notes(odds):
        by = stored().temperature[0]
        return ties_of(Posterior(None, (), (), {'tool_mass': Features(0.0, 0.0)},
                                 {'tool_mass': {'wrench_gain': by * math.log(odds)}}))

    assert notes(0.04) == ()
    note, = notes(0.06)
    assert note.startswith('tool_mass and wrench_gain are confounded')
