"""What identification cannot do without, and results that nature forbids."""

from collections.abc import Iterable

from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.checks.signals import Clipping, columns, FARTHEST
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.core.topics import require
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
        raise DataError(f'{"; ".join(found)}: the end of its range; raise the range of the '
                        'sensor')


def _stands(t: Array, values: Array, pose: StaticPose, limit: float) -> bool:
    at = values[(t >= pose.start) & (t < pose.end)] == limit
    return len(at) > 0 and bool(at.mean() >= MOSTLY)


_CERTAIN = 5.0
"""An inertia is that of no body by so many standard errors: one identification in a million."""


def refuse_unnatural(c: Calibration) -> None:
    """
    Refuse what no tool can be.

    Raises
    ------
    DataError
        Names the estimate, its value and what makes it so.
    """
    mass, away = float(c.mass), float(np.linalg.norm(c.com.value))
    if not mass > 0.0:
        raise DataError(f'the mass comes out as {mass:.4g} kg, which no tool has; look at the '
                        'sign and the frame of the wrench')
    if not away < FARTHEST:
        raise DataError(
            f'the centre of mass comes out {away:.3g} m away from the sensor, which no tool has; '
            'look at the unit of the torques (N m, not N mm, N cm or lbf in) and at their axes, '
            'or at the unit of the forces (N, not kN)')


def unnatural_inertia(c: Calibration) -> str:
    """Say why an inertia is that of no body, and so not identified; empty: it may be one."""
    if c.inertia is None:
        return ''
    moments = np.linalg.eigvalsh(c.inertia.value)
    margin = _CERTAIN * float(np.linalg.norm(c.inertia.std))
    if moments[0] > -margin and moments[0] + moments[1] > moments[2] - 2.0 * margin and (
            moments[2] - margin < float(c.mass) * FARTHEST**2):
        return ''
    return (f'inertia: its principal moments come out as '
            f'{", ".join(f"{one:.3g}" for one in moments)} kg m^2, which no body of '
            f'{float(c.mass):.3g} kg has, and it is not taken; look for contact in the motion, '
            'stamps of pose and wrench of different clocks, and the axes of the torques')
