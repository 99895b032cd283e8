"""ft_sensor in /tf, of the poses that the observer hears, where nobody else says it."""

from typing import Any

from forcecal_ros.errors import ConfigError
from forcecal_ros.nodes.pose_source import transform_type
from forcecal_ros.nodes.runtime import OUTPUT
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.time import Time

PERIOD = 20_000_000
"""Least time between two transforms: RViz draws 30 frames a second [ns]."""


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


class SensorTransform:
    """
    Publishes where ft_sensor is.

    Raises
    ------
    ConfigError
        tf2_msgs is missing, or the poses come from /tf, which knows the sensor then.
    """

    def __init__(self, node: Node, topic: str) -> None:
        if topic == '/tf':
            raise ConfigError('publish.transform: poses are taken from /tf already (pose.base, '
                              'pose.frame); leave it false')
        self._type: Any = transform_type('publish.transform says where ft_sensor is on /tf')
        self._node, self._last = node, 0
        self._out = node.create_publisher(self._type, '/tf', OUTPUT)

    def publish(self, stamp_ns: int, pose: tuple[float, ...], parent: str, child: str) -> None:
        """Say a pose, unless the last one was said just now or its position is not known."""
        if 0 <= stamp_ns - self._last < PERIOD or not parent or pose[0] != pose[0]:
            return
        self._last = stamp_ns
        self._out.publish(self._type(transforms=[transform_of(stamp_ns, pose, parent, child)]))

    def destroy(self) -> None:
        """End the publisher."""
        self._node.destroy_publisher(self._out)
