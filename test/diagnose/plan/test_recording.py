"""Plans for some effects: what they need, what the limits allow, what they cannot show."""

from dataclasses import replace

from forcecal_ros.diagnose.plan import (
    Alias,
    limitations,
    LONG_REST_S,
    motion_for,
    parts_for,
    plan_parameters,
    plan_text,
    Planned,
    timing_for,
    Visibility,
)
from forcecal_ros.effects import EFFECTS
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import Timing
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest

RIG = load_rig()


@pytest.mark.parametrize('names, needs, leaves_out', [
    (['wrench_delay'], {'shakes', 'steps', 'sweeps'}, {'reversals'}),
    (['wrench_bias_drift'], set(), {'sweeps', 'steps', 'reversals'}),
    (['tool_friction'], {'reversals'}, set()), (['tool_mass'], set(), {'reversals'}),
    (['wrench_delay', 'tool_friction'], {'shakes', 'reversals'}, set())])
def test_an_effect_gets_what_it_needs_and_nothing_that_it_does_not(names, needs, leaves_out):
    timing = timing_for(names)
    assert all(getattr(timing, part) for part in needs)
    assert not any(getattr(timing, part) for part in leaves_out)
    assert (timing.rest == LONG_REST_S) == (names == ['wrench_bias_drift'])
    assert timing_for(()) == Timing(measure=1.0)


def test_each_effect_gets_a_motion_that_excites_it():
    for name, effect in EFFECTS.items():
        timing = timing_for([name])
        recorded = {'measure', 'move'} | {phase for phase, count in (
            ('step', timing.steps), ('reverse', timing.reversals),
            ('sweep', timing.sweeps + timing.turns + timing.shakes)) if count}
        assert effect.excited_by == ('contact',) or recorded & set(effect.excited_by), name
        assert parts_for([name]) <= parts_for(()) | {'rest'}


def test_a_slow_robot_moves_less_and_poses_outside_the_box_are_left_out():
    limits = Limits(speed=0.05, acceleration=1.8, jerk=200.0, angular_speed=0.5,
                    workspace_min=(0.85, -0.15, 0.8), workspace_max=(1.25, 0.15, 1.1))
    motion = motion_for(RIG, contact=False, limits=limits)
    assert 0.0 < motion.timing.amplitude < 0.5
    assert 'h' in motion.left_out and 'v' in motion.poses
    speed = np.linalg.norm(np.diff(motion.target.position, axis=0), axis=1) / RIG.robot.period
    assert speed.max() <= 0.05


@pytest.fixture(scope='module')
def planned():
    motion = motion_for(RIG, contact=False, effects=['tool_mass'])
    shown = tuple(Visibility(name, '1', energy, '', energy, EFFECTS[name].excited_by)
                  for name, energy
                  in (('tool_mass', 100.0), ('contact_stiffness', 0.0), ('wrench_delay', 9.0),
                      ('wrench_lowpass', 90.0), ('base_tilt', 90.0)))
    return Planned(motion._replace(timing=replace(motion.timing, amplitude=0.5)), shown,
        (Alias('wrench_delay', 'wrench_lowpass', 9.0), Alias('base_tilt', 'tool_mass', 8.0),
         Alias('base_tilt', 'wrench_lowpass', 7.0)),
        ('tool_mass', 'contact_stiffness', 'wrench_delay'))


def test_a_plan_says_what_it_cannot_show_and_what_it_would_confound(planned):
    text = plan_text(planned)
    assert 'wrench_delay / wrench_lowpass' in text and 'base_tilt / wrench_lowpass' not in text
    assert [line.split(':')[0] for line in limitations(planned)] == [
        'contact_stiffness', 'wrench_delay', 'the limits allow 50% of the usual distances']
    assert '--contact' in limitations(planned)[0]
    assert planned.unclear == ['wrench_delay']


def test_the_file_holds_the_parts_that_differ_from_the_defaults(planned):
    text = plan_parameters(planned)
    assert 'reversals: 0' in text and 'amplitude: 0.5' in text and 'workspace' not in text
