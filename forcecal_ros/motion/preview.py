"""The stream of commands that a plan becomes, without a robot."""

from collections.abc import Sequence

from forcecal_ros.errors import MotionError
from forcecal_ros.motion.plan import PlannedSegment
from forcecal_ros.motion.profiles import Move, Pose
from forcecal_ros.recording.streams import Phase, PoseStream
import numpy as np


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
