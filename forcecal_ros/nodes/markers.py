"""What RViz and Foxglove draw: the contact force at its point, the box and the path of a plan."""

from math import sqrt

from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.observe.frames import contact_point
from forcecal_ros.observe.sample import Wrench
from geometry_msgs.msg import Point, Quaternion, Vector3
import numpy as np
from numpy.typing import ArrayLike
from rclpy.lifecycle import LifecycleNode
from rclpy.time import Time
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

METRES_PER_NEWTON = 0.005
"""Length of an arrow: 20 N are 10 cm, as long as a gripper's finger."""

SIGMAS = 2.0
"""Half axes of an ellipsoid, in standard deviations: 74 % of points lie within."""

LARGEST = 0.5
"""An ellipsoid is drawn no larger than this, lest it hide the robot [m]."""

ORANGE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=1.0)
PALE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.3)
BLUE = ColorRGBA(r=0.1, g=0.4, b=1.0, a=1.0)
FRESH = 0.5
"""How long a marker is shown that nobody renews [s]."""


def _marker(header: Header, namespace: str, kind: int, action: int = Marker.ADD) -> Marker:
    marker = Marker(header=header, ns=namespace, id=0, type=kind, action=action)
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
    namespaces = ('contact force', 'point uncertainty', 'force uncertainty')
    kinds = (Marker.ARROW, Marker.SPHERE, Marker.SPHERE)
    if found is None:
        return MarkerArray(markers=[_marker(header, name, kind, Marker.DELETE)
                                    for name, kind in zip(namespaces, kinds)])
    tail = found.position - METRES_PER_NEWTON * wrench[:3]
    arrow = _marker(header, namespaces[0], kinds[0])
    arrow.points, arrow.color = _points(np.array([tail, found.position])), ORANGE
    arrow.scale = Vector3(x=0.006, y=0.014, z=0.02)
    markers = [arrow]
    if known:
        markers += [
            _ellipsoid(header, namespaces[1], found.position, found.covariance),
            _ellipsoid(header, namespaces[2], tail,
                       METRES_PER_NEWTON ** 2 * covariance[:3, :3])]
    for marker in markers:
        marker.lifetime.nanosec = round(FRESH * 1e9)
    return MarkerArray(markers=markers)


def _ellipsoid(header: Header, namespace: str, centre: Array, covariance: Array) -> Marker:
    values, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    marker = _marker(header, namespace, Marker.SPHERE)
    x, y, z, w = quaternion_from_matrix(axes).tolist()
    marker.pose.position, = _points(centre[np.newaxis])
    marker.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
    marker.scale = Vector3(**{axis: min(2 * SIGMAS * sqrt(max(value, 1e-10)), LARGEST)
                              for axis, value in zip('xyz', values.tolist())})
    marker.color = PALE
    return marker


_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]


def plan_markers(low: ArrayLike, high: ArrayLike, path: Array, frame: str, stamp: Time
                 ) -> MarkerArray:
    """
    Draw the workspace box by its edges, and the path (n, 3) that a start would take [m].

    A side at infinity is drawn 1 m beyond the path; without positions nothing of it is drawn.
    """
    header = Header(stamp=stamp.to_msg(), frame_id=frame)
    box = _marker(header, 'workspace', Marker.LINE_LIST)
    line = _marker(header, 'planned path', Marker.LINE_STRIP)
    if not len(path):
        box.action = line.action = Marker.DELETE
        return MarkerArray(markers=[box, line])
    ends = np.array([np.where(np.isfinite(low), low, path.min(axis=0) - 1.0),
                     np.where(np.isfinite(high), high, path.max(axis=0) + 1.0)])
    corners = np.array([[ends[k >> axis & 1, axis] for axis in range(3)] for k in range(8)])
    box.points = _points(corners[[k for edge in _EDGES for k in edge]])
    line.points = _points(path)
    box.scale.x, line.scale.x, box.color, line.color = 0.003, 0.005, BLUE, ORANGE
    return MarkerArray(markers=[box, line])


class ContactMarkers:
    """``observer/markers``: the contact force now and then, where anybody looks."""

    def __init__(self, node: LifecycleNode, rate: float) -> None:
        self._node, self._period, self._next = node, 1e9 / rate, 0
        self._out = node.create_lifecycle_publisher(MarkerArray, '~/markers', OUTPUT)
        self.covariance = np.full((6, 6), np.nan)

    def publish(self, stamp_ns: int, wrench: Wrench, frame: str) -> None:
        """Draw a wrench, unless the last one was drawn just now."""
        if 0 <= self._next - stamp_ns <= self._period or not self._out.get_subscription_count():
            return
        self._next = stamp_ns + round(self._period)
        self._out.publish(contact_markers(
            np.array(wrench), self.covariance, frame, Time(nanoseconds=stamp_ns)))

    def destroy(self) -> None:
        """End the publisher."""
        self._node.destroy_lifecycle_publisher(self._out)
