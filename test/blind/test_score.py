"""Scoring of the blind check, on answers made up for the purpose."""

from blind.answered import same_class
from blind.score import calibration_error, Rate, score
import pytest


def _label(kind, *names, energy=1e4):
    parts = [{'name': name, 'size': 1.0, 'unit': '1', 'stage': 'tool', 'random': False,
              'energy': energy} for name in names]
    return {'kind': kind, 'parts': parts, 'energy': energy * bool(names), 'energy_fit': energy,
            'cells': {'force.x': {'sweep': 2.0, 'contact': 1.2}, 'torque.y': {'sweep': 0.5}}}


def _result(verdict, effects=(), candidates=(), where=(), closed=1.0):
    def listed(pairs):
        return [{'name': name, 'probability': p, 'parameters': {}} for name, p in pairs]
    return {'document': {
        'verdict': verdict, 'effects': listed(effects), 'candidates': listed(candidates),
        'where': [{'stage': stage, 'channel': channel, 'phase': phase}
                  for stage, channel, phase in where],
        'gap': {'closed': closed}}, 'cpu_seconds': 9.0, 'seconds': 9.0, 'route': 'arrays'}


def _row(figures, start):
    row, = (one for one in figures.rows if one.what.startswith(start))
    return (row.hits, row.total) if isinstance(row, Rate) else row.value


def test_gap_without_effect_is_a_false_alarm_and_a_miss():
    figures = score({'a': _label('none'), 'b': _label('none')},
                    {'a': _result('identified', [('tool_mass', 1.0)]), 'b': _result('no_gap')})
    assert _row(figures, 'false alarms') == (1, 2)
    assert [miss.identity for miss in figures.misses] == ['a']


def test_alias_counts_by_class_only():
    labels = {'a': _label('single', 'wrench_delay')}
    found = [('wrench_lowpass', 0.9)]
    figures = score(labels, {'a': _result('identified', found, found)})
    assert same_class('wrench_delay', 'wrench_lowpass')
    assert _row(figures, 'right effect first') == (0, 1)
    assert _row(figures, 'right effect or an alias first') == (1, 1)
    assert _row(figures, 'mean probability') == 0.0
    assert 'aliases' in figures.misses[0].why


def test_remainder_that_outweighs_the_name_is_unknown():
    labels = {'a': _label('outside', 'slosh'), 'b': _label('outside', 'slosh'),
              'c': _label('single', 'cable_force')}
    found = [('cable_force', 0.2)]
    figures = score(labels, {
        'a': _result('partial', found, [('unknown', 0.8), *found]),
        'b': _result('identified', [('cable_force', 1.0)], [('cable_force', 1.0)]),
        'c': _result('partial', found, [('unknown', 0.8), *found])})
    assert _row(figures, 'outside the library, recognised') == (1, 2)
    assert [miss.identity for miss in figures.misses] == ['b', 'c']


def test_place_is_right_where_half_of_the_strongest_excess_is():
    labels = {one: _label('single', 'tool_mass') for one in 'ab'}
    named = [('tool_mass', 1.0)]
    figures = score(labels, {
        'a': _result('identified', named, named, [('tool', 'force.x', 'contact')], 0.99),
        'b': _result('identified', named, named, [('robot', 'torque.y', 'sweep')], 0.79)})
    assert _row(figures, 'stage right') == (1, 2)
    assert _row(figures, 'channel and phase') == (1, 2)
    # the oracle closes 1 - 1 / sqrt(1e4)
    assert _row(figures, 'points of shrink') == pytest.approx((0.0 + 20.0) / 2)


def test_probabilities_that_come_true_as_often_as_stated_have_no_calibration_error():
    assert calibration_error([(0.8, True)] * 8 + [(0.8, False)] * 2) == pytest.approx(0.0)
    assert calibration_error([(0.9, False)] * 5) == pytest.approx(0.9)
