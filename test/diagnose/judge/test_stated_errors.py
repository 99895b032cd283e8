"""Standard errors of stated numbers beside a discrepancy."""

from types import SimpleNamespace

from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.judge.parameter_errors import aliases, Errors, with_taken
from forcecal_ros.diagnose.search.model_comparison import Accepted
from forcecal_ros.effects import EFFECTS
import numpy as np
import pytest

MODEL = SimpleNamespace(library=EFFECTS, nuisances=[
    SimpleNamespace(name='tool.mass', key='mass'), SimpleNamespace(name='wrench.gain.0',
                                                                   key='wrench_gain')])
ACCEPTED = [
    Accepted('tool_mass', np.zeros(0), np.zeros(0), np.zeros(0, dtype=int),
             frozenset(['tool.mass'])),
    Accepted('wrench_lowpass', np.array([0.004, 0.5]), np.array([1e-4, 0.1]), np.array([0, 1]),
             frozenset()),
    Accepted('base_tilt', np.array([0.0, 0.02]), np.array([0.0, 1e-3]), np.array([1]),
             frozenset())]
NUMBERS = {'tool_mass': {'change': Parameter(0.1, 0.002, '1')},
           'wrench_lowpass': {'time_constant': Parameter(0.004, 1e-4, 's'),
                              'second_order': Parameter(0.5, 0.1, '1')},
           'base_tilt': {'x': Parameter(0.0, 0.0, 'rad'), 'y': Parameter(0.02, 1e-3, 'rad')}}
KNOWN = np.array([1.0, 1.0, 4.0, 0.0, 0.25])


def errors(taken):
    return Errors(np.zeros((len(CHANNELS), 5, 5)), np.diag(KNOWN), taken)


def test_each_number_has_what_was_taken_in_its_own_column_besides():
    found = with_taken(MODEL, ACCEPTED, NUMBERS, errors(np.diag([3.0, 99.0, 12.0, 5.0, 2.0])), 1.0)
    assert found['tool_mass']['change'].std == pytest.approx(0.002 * 2.0)
    assert found['wrench_lowpass']['time_constant'].std == pytest.approx(1e-4 * 2.0)
    assert found['wrench_lowpass']['second_order'].std == 0.1  # at its bound in the fit
    assert found['base_tilt'] == {'x': Parameter(0.0, 0.0, 'rad'),
                                  'y': Parameter(0.02, 3e-3, 'rad')}
    values = [[p.value for p in own.values()] for own in found.values()]
    assert values == [[p.value for p in own.values()] for own in NUMBERS.values()]


def test_what_is_left_may_be_of_the_effects_own_shape():
    found = with_taken(MODEL, ACCEPTED, NUMBERS, errors(np.zeros((5, 5))), 0.6)
    assert found['tool_mass']['change'].std == pytest.approx(np.hypot(0.002, 0.3 * 0.4 * 0.1))
    assert found['base_tilt']['y'].std == pytest.approx(np.hypot(1e-3, 0.3 * 0.4 * 0.02))
    assert found['base_tilt']['x'].std == 0.0
    # how an effect acts is no size of it
    assert found['wrench_lowpass']['second_order'].std == 0.1
    worse = with_taken(MODEL, ACCEPTED, NUMBERS, errors(np.zeros((5, 5))), -3.0)
    assert worse['tool_mass']['change'].std == pytest.approx(np.hypot(0.002, 0.3 * 0.1))


def test_nothing_changes_where_nothing_is_beside_the_effect():
    assert with_taken(MODEL, ACCEPTED, NUMBERS, errors(None), 0.2) == NUMBERS


def test_numbers_of_which_the_data_tell_a_combination_alone_are_grouped():
    names = ('kp[lift]', 'robot.delay', 'kv[lift]', 'tilt.x', 'kp[pan]')
    model = SimpleNamespace(nuisances=[SimpleNamespace(name=name) for name in names])
    shared = np.array([[1.0, 0.95, 0.5, 0.0, 0.0], [0.95, 1.0, -0.92, 0.8, 0.0],
                       [0.5, -0.92, 1.0, 0.0, 0.0], [0.0, 0.8, 0.0, 1.0, 0.0],
                       [0.0, 0.0, 0.0, 0.0, 0.0]])  # the last one is at its limit
    size = np.diag([3.0, 0.1, 2.0, 1e-3, 1.0])
    found = aliases(model, Errors(np.zeros((len(CHANNELS), 5, 5)), np.eye(5),
                                  marginal=size @ shared @ size))
    assert found == (frozenset(('kp[lift]', 'robot.delay', 'kv[lift]')),)
