"""Topics of the observer that say the contact wrench in other frames."""

from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.wire import Writer
from forcecal_ros.observe.frames import Frames
from forcecal_ros.observe.sample import Wrench
from geometry_msgs.msg import WrenchStamped
from rclpy.lifecycle import LifecycleNode


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
                f'{frame!r}; name that instead, or give its pose in publish.frame_poses',
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
