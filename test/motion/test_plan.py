"""The planned recording: within the limits, runnable, and showing what it says it shows."""

import contextlib
from dataclasses import replace
import io
import json
import re

from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import MotionError
from forcecal_ros.diagnose.plan import poses_of, SETTLE_S, wider_box
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import (
    calibration_plan,
    diagnosis_plan,
    outline,
    path_of,
    prepare,
    preview,
    Timing,
)
from forcecal_ros.motion.profiles import JointMove, nominal_poses, Pace, step_goal
from forcecal_ros.nodes.sequencer import PARAMETERS, settings_of
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import pytest
import yaml

DEFAULTS = {row.name: row.default for row in PARAMETERS}


def parts(timing, limits):
    poses = nominal_poses()
    home = poses['v']
    plan = diagnosis_plan(poses, step_goal(home, timing.contact_distance), timing)
    return prepare(plan, home, Pace(), limits)


def test_every_kind_of_motion_is_within_the_default_limits():
    phases = {part.segment.phase for part in parts(Timing(), Limits())}
    assert phases == {'move', 'settle', 'measure', 'step', 'sweep', 'reverse'}


def test_an_outline_holds_what_the_stream_of_commands_does():
    plan, tip = parts(Timing(), Limits()), Limits().tip
    said, (stream, _) = outline(plan, tip), preview(plan, 250.0, 0.0)
    moves = [part.move for part in plan if part.move is not None]
    largest = max(move.peak_speeds[0] for move in moves)
    count, duration, sensor, of_tip = re.fullmatch(
        rf'(\d+) moves in ([\d.]+) s and \d+ settlings, .* deg long, at most {largest:.3g} m/s '
        r'and .* rad/s; ft_sensor stays within (.*) m, the tip within (.*) m', said).groups()
    speed = np.linalg.norm(np.diff(stream.position, axis=0), axis=1) * 250.0
    assert 0.99 * largest < speed.max() <= largest
    reached = stream.position + stream.R_base_sensor @ tip
    # quarter of a path's step at 0.16 m/s and 0.3 m of lever at 1.45 rad/s lies between two poses
    for points, corners in ((reached, of_tip), (stream.position, sensor)):
        lower, upper = (np.array(corner.split(), dtype=float) for corner in corners.split(' to '))
        np.testing.assert_allclose(points.min(axis=0), lower, atol=3e-3)
        np.testing.assert_allclose(points.max(axis=0), upper, atol=3e-3)
    assert float(duration) == pytest.approx(stream.t[-1], abs=0.5)
    assert int(count) == len(moves)


def test_of_joints_an_outline_says_their_speed_and_no_box():
    home, away = np.zeros(6), np.full(6, 0.01)
    plan = prepare(calibration_plan({'a': home, 'b': home + 0.6}, away, Timing()), home, Pace(),
                   Limits())
    said = outline(plan, Limits().tip)
    assert 'at most 1.45 rad/s of a joint' in said and 'within' not in said
    assert not len(path_of(plan)[0])


def test_contact_is_refused_where_the_box_does_not_reach_the_wall():
    timing = Timing(contacts=1)
    with pytest.raises(MotionError, match='workspace_max'):
        parts(timing, Limits(workspace_max=(1.25, 0.4, 1.4)))
    phases = {p.segment.phase for p in parts(timing, Limits())}
    assert phases >= {'approach', 'contact', 'retract'}


def test_joints_sweep_between_home_and_away():
    home, away = np.zeros(6), np.full(6, 0.05)
    plan = prepare(diagnosis_plan({'home': home}, away, Timing()), home, Pace(), Limits())
    sweeps = [p.move for p in plan if p.segment.phase == 'sweep']
    assert sweeps and all(isinstance(move, JointMove) for move in sweeps)


@pytest.fixture(scope='module')
def planned(tmp_path_factory):
    path = tmp_path_factory.mktemp('plan') / 'plan.yaml'
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(['plan', '--contact', '-o', str(path), '--json']) == 0
    return path, json.loads(out.getvalue())


@pytest.mark.long
def test_the_plan_shows_every_effect_of_the_library(planned):
    _, document = planned
    assert {e['name'] for e in document['effects']} == set(EFFECTS)
    assert {e['shows'] for e in document['effects']} <= {'clearly', 'by its stamps or values'}


@pytest.mark.long
def test_the_plan_names_what_it_cannot_tell_apart(planned):
    _, document = planned
    pairs = [set(a['effects']) for a in document['alike']]
    assert {'wrench_delay', 'wrench_lowpass'} in pairs
    assert {'cable_force', 'base_tilt'} in pairs


def chosen(keep):
    """Commands of the plan's rest, and of some of its segments."""
    rig, timing = load_rig(), Timing()
    poses = poses_of(rig)
    home = next(iter(poses.values()))
    plan = diagnosis_plan(poses, step_goal(home, timing.contact_distance), timing)
    kept = [*plan[:3], *(segment for segment in plan[3:] if keep(segment))]
    return preview(prepare(kept, home, Pace(), Limits()), 1.0 / rig.robot.period, SETTLE_S)


def diagnosed(motion, effects):
    target, phases = motion
    recording = simulate(with_effects(load_rig(), effects), target, seed=3)
    return RigSource(load_rig()).diagnose(replace(recording, phases=phases)).diagnosis


LATE = (('wrench_delay', {'delay': 0.004}), ('wrench_lowpass', {'time_constant': 0.004}))


@pytest.mark.long
@pytest.mark.parametrize('name, values', LATE)
def test_quick_legs_of_the_plan_tell_a_delay_from_a_lowpass(name, values):
    found = diagnosed(chosen(lambda s: 'quickly' in s.label), {name: values})
    assert found.verdict == 'identified'
    assert [e.name for e in found.effects] == [name]


@pytest.mark.long
def test_slow_reversals_alone_leave_both():
    name, values = LATE[0]
    found = diagnosed(chosen(lambda s: s.phase == 'reverse'), {name: values})
    assert found.verdict == 'ambiguous'
    assert {n for n, _ in found.candidates} - {'unknown'} == {n for n, _ in LATE}


@pytest.mark.long
def test_the_written_plan_is_a_parameter_file_of_the_sequencer(planned):
    path, _ = planned
    parameters = yaml.safe_load(path.read_text())['/**/sequencer']['ros__parameters']
    given = {f'{group}.{name}': value for group, values in parameters.items()
             if isinstance(values, dict) for name, value in values.items()}
    assert set(given) <= set(DEFAULTS)
    settings = settings_of({**DEFAULTS, **given, 'sequence': parameters['sequence']})
    assert settings.sequence == 'diagnose'
    assert list(settings.poses) == ['v', 'h', 'tilt', 'left', 'right']
    assert settings.timing.contacts == 2
    assert 'workspace_max' not in path.read_text()


def test_a_wall_beyond_the_default_box_is_said_in_a_comment():
    assert wider_box(Limits(), 1.3) == ''
    lines = wider_box(Limits(), 1.36).splitlines()
    assert all(line.startswith('    # ') for line in lines)
    assert lines[-1].endswith('workspace_max: [1.360, 0.4, 1.4]')
