"""What a plan becomes, without a robot: the stream of commands, its path, and its outline."""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.core.errors import MotionError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Phase, PoseStream
from forcecal_ros.motion.plan import expected_duration, PlannedSegment
from forcecal_ros.motion.profiles import JointMove, Move, PEAK_SPEED, Pose
import numpy as np

SPACING = 0.02
"""Time between two poses of a path that is shown: 5 mm at the default speed [s]."""


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
            raise MotionError('only plans of poses can be previewed; list poses, not joints')
        n = max(1, round((settle if part.duration is None else part.duration) * rate))
        for k in range(n):
            pose = (part.move.at((k + 1) / rate).pose if isinstance(part.move, Move)
                    else part.goal)
            positions.append(pose.position)
            rotations.append(pose.R_base_sensor)
        phases.append(Phase(part.segment.phase, periods / rate, (periods + n) / rate))
        periods += n
    t = np.arange(periods) / rate
    return PoseStream(t, np.array(positions), np.array(rotations)), tuple(phases)


class Box(NamedTuple):
    """Corners in base, each of shape (3,) [m]."""

    lower: Array
    upper: Array


class Outline(NamedTuple):
    """
    What a plan would do.

    Attributes
    ----------
    moves, settlings : int
        How many of each; how long a settling takes is up to the tool.
    duration : float
        Without settlings [s].
    distance, angle : float
        Sum of all moves [m], [rad].
    speed, angular_speed, joint_speed : float
        Largest planned [m/s], [rad/s]; the last of joints, where they are commanded.
    sensor, tip : Box or None
        What ft_sensor's origin and the tip stay in; None where joints are commanded.
    """

    moves: int
    settlings: int
    duration: float
    distance: float
    angle: float
    speed: float
    angular_speed: float
    joint_speed: float
    sensor: Box | None
    tip: Box | None


def outline(plan: Sequence[PlannedSegment], tip: Array) -> Outline:
    """
    Sum up a plan.

    Parameters
    ----------
    tip : ndarray, shape (3,)
        The tool's foremost point in ft_sensor [m].
    """
    moves = [part.move for part in plan if part.move is not None]
    straight = [move for move in moves if isinstance(move, Move)]
    joints = [move for move in moves if isinstance(move, JointMove)]
    positions, rotations = path_of(plan)
    return Outline(
        len(moves), sum(part.duration is None for part in plan),
        expected_duration(plan, settle=0.0),
        sum(move.distance for move in straight), sum(move.angle for move in straight),
        max((PEAK_SPEED * move.distance / move.duration for move in straight), default=0.0),
        max((PEAK_SPEED * move.angle / move.duration for move in straight), default=0.0),
        max((PEAK_SPEED * float(np.abs(move.displacement).max()) / move.duration
             for move in joints), default=0.0),
        _box(positions), _box(positions + rotations @ tip))


def _box(points: Array) -> Box | None:
    return Box(points.min(axis=0), points.max(axis=0)) if len(points) else None


def path_of(plan: Sequence[PlannedSegment]) -> tuple[Array, Array]:
    """Return poses of ft_sensor along all moves, (n, 3) [m] and (n, 3, 3); none of joints."""
    found = [part.move.poses(max(2, round(part.move.duration / SPACING)))
             for part in plan if isinstance(part.move, Move)]
    if not found:
        return np.empty((0, 3)), np.empty((0, 3, 3))
    positions, rotations = zip(*found)
    return np.concatenate(positions), np.concatenate(rotations)


def in_words(found: Outline) -> str:
    """Say in one sentence what a plan would do."""
    text = (f'{found.moves} moves in {found.duration:.1f} s and {found.settlings} settlings'
            f'{"" if found.sensor else f", at most {found.joint_speed:.3g} rad/s of a joint"}')
    if found.sensor is None or found.tip is None:
        return text
    return (f'{text}, {found.distance:.3g} m and {np.degrees(found.angle):.0f} deg long, at most '
            f'{found.speed:.3g} m/s and {found.angular_speed:.3g} rad/s; ft_sensor stays within '
            f'{_corners(found.sensor)}, the tip within {_corners(found.tip)}')


def _corners(box: Box) -> str:
    lower, upper = (' '.join(f'{x:.3f}' for x in corner) for corner in box)
    return f'{lower} to {upper} m'
