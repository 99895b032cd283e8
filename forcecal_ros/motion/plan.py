"""Plans as data: the sequences by name, chained and checked, sampled and summed up."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from forcecal_ros.core.errors import above, MotionError
from forcecal_ros.core.geometry import Array, rotation_from_vector, STANDARD_GRAVITY
from forcecal_ros.core.schema import Row
from forcecal_ros.core.streams import Phase, PoseStream
from forcecal_ros.motion.continuous import fit_multi_sine, MultiSine
from forcecal_ros.motion.limits import check_move, check_workspace, Limits
from forcecal_ros.motion.profiles import (
    JointMove,
    Move,
    Pace,
    PEAK_SPEED,
    Pose,
    shortest_duration,
    step_goal,
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
    move: Move | MultiSine | JointMove | None
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
    ring: Annotated[float, Row('Hold after each step, while the tool rings', 's', 0.2, 10.0)] = 0.7
    contact_distance: Annotated[float, Row(
        'contact: distance of the move into contact, along x of ft_sensor',
        'm', -0.5, 0.5)] = 0.086
    approach: Annotated[float, Row(
        'contact: duration of the move into contact, and of the move back', 's', 0.5, 60.0)] = 3.0
    contact: Annotated[float, Row(
        'contact: duration of the hold in contact', 's', 0.1, 600.0)] = 2.0
    rest: Annotated[float, Row(
        'diagnose: duration of the rest at the beginning', 's', 0.2, 600.0)] = 3.0
    steps: Annotated[int, Row('diagnose: number of steps; 0: none', low=0, high=10)] = 1
    sweeps: Annotated[int, Row(
        'diagnose: rounds of ever faster moves along each axis', low=0, high=10)] = 1
    shakes: Annotated[int, Row(
        'diagnose: repetitions of each of the fastest moves', low=0, high=100)] = 15
    turns: Annotated[int, Row('diagnose: rounds of ever faster rotations', low=0, high=10)] = 1
    reversals: Annotated[int, Row(
        'diagnose: rounds of slow tilts and of slow moves along x', low=0, high=10)] = 1
    contacts: Annotated[int, Row('diagnose: number of contacts; 0: none', low=0, high=10)] = 0
    amplitude: Annotated[float, Row(
        'diagnose: factor of all distances and angles of its moves', '1', 0.01, 1.0)] = 1.0


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
        check_workspace(start.position[None], limits, 'the start: the sensor')
    planned: list[PlannedSegment] = []
    here = start
    for segment in plan:
        move: Move | JointMove | None = None
        name, goal = f'{segment.phase} {segment.label}', segment.goal
        if goal is not None:
            if isinstance(goal, Pose) != isinstance(here, Pose):
                raise MotionError(f'{name} mixes poses and joint vectors; give one kind only')
            kind: Any = Move if isinstance(goal, Pose) else JointMove
            move = kind(here, goal, segment.duration or shortest_duration(here, goal, pace))
            check_move(move, limits, name)
        here = move.goal if move else here
        planned.append(PlannedSegment(segment, move, here))
    return tuple(planned)


def continuous_plan(start: Goal, timing: Timing, pace: Pace, limits: Limits
                    ) -> tuple[PlannedSegment, ...]:
    """
    Plan a calibration from continuous motion about where the robot stands, checked.

    It is measured at rest before and after it, which gives the noise of the sensors.

    Raises
    ------
    MotionError
        The start is outside the workspace, or leaves too little room; or joints are commanded.
    """
    if not isinstance(start, Pose):
        raise MotionError('motion.sequence continuous requires poses, but joint vectors are '
                          'commanded; set motion.backend to target_frame or delta_twist_cmds')
    check_workspace(start.position[None], limits, 'the start: the sensor')
    rest = [PlannedSegment(Segment('settle', 'here'), None, start),
            PlannedSegment(Segment('measure', 'here', duration=timing.measure), None, start)]
    shake = Segment('sweep', 'in all axes', start)
    return (*rest, PlannedSegment(shake, fit_multi_sine(start, pace, limits), start), *rest)


def check_wrench(plan: Sequence[PlannedSegment], wrench: Array, limits: Limits) -> None:
    """
    Refuse a plan whose inertial forces would exceed the limits of the measured wrench.

    Before a calibration the tool's mass is known by its weight only: the force read at rest,
    divided by g, represents it, and the distance of the tip for its lever arm.

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
            raise MotionError(f'the sensor reads {above(value, limit, 4)} {unit} at rest, '
                              f'limits.{key} is {limit:g} {unit}; check that nothing touches '
                              'the tool, then raise the limit')
    for part in plan:
        if part.move is None or isinstance(part.move, JointMove):
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


def diagnosis_plan(goals: Mapping[str, Goal], away: Goal, timing: Timing
                   ) -> tuple[Segment, ...]:
    """
    Excite every effect that a diagnosis knows.

    Parameters
    ----------
    goals : mapping
        The first is where steps, sweeps and reversals are made.
    away : Pose or ndarray
        What is touched, where ``timing.contacts`` is above 0. Of joint vectors, the end of the
        longest sweep.
    """
    names = list(goals)
    home = goals[names[0]]
    plan = [Segment('move', f'to {names[0]}', home), Segment('settle', names[0]),
            Segment('measure', names[0], duration=timing.rest)]
    for name in names[1:]:
        plan += [Segment('move', f'to {name}', goals[name]), Segment('settle', name),
                 Segment('measure', name, duration=timing.measure)]
    plan += [Segment('move', f'to {names[0]}', home), Segment('settle', names[0])]
    step = _forward(home, away, timing.amplitude * timing.step_distance)
    plan += timing.steps * step_segments(home, step, timing)
    plan += _sweeps(home, away, timing)
    plan += timing.reversals * _reversals(home, away, timing.amplitude)
    for _ in range(int(timing.contacts)):
        plan += _touch(home, away, timing)
    plan += [Segment('settle', names[0]),
             Segment('measure', names[0], duration=timing.measure)]
    return tuple(plan)


def _out_and_back(phase: str, label: str, home: Goal, goal: Goal, duration: float
                    ) -> list[Segment]:
    return [Segment(phase, f'{label} out', goal, duration),
            Segment(phase, f'{label} back', home, duration)]


def _sweeps(home: Goal, away: Goal, timing: Timing) -> list[Segment]:
    # distance [m] and duration [s] of each move of a sweep, made out and back: slow first,
    # fast last
    sweep = ((0.020, 0.6), (0.014, 0.4), (0.009, 0.25), (0.006, 0.17), (0.004, 0.13), (0.003, 0.1))
    if not isinstance(home, Pose):
        return timing.sweeps * [
            segment for share, (_, duration) in zip((1.0, 0.7, 0.45, 0.3, 0.2, 0.15), sweep)
            for segment in _out_and_back(
                'sweep', 'joints', home, _between(home, away, timing.amplitude * share),
                3.0 * duration)]
    out = []
    for i, axis in enumerate('xyz'):
        out += timing.sweeps * _moves(axis, home, i, timing.amplitude, sweep)
    for i, axis in (1, 'y'), (2, 'z'):
        # distance [m] and duration [s] of moves at 18 Hz to 25 Hz, which
        # tell a delay from a low-pass
        for one in ((4e-4, 0.028), (3e-4, 0.024), (1.8e-4, 0.020)):
            out += timing.shakes * _moves(f'{axis} quickly', home, i, timing.amplitude, (one,))
    for i, axis in enumerate('xyz'):
        # angle [rad] and duration [s] of each rotation of a sweep, made out and back
        for angle, duration in timing.turns * (
                (0.15, 0.6), (0.10, 0.4), (0.05, 0.25), (0.02, 0.15)):
            goal = _rotated(home, i, timing.amplitude * angle)
            out += _out_and_back('sweep', f'about {axis}', home, goal, duration)
    return out


def _moves(label: str, home: Pose, axis: int, amplitude: float,
           rows: tuple[tuple[float, float], ...]) -> list[Segment]:
    """Go along an axis of ft_sensor, out and back by each distance [m] in each duration [s]."""
    way = amplitude * home.R_base_sensor[:, axis]
    return [segment for distance, duration in rows for segment in _out_and_back(
        'sweep', label, home, Pose(home.position + distance * way, home.R_base_sensor), duration)]


def _reversals(home: Goal, away: Goal, amplitude: float) -> list[Segment]:
    if not isinstance(home, Pose):
        return 2 * _out_and_back('reverse', 'joints', home,
                                 _between(home, away, 0.5 * amplitude), 3.0)
    out: list[Segment] = []
    # largest angle [rad] and duration [s] of the slow rotations about y of ft_sensor, in both
    # senses, which let gravity pull along x
    largest, duration = 0.35, 2.5
    for share in (1.0, -1.0, 0.5, -0.5):
        goal = _rotated(home, 1, share * amplitude * largest)
        out += _out_and_back('reverse', 'about y', home, goal, duration)
    # distance [m] and duration [s] of the slow reversals along x of ft_sensor
    distance, duration = 0.02, 2.0
    return out + 2 * _out_and_back(
        'reverse', 'x', home, _forward(home, away, amplitude * distance), duration)


def _touch(home: Goal, away: Goal, timing: Timing) -> list[Segment]:
    # push: share of the distance to what is touched that is moved in contact, and
    # its duration [s]
    share, duration = 0.03, 0.25
    less = _between(home, away, 1.0 - share)
    push = [Segment('contact', 'less', less, duration), Segment('contact', 'more', away, duration)]
    return [Segment('approach', 'out', away, timing.approach),
            Segment('contact', 'hold', duration=timing.contact), *push, *push,
            Segment('contact', 'hold', duration=0.5 * timing.contact),
            Segment('retract', 'back', home, timing.approach), Segment('settle', 'home')]


def _forward(home: Goal, away: Goal, distance: float) -> Goal:
    """Return the pose ``distance`` [m] along x of ft_sensor; of joint vectors, ``away``."""
    return step_goal(home, distance) if isinstance(home, Pose) else away


def _rotated(home: Pose, axis: int, angle: float) -> Pose:
    return Pose(home.position, home.R_base_sensor @ rotation_from_vector(angle * np.eye(3)[axis]))


def _between(home: Goal, away: Goal, share: float) -> Goal:
    if isinstance(home, Pose):
        assert isinstance(away, Pose)
        return Pose(home.position + share * (away.position - home.position), home.R_base_sensor)
    assert isinstance(away, np.ndarray)
    return np.asarray(home + share * (away - home))


SEQUENCES: Mapping[str, Callable[[Mapping[str, Goal], Goal, Timing], tuple[Segment, ...]]] = {
    'calibrate': calibration_plan, 'contact': contact_plan, 'diagnose': diagnosis_plan}
"""What plans every sequence, by its name in the parameter ``sequence``."""


def preview(plan: Sequence[PlannedSegment], rate: float, settle: float
            ) -> tuple[PoseStream, tuple[Phase, ...]]:
    """
    Sample a plan as the sequencer would command it.

    Parameters
    ----------
    rate : float
        Commands per second [Hz].
    settle : float
        How long each settling takes [s].

    Raises
    ------
    MotionError
        The plan is one of joint vectors.
    """
    positions, rotations, phases, periods = [], [], [], 0
    for part in plan:
        if not isinstance(part.goal, Pose):
            raise MotionError('only plans of poses can be previewed; give poses, not joints')
        n = max(1, round((settle if part.duration is None else part.duration) * rate))
        for k in range(n):
            pose = (part.move.at((k + 1) / rate).pose if isinstance(part.move, (Move, MultiSine))
                    else part.goal)
            positions.append(pose.position)
            rotations.append(pose.R_base_sensor)
        phases.append(Phase(part.segment.phase, periods / rate, (periods + n) / rate))
        periods += n
    t = np.arange(periods) / rate
    return PoseStream(t, np.array(positions), np.array(rotations)), tuple(phases)


def path_of(plan: Sequence[PlannedSegment]) -> tuple[Array, Array]:
    """Return poses of ft_sensor along all moves, (n, 3) [m] and (n, 3, 3); none of joints."""
    # time between two poses of a path that is shown: 5 mm at the default speed [s]
    found = [part.move.poses(max(2, round(part.move.duration / 0.02)))
             for part in plan if isinstance(part.move, (Move, MultiSine))]
    if not found:
        return np.empty((0, 3)), np.empty((0, 3, 3))
    positions, rotations = zip(*found)
    return np.concatenate(positions), np.concatenate(rotations)


def outline(plan: Sequence[PlannedSegment], tip: Array) -> str:
    """
    Return in one sentence what a plan would do: moves, durations, lengths, speeds and boxes.

    How long a settling takes is up to the tool: durations are without.

    Parameters
    ----------
    tip : ndarray, shape (3,)
        The tool's foremost point in ft_sensor [m].
    """
    moves = [part.move for part in plan if part.move is not None]
    settlings = sum(part.duration is None for part in plan)
    text = (f'{len(moves)} moves in {expected_duration(plan, settle=0.0):.1f} s and '
            f'{settlings} settlings')
    paths = [move for move in moves if isinstance(move, (Move, MultiSine))]
    if not paths:
        fastest = max((PEAK_SPEED * float(np.abs(move.displacement).max()) / move.duration
                       for move in moves if isinstance(move, JointMove)), default=0.0)
        return f'{text}, at most {fastest:.3g} rad/s of a joint'
    speed, turning = np.max([move.peak_speeds for move in paths], axis=0)
    positions, rotations = path_of(plan)
    return (f'{text}, {sum(move.distance for move in paths):.3g} m and '
            f'{np.degrees(sum(move.angle for move in paths)):.0f} deg long, at most {speed:.3g} '
            f'm/s and {turning:.3g} rad/s; ft_sensor stays within {_box(positions)}, the tip '
            f'within {_box(positions + rotations @ tip)}')


def _box(points: Array) -> str:
    """Return the corners of the box around points (n, 3) [m]."""
    lower, upper = (' '.join(f'{x:.3f}' for x in corner)
                    for corner in (points.min(axis=0), points.max(axis=0)))
    return f'{lower} to {upper} m'
