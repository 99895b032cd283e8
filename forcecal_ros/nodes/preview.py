"""What a start would do, shown before: its path as a message, and whether it is still the same."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from forcecal_ros.core.errors import MotionError
from forcecal_ros.core.geometry import quaternion_from_matrix, rotation_vector
from forcecal_ros.motion.monitor import POSITIONING_ERROR
from forcecal_ros.motion.plan import Goal, path_of, PlannedSegment
from forcecal_ros.motion.profiles import Pose
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Path
import numpy as np
from rclpy.time import Time
from std_msgs.msg import Header

AGAIN = 'call sequencer/preview and look at sequencer/planned_path'


class Shown(NamedTuple):
    """What was previewed: parameters and poses as text, and where the robot stood."""

    parameters: dict[str, str]
    poses: str
    start: Goal


class Preview:
    """The newest preview."""

    def __init__(self) -> None:
        self._shown: Shown | None = None

    def note(self, values: Mapping[str, Any], poses: Mapping[str, Pose], start: Goal) -> None:
        """Note what was shown: values of parameters, listed poses, and where it began."""
        self._shown = Shown(_as_text(values), _listed(poses), start)

    def refuse_other(self, values: Mapping[str, Any], poses: Mapping[str, Pose], start: Goal
                     ) -> None:
        """
        Refuse a start that would do anything else.

        Raises
        ------
        MotionError
            Nothing was shown, a parameter has changed since, or the robot has moved.
        """
        shown = self._shown
        if shown is None:
            raise MotionError(f'motion.require_preview is set and nothing was shown yet; {AGAIN}')
        now = _as_text(values)
        changed = [name for name, value in now.items() if value != shown.parameters[name]]
        if not changed and _listed(poses) != shown.poses:
            changed = ['poses.file']
        if changed:
            raise MotionError(f'{", ".join(changed)} changed since the preview; {AGAIN} again')
        if moved := _moved(shown.start, start):
            raise MotionError(f'the robot has moved by {moved} since the preview; {AGAIN} again')


def _as_text(values: Mapping[str, Any]) -> dict[str, str]:
    """Return values so that they can be compared: NaN, which poses may hold, equals nothing."""
    return {name: repr(value) for name, value in values.items()}


def _listed(poses: Mapping[str, Pose]) -> str:
    return repr([(name, pose.position.tolist(), pose.R_base_sensor.tolist())
                 for name, pose in poses.items()])


def _moved(before: Goal, now: Goal) -> str:
    """Say by how much a robot has moved; empty: by no more than it positions itself."""
    if isinstance(before, Pose) and isinstance(now, Pose):
        turn = rotation_vector(before.R_base_sensor.T @ now.R_base_sensor)
        found = ((float(np.linalg.norm(now.position - before.position)), 'm'),
                 (float(np.linalg.norm(turn)), 'rad'))
    else:
        farthest = float(np.abs(np.subtract(now, before)).max())
        found = ((0.0, 'm'), (farthest, 'rad'))
    return ' and '.join(f'{size:.3g} {unit}' for (size, unit), least in zip(
        found, POSITIONING_ERROR) if size > least)


def path_message(plan: Sequence[PlannedSegment], frame: str, stamp: Time) -> Path:
    """Return the path of ft_sensor in a frame; without poses where joints are commanded."""
    header = Header(stamp=stamp.to_msg(), frame_id=frame)
    positions, rotations = path_of(plan)
    quaternions = quaternion_from_matrix(rotations) if len(positions) else np.empty((0, 4))
    return Path(header=header, poses=[
        PoseStamped(header=header, pose=PoseMessage(
            position=Point(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=d)))
        for (x, y, z), (a, b, c, d) in zip(positions.tolist(), quaternions.tolist())])
