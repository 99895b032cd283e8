"""The arm in Drake, a generator since part 5, and what that part is drawn and scored by."""

import sys

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='requires mujoco, which is not installed')

from blind.seal import SealError
from blind.second import arm, on_arm, on_drake, rules, sealing
from blind.second.case import make, Plan
from blind.second.judged import Judged
from blind.second.score import FALSE, score

FINE = 0.00005, 'implicitfast'
"""Time step and integrator of which nothing is left in MuJoCo [s]."""


@pytest.fixture
def short(monkeypatch):
    """Let motions last 6 s."""
    monkeypatch.setattr(on_arm, 'SECONDS', 6.0)


def _drake():
    pytest.importorskip('pydrake', reason='requires drake, which is not installed')


@pytest.mark.parametrize('pull', [0.0, 50.0])
def test_arm_in_drake_differs_from_mujoco_by_less_than_the_models_own_step(pull):
    _drake()
    told = arm.commands(6.0, np.random.default_rng(1))
    n = arm.Numbers(pull=pull, tilt=(0.05, -0.03), friction=(0.0,) * 6)
    drake, model, exact = (on_drake.ran_in_drake(n, told), arm.ran(n, told, *on_arm.MODEL),
                           arm.ran(n, told, *FINE))
    for topic in ('wrench', 'joints', 'position'):
        off, step = (np.std(getattr(one, topic) - getattr(exact, topic), axis=0)
                     for one in (drake, model))
        assert (off < step).all(), (topic, off, step)


def test_arm_in_drake_rubs_as_in_mujoco_but_where_a_joint_turns_round():
    _drake()
    told = arm.commands(6.0, np.random.default_rng(1))
    n = arm.Numbers()
    drake, exact = on_drake.ran_in_drake(n, told), arm.ran(n, told, *FINE)
    off = np.abs(drake.wrench - exact.wrench)
    assert off[:250].max() < 0.001 and np.median(off[500:1000]) < 0.01 < off.max() < 1.0
    bent = np.array(n.friction) / np.array(n.kp)  # a drive, where its joint rubs
    assert (np.median(np.abs(drake.joints - exact.joints)[500:1000], axis=0) < 0.3 * bent).all()


@pytest.mark.long
def test_case_in_drake_comes_out_again_and_gives_the_model_of_mujoco(short):
    _drake()
    plan = Plan('drake', 'library', 'tool_mass', rules.DEVELOPMENT, 7)
    one, other = (make(plan, sealing.generator('drake')) for _ in range(2))
    assert sealing.content(one.arrays) == sealing.content(other.arrays)
    assert str(one.arrays['model']) == arm.source(arm.Numbers(), *on_arm.MODEL)
    assert one.label['own'] > 0.0 and one.label['size'] <= 0.5


def test_without_drake_its_cases_say_what_to_install(short, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pydrake.all', None)  # as on a machine without it
    found = sealing.generator('drake')
    assert found.effects == sealing.generator('arm').effects  # hashes verify without it
    with pytest.raises(SealError, match='cases of drake want pydrake: pip install drake'):
        found(1, {})


def test_drake_is_drawn_as_the_arm_is_and_no_part_before_differs():
    for half in ('sealed-3', 'sealed-4'):
        assert rules.rules_of(half) == rules.THIRD and 'drake' not in rules.THIRD.bare
    for half in ('sealed-5', rules.DEVELOPMENT):
        drawn_by = rules.rules_of(half)
        assert drawn_by.bare['drake'] == drawn_by.bare['arm']
        assert {**drawn_by.bare, **rules.THIRD.bare} == dict(drawn_by.bare)
        limits = {name: largest for (one, name), largest in drawn_by.limits.items()
                  if one == 'drake'}
        assert limits == {name: largest for (one, name), largest in rules.THIRD.limits.items()
                          if one == 'arm'}


def test_targets_are_those_of_the_part():
    label = {'generator': 'arm', 'kind': 'none', 'effect': '', 'excused': [], 'doubtful': [],
             'ambiguous': False, 'background': {'gyro': 100.0}, 'own': 0.0, 'half': 'sealed-4'}
    cases = [Judged('a', label, {'cpu_seconds': 1.0, 'document': {
        'verdict': 'identified', 'candidates': [{'name': 'tool_mass', 'probability': p}]}})
        for p in (0.9, 0.1)]
    before, since = ({row.what: row for row in score(cases, half).rows}
                     for half in ('', 'sealed-5'))
    log = 'log score (mean log of what the truth was given)'
    assert FALSE not in before and not before[log].target
    assert (since[FALSE].hits, since[FALSE].total, since[FALSE].good) == (1, 2, False)
    assert since[log].value == pytest.approx(np.log([0.1, 0.9]).mean())
    assert since[log].good is False
