"""Contact of a robot and of its simulation: how the two surfaces differ, and what is not known."""

from functools import cache
import re

from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.search.posterior import Posterior
from forcecal_ros.diagnose.sources.contact import (
    compare_contact,
    Touch,
    touch_of_robot,
    touch_of_simulation,
    with_contact,
)
from forcecal_ros.diagnose.sources.pair import PairSource, prepare_pair
from forcecal_ros.diagnose.verdict import UNKNOWN
from forcecal_ros.sim.measured_motion import RecordedSimulation
import numpy as np
from own_arm import TOLERANCES
import pytest
from touching import robot, RUBS

FREE = Diagnosis('no_gap', 'the rig explains the recording')
ABSENT = {'position': 1.4}


@cache
def simulated(slide=0.02, absent=False):
    return robot(ABSENT if absent else None, seed=None, slide=slide)


def touches(recording, slide=0.02, absent=False, known=None):
    """Return the contact of both, the simulation along the robot's motion, and its tool."""
    made = simulated(slide, absent)
    dataset, tool = prepare_pair(recording, made, known, TOLERANCES)
    simulation = dataset.simulation
    assert isinstance(simulation, RecordedSimulation)
    return (touch_of_robot(recording, simulation, dataset.rig, simulation.touching),
            touch_of_simulation(made, simulation, tool.simulated), simulation, tool)


def compared(recording, slide=0.02, known=None):
    return weigh(*touches(recording, slide, known=known)[:2])


@cache
def nearly_alike(seed):
    """Return the contact of a robot whose friction differs by thirty of its standard errors."""
    return touches(robot(rubs=RUBS + 0.01, seed=seed))


def weigh(one, other):
    return compare_contact(one, other, TOLERANCES.spreads, Posterior(None, (), ()))


@pytest.mark.parametrize('wall, rubs, name, value', [
    ({'damping': 200.0}, RUBS, 'contact_damping', 3.0),
    *(pytest.param(*one, marks=pytest.mark.long) for one in (
        ({'stiffness': 5e3}, RUBS, 'contact_stiffness', -0.5),
        ({'position': 1.282}, RUBS, 'wall_position', 0.002),
        ({'position': 1.278}, RUBS, 'wall_position', -0.002),
        ({}, 0.45, 'contact_friction', 0.15)))])
def test_what_the_robots_surface_has_otherwise_is_named_with_its_size(wall, rubs, name, value):
    found = compared(robot(wall, rubs), known=nearly_alike(3)[-1])
    effect, = found.effects
    (number,) = effect.parameters.values()
    assert effect.name == name
    assert effect.probability > 0.9
    # of the noise of poses in a law of 3 to 7 s, some ten blocks, by Student's t
    assert number.std < 0.11 * abs(value)
    assert number.value == pytest.approx(value, abs=max(3.0 * number.std, 0.01 * abs(value)))
    assert found.explained > 0.99
    d = with_contact(FREE, found)
    assert d.verdict == 'identified'
    assert d.reason.startswith(f'{name} explains ')
    assert [one for one in d.candidates if one[0] != UNKNOWN] == [(name, effect.probability)]


@pytest.mark.parametrize('seed', [3, *(pytest.param(n, marks=pytest.mark.long) for n in (4, 5))])
def test_surfaces_that_are_alike_have_no_name(seed):
    *both, simulation, _ = nearly_alike(seed)
    found = weigh(*both)  # friction differs by less than its tolerance
    assert not found.effects and not found.not_identified
    stiffness, damping, _, friction = found.numbers[0]
    assert stiffness == pytest.approx(1e4, rel=0.01)
    assert damping == pytest.approx(50.0, abs=3.0 * found.std[0, 1])
    assert friction == pytest.approx(RUBS + 0.01, abs=0.005)
    assert found.seconds[0] == pytest.approx(6.6, abs=0.3)
    assert with_contact(FREE, found).verdict == 'no_gap'
    assert '6.6 s of contact: no difference of contact_stiffness' in with_contact(
        FREE, found).reason
    assert 0.004 * simulation.touching.sum() == pytest.approx(7.1, abs=0.3)


def test_three_differences_are_named_together_and_their_numbers_are_in_the_document():
    recording = robot({'stiffness': 5e3, 'position': 1.278}, 0.45)
    found = PairSource(TOLERANCES, simulated()).diagnose(recording)
    d = found.diagnosis
    assert d.verdict == 'identified'
    assert re.search('explain (over 99|100) % of the difference in 6.. s of contact', d.reason)
    assert {e.name: next(iter(e.parameters.values())).value for e in d.effects} == {
        'contact_stiffness': pytest.approx(-0.5, abs=0.01),
        'wall_position': pytest.approx(-2e-3, abs=2e-5),
        'contact_friction': pytest.approx(0.15, abs=0.005)}
    assert found.details['contact']['robot']['contact_stiffness']['value'] == pytest.approx(
        5e3, rel=0.02)
    assert any(note.startswith('contact_stiffness: robot ') for note in d.notes)
    assert not any('contact' in one for one in d.not_compared)


@pytest.mark.long
def test_without_motion_along_the_surface_its_friction_is_not_known():
    found = compared(robot({'stiffness': 5e3}, slide=0.0), slide=0.0)
    assert found.not_identified == ('contact_friction',)
    assert [e.name for e in found.effects] == ['contact_stiffness']
    assert '(contact_friction: not identifiable)' in with_contact(FREE, found).reason


@pytest.mark.parametrize('absent', [
    'robot', pytest.param('simulation', marks=pytest.mark.long)])
def test_contact_of_one_alone_is_a_gap_that_the_verdict_states(absent):
    real = robot(ABSENT if absent == 'robot' else None)
    known = nearly_alike(3)[-1] if absent == 'robot' else None
    *both, simulation, _ = touches(real, absent=absent == 'simulation', known=known)
    found = weigh(*both)
    assert found.one_sided
    assert 0.004 * simulation.touching.sum() == pytest.approx(7.1, abs=0.4)
    d = with_contact(FREE, found)
    assert d.verdict == 'unknown'
    other = 'simulation' if absent == 'robot' else 'robot'
    assert f'the {other} touches something for 6.' in d.reason
    assert f'the {absent} for 0.0 s' in d.reason


def test_a_force_as_soft_as_a_cable_is_no_contact_of_the_robot_alone():
    soft = robot({'stiffness': 300.0, 'position': 1.26})
    *_, simulation, _ = touches(soft, absent=True)
    assert not simulation.touching.any()


def held(depth_std, force_std, seed=1):
    """Return 4 s of a tip that is pressed against a surface, with depths of their own."""
    rng, n = np.random.default_rng(seed), 1000
    force = np.outer(rng.normal(-30.0, force_std, n), [1.0, 0.0, 0.0])
    position = np.outer(rng.normal(0.0, depth_std, n), [1.0, 0.0, 0.0]) + [1.0, 0.0, 1.0]
    return Touch(force, np.cross([0.0, 0.0, 0.2], force), position,
                 np.gradient(position, 0.004, axis=0), np.tile(np.eye(3), (n, 1, 1)),
                 np.zeros((n, 3)), (0.0, 1e-4))


def test_a_force_that_is_held_is_a_law_within_the_noise_of_poses():
    found = weigh(held(1e-4, 0.1), held(1e-4, 0.1, seed=2))
    assert not found.why_not and 'contact_stiffness' in found.not_identified


def test_a_depth_that_does_not_follow_the_force_is_no_law():
    found = weigh(held(1e-3, 5.0), held(1e-3, 5.0, seed=2))
    assert re.match('the contact depth of the robot does not follow its force',
                    found.why_not)


def test_motion_without_contact_has_none_to_compare():
    _, touch, *_ = nearly_alike(3)
    none = touch._replace(**{name: getattr(touch, name)[:0] for name in Touch._fields[:-1]})
    found = weigh(none, none)
    assert with_contact(FREE, found).reason.endswith(
        '; no contact in the recording; contact is not compared')
    assert not found.why_not and not list(found.notes())


def test_forces_of_several_directions_are_no_law_and_the_verdict_states_it():
    _, touch, *_ = nearly_alike(3)
    # the second half pushes the other way
    ways = np.where(np.arange(len(touch.force)) < 0.5 * len(touch.force), 1.0, -1.0)
    turned = touch._replace(force=ways[:, np.newaxis] * touch.force)
    found = weigh(turned, touch)
    d = with_contact(FREE, found)
    assert d.verdict == 'no_gap'
    assert 'contact is not compared: the tool is pushed in several directions' in d.reason
