"""What identification cannot do without."""

from collections.abc import Iterable

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.identify.poses import StaticPose
from forcecal_ros.recording.checks.clipping import Clipping, columns
from forcecal_ros.recording.required import require
from forcecal_ros.recording.streams import Recording, Stream

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
    require(recording, ['wrench'])
    assert recording.wrench is not None
    return recording.wrench


def refuse_poses_at_a_limit(recording: Recording, stops: Iterable[Clipping],
                            poses: Iterable[StaticPose]) -> None:
    """
    Refuse channels that stand at the end of their range while the robot stands in a pose.

    Parameters
    ----------
    stops : iterable of Clipping
        Where channels stop.
    poses : iterable of StaticPose
        At rest.

    Raises
    ------
    DataError
        Names the channels, their limits and the poses.
    """
    channels = {name: (t, values) for name, t, values in columns(recording)}
    found = [f'{stop.channel} stands at {stop.limit:.6g} in pose {i + 1}'
             for i, pose in enumerate(poses) for stop in stops
             if _stands(*channels[stop.channel], pose, stop.limit)]
    if found:
        raise DataError(f'{"; ".join(found)}: the end of its range; lower the load, or raise the '
                        'range of the sensor')


def _stands(t: Array, values: Array, pose: StaticPose, limit: float) -> bool:
    at = values[(t >= pose.start) & (t < pose.end)] == limit
    return len(at) > 0 and bool(at.mean() >= MOSTLY)
