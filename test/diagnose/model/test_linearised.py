"""The linearised model stays within what is physical."""

from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.nuisances import LIMIT, NAMELESS, nuisances, prior_std
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest


def test_no_step_makes_a_mass_or_a_spring_negative():
    rig = load_rig(None)
    found = nuisances(rig, 'acc1', ('wrench', 'accelerometer', 'optidrive', 'pose'))
    p = LinearisedModel(rig, (), found, np.array(prior_std(rig, found)),
                        centre=np.zeros(len(found)))
    p.centre = p.moved(np.full(len(found), -1e6))
    moved = p.current()
    assert moved.tool.mass == pytest.approx(0.05 * rig.tool.mass)
    assert moved.wall.stiffness == pytest.approx(0.05 * rig.wall.stiffness)
    assert moved.optidrive.stiffness == pytest.approx(0.05 * rig.optidrive.stiffness)
    offset = [n.name for n in found].index('wrench.bias.0')
    assert p.centre[offset] == -1e6


def test_what_no_effect_could_name_may_depart_further_than_what_has_one():
    rig = load_rig(None)
    found = nuisances(rig, 'acc1', ('wrench', 'accelerometer', 'optidrive', 'pose'))
    named = {effect.nuisance for effect in EFFECTS.values()}
    bound = LinearisedModel(rig, (), found, np.array(prior_std(rig, found)),
                            centre=np.zeros(len(found))).prior().high
    for nuisance, most in zip(found, bound):
        assert most == (LIMIT if nuisance.key in named else NAMELESS), nuisance.name
