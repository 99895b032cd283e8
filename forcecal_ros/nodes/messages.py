"""Messages of calibrations, tools, plans and contacts, made of numbers and read back."""

from math import isfinite, nan, sqrt
from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.observe.frames import contact_point
from geometry_msgs.msg import (
    InertiaStamped,
    Point,
    PoseStamped,
    Quaternion,
    TransformStamped,
    Vector3,
)
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Path
import numpy as np
from numpy.typing import ArrayLike
from rclpy.time import Time
from std_msgs.msg import ColorRGBA, Float64MultiArray, Header, MultiArrayDimension
from visualization_msgs.msg import Marker, MarkerArray

TOPIC = '~/tool'
"""Topic of the tool in use."""


PAIRS = tuple(zip(*np.triu_indices(3)))
"""Elements of an inertia in the order of the message's fields."""


class ToolInUse(NamedTuple):
    """Mass [kg], centre of mass [m] and inertia about it [kg m^2]; None: as calibrated."""

    mass: float
    com: Array
    inertia: Array | None = None


def read_tool(message: InertiaStamped, frame: str) -> ToolInUse:
    """
    Read what hangs on the sensor, tool and payload together.

    An inertia with a NaN in it, or zero throughout, is not known.

    Raises
    ------
    DataError
        It is given in another frame than the sensor's, or is no tool.
    """
    inertia, named = message.inertia, message.header.frame_id
    if named not in ('', frame):
        raise DataError(f'{TOPIC} is ignored: its frame_id is {named!r}, expected {frame!r}')
    com = np.array([inertia.com.x, inertia.com.y, inertia.com.z])
    if not (isfinite(inertia.m) and inertia.m > 0 and np.isfinite(com).all()):
        raise DataError(f'{TOPIC} is ignored: mass {inertia.m} kg at {com.tolist()} m; publish '
                        'the finite mass above 0 of everything mounted on the sensor')
    J = np.empty((3, 3))
    for i, j in PAIRS:
        J[i, j] = J[j, i] = getattr(inertia, f'i{"xyz"[i]}{"xyz"[j]}')
    if np.isnan(J).any() or not J.any():
        return ToolInUse(inertia.m, com)
    if not np.isfinite(J).all() or np.linalg.eigvalsh(J)[0] < 0:
        raise DataError(f'{TOPIC} is ignored: the inertia {J.tolist()} kg m^2 is not physical; '
                        'set it to NaN if it is unknown')
    return ToolInUse(inertia.m, com, J)


def matrix_message(matrix: Array, rows: str, columns: str) -> Float64MultiArray:
    """Return a matrix row by row, with what its rows and its columns are."""
    message = Float64MultiArray(data=matrix.ravel().tolist())
    message.layout.dim = [
        MultiArrayDimension(label=rows, size=len(matrix), stride=matrix.size),
        MultiArrayDimension(label=columns, size=matrix.shape[1], stride=matrix.shape[1])]
    return message


def tool_message(calibration: Calibration, stamp: Time, tool: ToolInUse | None = None
                 ) -> InertiaStamped:
    """Return a tool, by default the calibrated one; an inertia that is not known is NaN."""
    tool = tool or ToolInUse(float(calibration.mass), calibration.com.value)
    known = calibration.inertia
    message = InertiaStamped(header=Header(
        stamp=stamp.to_msg(), frame_id=calibration.sensor_frame))
    inertia = message.inertia
    inertia.m = float(tool.mass)
    inertia.com.x, inertia.com.y, inertia.com.z = np.asarray(tool.com).tolist()
    for i, j in PAIRS:
        setattr(inertia, f'i{"xyz"[i]}{"xyz"[j]}',
                nan if known is None else float(known.value[i, j]))
    return message


def transform_of(stamp_ns: int, pose: tuple[float, ...], parent: str, child: str
                 ) -> TransformStamped:
    """Return a pose, x y z qx qy qz qw, as the transform of ``child`` in ``parent``."""
    message = TransformStamped()
    message.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
    message.header.frame_id, message.child_frame_id = parent, child
    x, y, z, qx, qy, qz, qw = pose
    message.transform.translation = Vector3(x=x, y=y, z=z)
    message.transform.rotation = Quaternion(x=qx, y=qy, z=qz, w=qw)
    return message


def path_message(positions: Array, rotations: Array, frame: str, stamp: Time) -> Path:
    """Return positions (n, 3) [m] and rotations (n, 3, 3) of ft_sensor in a frame as a path."""
    header = Header(stamp=stamp.to_msg(), frame_id=frame)
    quaternions = quaternion_from_matrix(rotations) if len(positions) else np.empty((0, 4))
    return Path(header=header, poses=[
        PoseStamped(header=header, pose=PoseMessage(
            position=Point(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=d)))
        for (x, y, z), (a, b, c, d) in zip(positions.tolist(), quaternions.tolist())])


METRES_PER_NEWTON = 0.005
"""Length of an arrow: 20 N are 10 cm, as long as a gripper's finger."""


SIGMAS = 2.0
"""Half axes of an ellipsoid, in standard deviations: 74 % of points lie within."""


LARGEST = 0.5
"""An ellipsoid is drawn no larger than this, lest it hide the robot [m]."""


ORANGE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=1.0)
PALE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.3)
BLUE = ColorRGBA(r=0.1, g=0.4, b=1.0, a=1.0)


def _marker(header: Header, namespace: str, kind: int) -> Marker:
    marker = Marker(header=header, ns=namespace, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    return marker


def _points(rows: Array) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in rows.tolist()]


def contact_markers(wrench: Array, covariance: Array, frame: str, stamp: Time) -> MarkerArray:
    """
    Draw a contact force as an arrow that ends where it acts, and how sure both are.

    Parameters
    ----------
    wrench : ndarray, shape (6,)
        Environment on tool, in ``frame``, about its origin [N, N m].
    covariance : ndarray, shape (6, 6)
        Of its error; NaN where that is not known, and no ellipsoids are drawn then.
    """
    header = Header(stamp=stamp.to_msg(), frame_id=frame)
    known = bool(np.isfinite(covariance).all())
    found = contact_point(wrench, covariance if known else 1e-12 * np.eye(6))
    arrow, *balls = markers = [_marker(header, name, kind) for name, kind in (
        ('contact force', Marker.ARROW), ('point uncertainty', Marker.SPHERE),
        ('force uncertainty', Marker.SPHERE))]
    if found is None:
        for marker in markers:
            marker.action = Marker.DELETE
        return MarkerArray(markers=markers)
    tail = found.position - METRES_PER_NEWTON * wrench[:3]
    arrow.points, arrow.color = _points(np.array([tail, found.position])), ORANGE
    arrow.scale = Vector3(x=0.006, y=0.014, z=0.02)
    if not known:
        markers, balls = [arrow], []
    for ball, centre, spread in zip(balls, (found.position, tail), (
            found.covariance, METRES_PER_NEWTON ** 2 * covariance[:3, :3])):
        _shape(ball, centre, spread)
    for marker in markers:
        # how long a marker is shown that is not renewed [s]
        marker.lifetime.nanosec = round(0.5 * 1e9)
    return MarkerArray(markers=markers)


def _shape(marker: Marker, centre: Array, covariance: Array) -> None:
    """Make a marker the ellipsoid of a covariance."""
    values, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    x, y, z, w = quaternion_from_matrix(axes).tolist()
    marker.pose.position, = _points(centre[np.newaxis])
    marker.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
    marker.scale = Vector3(**{axis: min(2 * SIGMAS * sqrt(max(value, 1e-10)), LARGEST)
                              for axis, value in zip('xyz', values.tolist())})
    marker.color = PALE


def plan_markers(low: ArrayLike, high: ArrayLike, path: Array, frame: str, stamp: Time
                 ) -> MarkerArray:
    """
    Draw the workspace box by its edges, and the path (n, 3) that a start would take [m].

    Without positions nothing of it is drawn.
    """
    header = Header(stamp=stamp.to_msg(), frame_id=frame)
    box = _marker(header, 'workspace', Marker.LINE_LIST)
    line = _marker(header, 'planned path', Marker.LINE_STRIP)
    if not len(path):
        box.action = line.action = Marker.DELETE
        return MarkerArray(markers=[box, line])
    ends = np.array([low, high])
    corners = np.array([[ends[k >> axis & 1, axis] for axis in range(3)] for k in range(8)])
    edges = [k for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4) for k in (a, b)]
    box.points = _points(corners[edges])
    line.points = _points(path)
    box.scale.x, line.scale.x, box.color, line.color = 0.003, 0.005, BLUE, ORANGE
    return MarkerArray(markers=[box, line])
