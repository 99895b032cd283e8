"""Outputs of the observer about frames: the contact wrench in others, ft_sensor in /tf."""

from typing import Any

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.nodes.pose_source import transform_type
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.wire import Writer
from forcecal_ros.observe.frames import Frames
from forcecal_ros.observe.sample import Wrench
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3, WrenchStamped
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.time import Time


class FrameOutputs:
    """One publisher a frame."""

    def __init__(self, node: LifecycleNode, frames: Frames) -> None:
        self._node, self._frames = node, frames
        self._out = {name: (node.create_lifecycle_publisher(
            WrenchStamped, f'~/contact_wrench/{name}', OUTPUT), Writer(WrenchStamped, name))
            for name in frames.names}

    def on_pose(self, t: float, pose: tuple[float, ...], frame: str) -> None:
        """Note a measured pose and its frame_id."""
        base = self._frames.base
        if base and frame in ('', base):
            self._frames.note(t, pose)
        elif base:
            self._node.get_logger().warning(
                f'publish.frames: nobody says where {base!r} is, for current_pose is in '
                f'{frame!r}; give its pose in publish.frame_poses',
                once=True)

    def publish(self, stamp_ns: int, t: float, wrench: Wrench, timeout: float) -> None:
        """Publish a wrench, of a pose within ``timeout`` [s] where it goes by poses."""
        if not self._out:
            return
        for name, values in self._frames.of(t, wrench, timeout).items():
            publisher, write = self._out[name]
            publisher.publish(write(stamp_ns, values))

    def forget(self) -> None:
        """Forget all poses."""
        self._frames.forget()

    def destroy(self) -> None:
        """End the publishers."""
        for publisher, _ in self._out.values():
            self._node.destroy_lifecycle_publisher(publisher)
        self._out = {}


TRANSFORM_PERIOD = 20_000_000
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
        if 0 <= stamp_ns - self._last < TRANSFORM_PERIOD or not parent or pose[0] != pose[0]:
            return
        self._last = stamp_ns
        self._out.publish(self._type(transforms=[transform_of(stamp_ns, pose, parent, child)]))

    def destroy(self) -> None:
        """End the publisher."""
        self._node.destroy_publisher(self._out)
