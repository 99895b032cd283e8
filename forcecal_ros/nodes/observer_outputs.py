"""Outputs of the observer: contact wrench in other frames, markers, tool, /tf, diagnostics."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.quantity import quantity, size
from forcecal_ros.nodes import messages
from forcecal_ros.nodes.inputs import transform_type
from forcecal_ros.nodes.runtime import LATCHED, ManagedNode, OUTPUT
from forcecal_ros.nodes.wire import Writer
from forcecal_ros.observe import payload
from forcecal_ros.observe.frames import Frames
from forcecal_ros.observe.live import LiveObserver
from forcecal_ros.observe.sample import describe, level, Wrench
from forcecal_ros.observe.tracker import Tracker
from geometry_msgs.msg import InertiaStamped, WrenchStamped
import numpy as np
from rclpy.time import Time
from visualization_msgs.msg import MarkerArray

TRACKED = 'tracked'
"""Value of the parameter ``tool``: the tool on ``observer/tool``, or by the node's own tracker."""


class FrameOutputs:
    """One publisher a frame."""

    def __init__(self, node: ManagedNode, frames: Frames) -> None:
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
                f'publish.frames: the pose of {base!r} is unknown, as current_pose is in '
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


class SensorTransform:
    """
    Publishes where ft_sensor is.

    Raises
    ------
    ConfigError
        tf2_msgs is missing, or the poses come from /tf, which knows the sensor then.
    """

    def __init__(self, node: ManagedNode, topic: str) -> None:
        if topic == '/tf':
            raise ConfigError('publish.transform is set, but poses already come from /tf '
                              '(pose.base, pose.frame); set it to false')
        self._type: Any = transform_type('publish.transform publishes ft_sensor on /tf')
        self._node, self._last = node, 0
        self._out = node.create_lifecycle_publisher(self._type, '/tf', OUTPUT)

    def publish(self, stamp_ns: int, pose: tuple[float, ...], parent: str, child: str) -> None:
        """Publish a pose, unless one was published just now or its position is not known."""
        # least time between two transforms: RViz draws 30 frames a second [ns]
        if 0 <= stamp_ns - self._last < 20_000_000 or not parent or pose[0] != pose[0]:
            return
        self._last = stamp_ns
        self._out.publish(self._type(transforms=[
            messages.transform_of(stamp_ns, pose, parent, child)]))


class ContactMarkers:
    """``observer/markers``: the contact force now and then, where anybody looks."""

    def __init__(self, node: ManagedNode, rate: float) -> None:
        self._node, self._period, self._next = node, 1e9 / rate, 0
        self._out = node.create_lifecycle_publisher(MarkerArray, '~/markers', OUTPUT)
        self.covariance = np.full((6, 6), np.nan)

    def publish(self, stamp_ns: int, wrench: Wrench, frame: str) -> None:
        """Draw a wrench, unless the last one was drawn just now."""
        if 0 <= self._next - stamp_ns <= self._period or not self._out.get_subscription_count():
            return
        self._next = stamp_ns + round(self._period)
        self._out.publish(messages.contact_markers(
            np.array(wrench), self.covariance, frame, Time(nanoseconds=stamp_ns)))


class ToolOnSensor:
    """
    What hangs on the sensor of a running observer: as calibrated, as received, or as tracked.

    An observer that tracks the tool publishes the topic and does not listen to it: what it finds
    never depends on what it subtracts.
    """

    def __init__(self, node: ManagedNode, chain: LiveObserver) -> None:
        self._node, self._chain = node, chain
        self._out: Any = None
        self._in: Any = None
        self._message: InertiaStamped | None = None
        self._published: payload.ToolEstimate | None = None
        self._calibration: Calibration | None = None

    def configure(self, track: bool) -> None:
        """Create the publisher of an observer that tracks."""
        if track:
            self._out = self._node.create_lifecycle_publisher(
                InertiaStamped, messages.TOPIC, LATCHED)

    def use(self, tracked: bool) -> None:
        """Use the tool as received or tracked from now on, or as calibrated."""
        self._chain.takes_tracked = tracked and self._out is not None
        if tracked and self._out is None and self._in is None:
            self._in = self._node.create_subscription(
                InertiaStamped, messages.TOPIC, self._on_message, LATCHED)
        elif not tracked and self._in is not None:
            self._node.destroy_subscription(self._in)
            self._in = self._message = None

    def calibrated(self, calibration: Calibration, settings: payload.PayloadSettings) -> None:
        """Begin with the tool of another calibration."""
        self._calibration = calibration
        if self._out is not None:
            self._chain.tracker = Tracker(payload.payload_model(calibration, settings))
        self.apply()

    def restart(self) -> None:
        """Believe in the calibrated tool again, until readings tell another."""
        tracker = self._chain.tracker
        if tracker is not None:
            tracker.restart()
            self._published = None
            self.apply()

    def apply(self) -> None:
        """Subtract what is known of the tool by a model that was designed of the calibration."""
        tracker = self._chain.tracker
        if self._chain.takes_tracked and tracker is not None:
            self._chain.take_tool(tracker.announced.mass, tracker.announced.com)
        elif self._message is not None and self._calibration is not None:
            try:
                tool = messages.read_tool(self._message, self._calibration.sensor_frame)
            except DataError as error:
                self._node.get_logger().error(str(error))
                return
            self._chain.take_tool(*tool)
            self._node.get_logger().info(
                f'tool taken from {messages.TOPIC}: mass {tool.mass:.4f} kg')

    def _on_message(self, message: InertiaStamped) -> None:
        self._message = message
        self.apply()

    def tell(self) -> None:
        """Publish the tracked tool where it is another one than the last."""
        tracker, calibration = self._chain.tracker, self._calibration
        if tracker is None or calibration is None or tracker.announced is self._published:
            return
        self._published = tracker.announced
        self._out.publish(messages.tool_message(
            calibration, self._node.get_clock().now(),
            messages.ToolInUse(self._published.mass, self._published.com)))

    def report(self) -> tuple[dict[str, object], str]:
        """Return what /diagnostics say of the tool, and what to warn of, if anything."""
        model, tracker = self._chain.model, self._chain.tracker
        if model is None:
            return {}, ''
        values: dict[str, object] = {'mass subtracted [kg]': model.load.m}
        if self._in is not None and self._message is None:
            return values, (f'tool: nothing received on {messages.TOPIC}; the calibrated tool is '
                            'subtracted')
        if tracker is None:
            return values, ''
        found = tracker.estimate
        values |= {'tool tracking': found.state, 'tool mass [kg]': found.mass,
                   'tool mass std [kg]': found.mass_std}
        if isfinite(found.suspected):
            values['tool change suspected [kg]'] = found.suspected
            values['tool change suspected std [kg]'] = found.suspected_std
        return values, tool_warning(found, model.load.m)

    def release(self) -> None:
        """End the subscription, and let go of the publisher."""
        self.use(False)
        self._out = self._published = self._calibration = self._chain.tracker = None


def tool_warning(found: payload.ToolEstimate, in_use: float) -> str:
    """Return what a user should know of a tracked tool, where another mass may be in use [kg]."""
    suspected = isfinite(found.suspected)
    if suspected and found.state == payload.NOT_EXCITED:
        by = quantity(found.suspected, found.suspected_std, 'kg')
        return f'tool: may have changed by {by}, or is pushed; rotate it to distinguish the two'
    if suspected and found.state == payload.FROZEN:
        return 'tool: a steady force is not a weight; it is not added to the tool'
    # standard errors by which a tracked mass differs from the one in use
    # before it is called another
    if found.state == payload.TRACKING and abs(found.mass - in_use) > max(
            3.0 * found.mass_std, 0.01 * in_use):
        return (f'tool: {quantity(found.mass, found.mass_std, "kg")} are on the sensor, but '
                f'{size(in_use, "kg", 4)} are subtracted; set tool: {TRACKED}')
    return ''


class LastMessage(NamedTuple):
    """When a topic was received last [ns], and in which frame."""

    steady_ns: int
    frame: str


def health(active: bool, calibrated: str | None, received: Mapping[str, LastMessage],
           silent: Sequence[str], status: int, more: Sequence[str] = ()) -> tuple[str, str]:
    """
    Return level and message for /diagnostics.

    Parameters
    ----------
    calibrated : str or None
        Sensor frame of the calibration in use; None without one.
    received, silent : dict, sequence of str
        The last message by topic; the topics that have fallen silent.
    status : int
        All bits of :class:`forcecal_ros.observe.Status` since the last report.
    more : sequence of str
        Further warnings.
    """
    if not active:
        return 'stale', 'not active'
    if calibrated is None:
        return 'warn', 'waiting for a calibration'
    if 'wrench' in silent or 'wrench' not in received:
        return 'error', 'wrench: nothing received'
    warnings = [*(f'{topic}: nothing received' for topic in silent), *more]
    frame = received['wrench'].frame
    if frame and frame != calibrated:
        warnings.append(f'wrench: its frame_id is {frame!r}, but the calibration is for '
                        f'{calibrated!r}; if {frame!r} is another frame or sensor, '
                        'calibrate in it')
    grade = level(status)
    if warnings and grade == 'ok':
        grade = 'warn'
    return grade, '; '.join((*warnings, *describe(status))) or 'estimating'
