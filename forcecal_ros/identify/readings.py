"""What identification cannot do without."""

from collections.abc import Iterable, Iterator

from forcecal_ros.errors import DataError
from forcecal_ros.identify.poses import StaticPose
from forcecal_ros.recording.checks.clipping import clipped, Clipping
from forcecal_ros.recording.streams import CHANNELS, Recording, Stream
import numpy as np

MOSTLY = 0.5
"""From this share of a pose on that is spent at a limit, its mean is the limit, not the load."""


def require_wrench(recording: Recording) -> Stream:
    """
    Return the wrench.

    Raises
    ------
    DataError
        There is none.
    """
    if recording.wrench is None or not len(recording.wrench):
        raise DataError(f'{recording.source or "the recording"} has no wrench; record it, or name '
                        'its topic with --topic wrench=NAME')
    return recording.wrench


def refuse_poses_at_a_limit(recording: Recording, poses: Iterable[StaticPose]) -> None:
    """
    Refuse channels that stand at the end of their range while the robot stands in a pose.

    Parameters
    ----------
    poses : iterable of StaticPose
        At rest.

    Raises
    ------
    DataError
        Names the channels, their limits and the poses.
    """
    limits = clipped(recording)
    if found := '; '.join(sentence for i, pose in enumerate(poses) for limit in limits
                          for sentence in _standing(recording, i, pose, limit)):
        raise DataError(f'{found}: the end of its range; lower the load, or raise the range of '
                        'the sensor')


def _standing(recording: Recording, i: int, pose: StaticPose, limit: Clipping) -> Iterator[str]:
    for name in ('wrench', 'accelerometer', 'optidrive'):
        stream: Stream | None = getattr(recording, name)
        if stream is not None and limit.channel in CHANNELS[name]:
            values = stream.between(pose.start, pose.end).values
            at = values[:, CHANNELS[name].index(limit.channel)] == limit.limit
            if len(at) and np.mean(at) >= MOSTLY:
                yield f'{limit.channel} stands at {limit.limit:.6g} in pose {i + 1}'
