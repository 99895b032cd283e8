"""Something that looks like a number that was named: which of the two is told."""

from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.imitations import _best, judged_beside, Tried
from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.sim.protocol import Imitation
from forcecal_ros.sim.protocol import Parameter as Number
from forcecal_ros.sim.rerun import simulated_robot
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rigid_tool import rigid_tool_of_rig
import numpy as np
import pytest

RUBS = NamedEffect('dof_frictionloss[lift]', {'value': Parameter(20.0, 1.0, 'N m')}, 0.9)
PLAY = Imitation('backlash[lift]', 1e-3, 'rad', 'no number makes play')


def beside(left):
    """Judge play that leaves so much of a misfit of 100, of which friction leaves 30."""
    robot = simulated_robot(rigid_tool_of_rig(load_rig('rigid_tool.yaml')), (
        Number('dof_frictionloss[lift]', 0.5, 0.1),))
    diagnosis = Diagnosis('partial', 'it explains 70 %', (RUBS,), ((RUBS.name, 0.9),),
                          gap=Gap(1.0, 1.0, 0.5, 0.7, (0.6, 0.8), {}))
    play = Tried(PLAY, RUBS.name, (0.5,), 9e-4, 1e-5, left)
    return judged_beside(Outcome(diagnosis, robot), play, np.array([100.0, 28.0, 30.0])).diagnosis


@pytest.mark.parametrize('left, verdict, named, offered', [
    (5.0, 'identified', 'backlash[lift]', {'backlash[lift]'}),
    (28.0, 'ambiguous', RUBS.name, {'backlash[lift]', RUBS.name}),
    (32.0, 'ambiguous', RUBS.name, {'backlash[lift]', RUBS.name}),
    (40.0, 'partial', RUBS.name, {RUBS.name})])
def test_what_leaves_less_is_named_and_what_leaves_as_much_is_offered(
        left, verdict, named, offered):
    found = beside(left)
    assert found.verdict == verdict
    assert [e.name for e in found.effects] == [named]
    assert {name for name, _ in found.candidates} == offered
    if named == 'backlash[lift]':
        assert found.effects[0].parameters['value'] == Parameter(9e-4, 1e-5, 'rad')
        assert found.gap.closed == pytest.approx(0.95)


def test_the_best_size_is_that_of_the_parabola_and_no_further_than_what_was_tried():
    sizes = np.array([0.6, 0.9, 1.2, 1.6])
    at, std, left = _best(sizes, 40.0 * (sizes - 1.1) ** 2 + 3.0)
    assert (at, std, left) == pytest.approx((1.1, 1.0 / np.sqrt(40.0), 3.0))
    at, _, left = _best(sizes, 100.0 - sizes)
    assert (at, left) == (1.6, 98.4)
