"""A recording sequence for a rig, and what it is good for."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.diagnose.excitation import Excitation, excitation
from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import rotation_about
from forcecal_ros.motion.diagnosis_plan import diagnosis_plan
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import prepare, Timing
from forcecal_ros.motion.poses import nominal_poses, step_goal
from forcecal_ros.motion.preview import preview
from forcecal_ros.motion.profiles import Pace, Pose
from forcecal_ros.recording.streams import Phase, PoseStream
import numpy as np

PRESS = 0.006
"""How far the tip is sent beyond the wall [m]."""

SETTLE = 0.5
"""How long the tool is expected to settle [s]."""


class Motion(NamedTuple):
    """
    A sequence as it will be commanded.

    Attributes
    ----------
    poses : dict of str to Pose
    timing : Timing
    limits : Limits
        Those of the sequencer, as far out in X as contact needs.
    target : PoseStream
    phases : tuple of Phase
    """

    poses: Mapping[str, Pose]
    timing: Timing
    limits: Limits
    target: PoseStream
    phases: tuple[Phase, ...]


@dataclass(frozen=True)
class Planned:
    """A sequence, and what it shows."""

    motion: Motion
    excitation: Excitation


def plan_for(rig: Rig, *, contact: bool) -> Planned:
    """Plan a recording for a rig, as :func:`motion_for` does, and say what it shows."""
    motion = motion_for(rig, contact=contact)
    return Planned(motion, excitation(rig, motion.target, motion.phases))


def motion_for(rig: Rig, *, contact: bool, brief: bool = False) -> Motion:
    """
    Plan the motion that shows a diagnosis what it needs.

    Parameters
    ----------
    rig : Rig
        From whose home it starts.
    contact : bool
        Whether the wall is to be touched.
    brief : bool
        Without slow reversals and turns, and with one touch instead of two.

    Returns
    -------
    Motion

    Raises
    ------
    DataError
        The wall is not in front of the tool.
    MotionError
        The rig's home leaves no room within the limits.
    """
    poses = poses_of(rig)
    home = next(iter(poses.values()))
    timing, limits = Timing(), Limits(tip=np.array(rig.tool.tip))
    if contact:
        reach = home.position + home.R_base_sensor @ np.array(rig.tool.tip)
        way = rig.wall.position + PRESS - float(reach[0])
        if not 0.0 < way < 0.5 or home.R_base_sensor[0, 0] < 0.9:
            raise DataError(f'the wall at X = {rig.wall.position:g} m is not in front of the tip '
                            f'at X = {reach[0]:.3f} m; plan without contact, or mend home')
        timing = replace(timing, contact_distance=round(way, 4), contacts=2 - brief)
        far = np.maximum(limits.workspace_max, [reach[0] + way + 0.004, 0.0, 0.0])
        limits = replace(limits, workspace_max=far)
    segments = tuple(
        one for one in diagnosis_plan(poses, step_goal(home, timing.contact_distance), timing)
        if not (brief and (one.phase == 'reverse' or one.label.startswith('about'))))
    parts = prepare(segments, home, Pace(), limits)
    target, phases = preview(parts, 1.0 / rig.robot.period, SETTLE)
    return Motion(poses, timing, limits, target, phases)


def poses_of(rig: Rig) -> dict[str, Pose]:
    """
    Place the calibration's poses at the rig's home, and two more that turn gravity sideways.

    Parameters
    ----------
    rig : Rig

    Returns
    -------
    dict of str to Pose
    """
    place, home = np.array(rig.home.position), rig.home.R_base_sensor
    nominal = nominal_poses()
    first = next(iter(nominal.values())).R_base_sensor
    turns = {name: first.T @ pose.R_base_sensor for name, pose in nominal.items()}
    turns |= {'left': rotation_about('x', 0.9), 'right': rotation_about('x', -0.9)}
    return {name: Pose(place, home @ turn) for name, turn in turns.items()}
