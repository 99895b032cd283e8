"""Plans as data: which poses, how long, and the phase word of each segment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from forcecal_ros.core.errors import MotionError
from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
from forcecal_ros.core.schema import Row
from forcecal_ros.motion.limits import check_joint_move, check_move, check_workspace, Limits
from forcecal_ros.motion.profiles import (
    JointMove,
    Move,
    Pace,
    Pose,
    shortest_duration,
    shortest_joint_duration,
)
import numpy as np

Goal = Pose | Array
"""A pose, or a joint vector where joints are commanded."""


class Segment(NamedTuple):
    """
    One move or hold of a plan.

    Attributes
    ----------
    phase : str
        Word under which it is announced and recorded.
    label : str
        What it is for, in words of the user.
    goal : Pose, ndarray or None
        Where the move ends; None: hold.
    duration : float or None
        Of the move or the hold [s]; None: by the pace, or until the tool is still.
    """

    phase: str
    label: str
    goal: Goal | None = None
    duration: float | None = None


class PlannedSegment(NamedTuple):
    """A segment with its move from where the one before ended, or its hold there."""

    segment: Segment
    move: Move | JointMove | None
    goal: Goal

    @property
    def duration(self) -> float | None:
        """Length [s]; None: until the tool is still."""
        return self.move.duration if self.move else self.segment.duration


@dataclass(frozen=True)
class Timing:
    """Durations and distances of a plan; the names are the parameters' keys."""

    measure: Annotated[float, Row(
        'Duration of the measurement in each pose', 's', 0.2, 60.0)] = 0.75
    step_distance: Annotated[float, Row(
        'Length of the step along x of ft_sensor', 'm', -0.05, 0.05)] = 0.01
    step_duration: Annotated[float, Row('Duration of the step', 's', 0.05, 2.0)] = 0.1
    ring: Annotated[float, Row(
        'Duration of the hold after each step, in which the tool rings', 's', 0.2, 10.0)] = 0.7
    contact_distance: Annotated[float, Row(
        'contact: distance along x of ft_sensor to something that the tool touches',
        'm', -0.5, 0.5)] = 0.086
    approach: Annotated[float, Row(
        'contact: duration of that move, and of the one back', 's', 0.5, 60.0)] = 3.0
    contact: Annotated[float, Row(
        'contact: duration of the hold at its end', 's', 0.1, 600.0)] = 2.0
    rest: Annotated[float, Row(
        'diagnose: duration of the rest at the beginning', 's', 0.2, 600.0)] = 3.0
    steps: Annotated[int, Row('diagnose: number of steps; 0: none', low=0, high=10)] = 1
    sweeps: Annotated[int, Row(
        'diagnose: rounds of quicker and quicker moves along each axis', low=0, high=10)] = 1
    shakes: Annotated[int, Row(
        'diagnose: repetitions of each of the quickest moves', low=0, high=100)] = 15
    turns: Annotated[int, Row(
        'diagnose: rounds of quicker and quicker rotations', low=0, high=10)] = 1
    reversals: Annotated[int, Row(
        'diagnose: rounds of slow tilts and of slow moves along x', low=0, high=10)] = 1
    contacts: Annotated[int, Row('diagnose: number of contacts; 0: none', low=0, high=10)] = 0
    amplitude: Annotated[float, Row(
        'diagnose: factor of all distances and angles of these', '1', 0.01, 1.0)] = 1.0


def calibration_plan(goals: Mapping[str, Goal], away: Goal, timing: Timing
                     ) -> tuple[Segment, ...]:
    """
    Plan the procedure in III-A of [Gamez2005], with as many poses as are listed.

    Parameters
    ----------
    goals : mapping
        The first is where the step is made.
    away : Pose or ndarray
        Where the step goes to.
    """
    names = list(goals)
    home = goals[names[0]]
    plan = []
    for name in names:
        plan += [Segment('move', f'to {name}', goals[name]),
                 Segment('settle', name),
                 Segment('measure', name, duration=timing.measure)]
    if len(names) > 1:
        plan += [Segment('move', f'to {names[0]}', home), Segment('settle', names[0])]
    return (*plan, *step_segments(home, away, timing))


def repeat_plan(name: str, goal: Goal, home: Goal, timing: Timing) -> tuple[Segment, ...]:
    """Measure one pose again, and go home."""
    return (Segment('move', f'to {name} again', goal), Segment('settle', name),
            Segment('measure', name, duration=timing.measure),
            Segment('move', 'home', home), Segment('settle', 'home'))


def step_segments(home: Goal, away: Goal, timing: Timing) -> tuple[Segment, ...]:
    """Step out and back, with time for the tool to ring after each."""
    return (Segment('step', 'out', away, timing.step_duration),
            Segment('step', 'ring', duration=timing.ring),
            Segment('step', 'back', home, timing.step_duration),
            Segment('step', 'ring', duration=timing.ring))


def contact_plan(goals: Mapping[str, Goal], away: Goal, timing: Timing) -> tuple[Segment, ...]:
    """
    Touch what stands in front of the tool and come back, to look at the contact force.

    Parameters
    ----------
    goals : mapping
        The first is where it begins and ends.
    away : Pose or ndarray
        As far as it goes, contact or not.
    """
    name, home = next(iter(goals.items()))
    return (Segment('move', f'to {name}', home),
            Segment('settle', name),
            Segment('measure', name, duration=timing.measure),
            Segment('approach', 'out', away, timing.approach),
            Segment('contact', 'hold', duration=timing.contact),
            Segment('retract', 'back', home, timing.approach),
            Segment('settle', name))


def prepare(plan: Sequence[Segment], start: Goal, pace: Pace, limits: Limits
            ) -> tuple[PlannedSegment, ...]:
    """
    Chain a plan from where the robot stands, and check all of it before anything moves.

    Parameters
    ----------
    start : Pose or ndarray
        Measured; of the kind of the plan's goals.
    pace : Pace
        For moves without a duration.

    Raises
    ------
    MotionError
        The start or a move exceeds a limit; with the number, the limit and its key.
    """
    if isinstance(start, Pose):
        check_workspace(start.position[None], limits, 'the robot stands where the sensor')
    planned: list[PlannedSegment] = []
    here = start
    for segment in plan:
        move: Move | JointMove | None = None
        name = f'{segment.phase} {segment.label}'
        if isinstance(segment.goal, Pose) and isinstance(here, Pose):
            move = Move(here, segment.goal, segment.duration
                        or shortest_duration(here, segment.goal, pace))
            check_move(move, limits, name)
        elif isinstance(segment.goal, np.ndarray) and isinstance(here, np.ndarray):
            move = JointMove(here, segment.goal, segment.duration
                             or shortest_joint_duration(here, segment.goal, pace))
            check_joint_move(move, limits, name)
        elif segment.goal is not None:
            raise MotionError(f'{name} mixes poses and joint vectors; give one kind throughout')
        here = move.goal if move else here
        planned.append(PlannedSegment(segment, move, here))
    return tuple(planned)


def check_wrench(plan: Sequence[PlannedSegment], wrench: Array, limits: Limits) -> None:
    """
    Refuse a plan whose inertial forces would exceed the limits of the measured wrench.

    Before a calibration the tool's mass is known by its weight only: the force read at rest,
    divided by g, stands for it, and the distance of the tip for its lever arm.

    Parameters
    ----------
    wrench : ndarray, shape (6,)
        Read at rest [N], [N m].

    Raises
    ------
    MotionError
        With the number, the limit and its key.
    """
    force, torque = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
    for key, value, limit, unit in (('force', force, limits.force, 'N'),
                                    ('torque', torque, limits.torque, 'N m')):
        if not value <= limit:
            raise MotionError(f'the sensor reads {value:.4g} {unit} at rest, limits.{key} is '
                              f'{limit:g} {unit}; see that nothing touches the tool, then '
                              'raise the limit')
    for part in plan:
        if not isinstance(part.move, Move):
            continue
        lever = float(np.linalg.norm(limits.tip))
        inertial = force / STANDARD_GRAVITY * part.move.peak_acceleration_at(lever)
        for key, at_rest, added, limit, unit in (
                ('force', force, inertial, limits.force, 'N'),
                ('torque', torque, lever * inertial, limits.torque, 'N m')):
            if not at_rest + added <= limit:
                raise MotionError(
                    f'{part.segment.phase} {part.segment.label} would add {added:.4g} {unit} of '
                    f'inertia to the {at_rest:.4g} {unit} read at rest, limits.{key} is '
                    f'{limit:g} {unit}; give it more time')


def expected_duration(plan: Sequence[PlannedSegment], settle: float) -> float:
    """Return how long a plan takes if each settling takes ``settle`` [s]."""
    return sum(settle if part.duration is None else part.duration for part in plan)
