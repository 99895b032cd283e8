"""Motion is what commands and sensors show; the word of a phase alone is none."""

from dataclasses import replace

from calibration_runs import run
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.poses import rest_within
from forcecal_ros.checks.signals import refuse_frozen_pose
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
import numpy as np
import pytest


@pytest.fixture(scope='module')
def exact():
    """Return a run whose pose repeats itself at rest, as that of an encoder without noise."""
    recording = run(noise=False)
    pose = recording.pose
    return replace(recording, pose=replace(
        pose, position=np.round(pose.position, 6), R_base_sensor=np.round(pose.R_base_sensor, 7)))


def held(pose, start, end):
    """Return a pose that repeats its reading of ``start`` up to ``end`` [s]."""
    source = np.arange(len(pose))
    inside = (pose.t >= start) & (pose.t < end)
    source[inside] = np.argmax(inside)
    return replace(pose, position=pose.position[source], R_base_sensor=pose.R_base_sensor[source])


def later(stream, delay):
    return replace(stream, t=stream.t + delay)


def announced_early(recording, delay):
    """Say each phase by so much before its commands come [s]."""
    return replace(recording, phases=tuple(
        Phase(p.name, p.start - delay, p.end - delay) for p in recording.phases))


@pytest.mark.parametrize('late', [0.05, 2.0])
def test_a_robot_that_waits_for_late_commands_is_not_frozen(exact, late):
    refuse_frozen_pose(announced_early(exact, late))
    refuse_frozen_pose(announced_early(replace(exact, target=None), late))


@pytest.mark.parametrize('late', [0.1, 1.5])
def test_a_robot_that_follows_late_is_not_frozen(exact, late):
    refuse_frozen_pose(replace(exact, target=later(exact.target, -late)))


def test_a_robot_that_plans_its_way_to_a_far_goal_first_is_not_frozen(exact):
    target = exact.target
    changes = np.flatnonzero((np.diff(target.R_base_sensor, axis=0) != 0).any(axis=(1, 2)))
    starts = changes[np.diff(changes, prepend=-1000) > 100]
    goals = np.append(starts[1:], len(target) - 1)
    refuse_frozen_pose(replace(exact, target=PoseStream(
        target.t[starts] - 1.0, target.position[goals], target.R_base_sensor[goals])))


@pytest.mark.parametrize('end', [8.5, np.inf], ids=['for a while', 'to the end'])
def test_a_pose_that_freezes_while_commands_move_is_refused(exact, end):
    frozen = replace(exact, pose=held(exact.pose, 7.0, end), source='run 7')
    with pytest.raises(DataError, match=r'current_pose is constant from 7\.00 '
                       r's to (8\.50|18\.54) s of run 7, while the commanded pose moves'):
        refuse_frozen_pose(frozen)
    with pytest.raises(DataError, match='is constant from 7.00 s'):
        identify(frozen)


@pytest.mark.parametrize('source', ['accelerometer', 'wrench', 'angular_velocity'])
def test_other_sensors_say_that_a_robot_moves_where_no_commands_are(exact, source):
    noisy = run(seed=4)
    turning = np.zeros((len(noisy.wrench), 3))
    turning[(noisy.wrench.t > 7.0) & (noisy.wrench.t < 9.5), 1] = 0.4
    streams = {'accelerometer': noisy.accelerometer, 'wrench': noisy.wrench,
               'angular_velocity': Stream(noisy.wrench.t, turning + 1e-3 * noisy.wrench.values[
                   :, :3] / 130.0)}
    alone = Recording(pose=held(exact.pose, 6.0, np.inf), phases=exact.phases,
                      **{source: streams[source]})
    name = source.replace('_', ' ')
    with pytest.raises(DataError, match=f'while the {name} shows that the robot moves'):
        refuse_frozen_pose(alone)
    refuse_frozen_pose(replace(alone, pose=exact.pose))


def test_a_hand_at_a_tool_that_stands_moves_no_robot(exact):
    noisy = run(seed=4)
    t = noisy.wrench.t
    pushed = noisy.wrench.between(0.0, 2.0).values[0] * np.ones((len(t), 1))
    pushed = pushed + 20.0 * np.sin(t)[:, None]
    stands = Recording(pose=held(exact.pose, 0.0, np.inf), wrench=replace(
        noisy.wrench, values=pushed))
    refuse_frozen_pose(stands)
    refuse_frozen_pose(replace(stands, phases=(Phase('contact', 0.0, 20.0),)))


def test_what_moves_into_a_phase_at_rest_is_cut_off():
    recording = run()
    measures = [p for p in recording.phases if p.name == 'measure']
    for phase in measures:
        assert rest_within(recording.pose, phase.start, phase.end) == (phase.start, phase.end)
    # the move to the third pose lasts from 5.636 to 7.856 s
    start, end = rest_within(recording.pose, 7.4, 9.4)
    assert 7.856 + 0.3 < start < 7.856 + 0.7
    assert end == 9.4
    start, end = rest_within(recording.pose, 4.9, 6.1)
    assert start == 4.9
    assert 5.636 - 0.1 < end < 5.636 + 0.5
    moving = (6.0, 7.5)
    assert rest_within(recording.pose, *moving) == moving


@pytest.mark.long
def test_a_tool_is_found_where_robot_and_commands_were_late_for_their_phases():
    found = identify(announced_early(run(seed=3), 1.2))
    assert abs(found.mass.value - 13.0) < 4.0 * found.mass.std
    assert found.mass.std < 2e-3
    assert (np.abs(found.com.value - [0.03, -0.01, 0.14]) < 5e-5).all()
