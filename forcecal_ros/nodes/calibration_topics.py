"""Calibration and tool on topics: how they are published, and taken over."""

from math import isfinite, nan
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import quantity, size
from forcecal_ros.io.calibration_file import dump
from forcecal_ros.nodes.runtime import LATCHED
from forcecal_ros.observe.design import Accuracy
from forcecal_ros.observe.live import LiveObserver
from forcecal_ros.observe.payload import (
    FROZEN,
    NOT_EXCITED,
    payload_model,
    PayloadSettings,
    ToolEstimate,
    TRACKING,
)
from forcecal_ros.observe.tracker import Tracker
from geometry_msgs.msg import Inertia, InertiaStamped
import numpy as np
from rclpy.lifecycle import LifecycleNode
from rclpy.time import Time
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

TOPIC = '~/tool'
"""Where a tool is told."""

TRACKED = 'tracked'
"""Value of the parameter ``tool``: the tool is what this topic, or the node's own tracker says."""

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Elements of an inertia in the order of the message's fields."""

SURE = 3.0
"""Standard errors by which a tracked mass differs from the one in use before it is called
another."""


class ToolInUse(NamedTuple):
    """Mass [kg], centre of mass [m] and inertia about it [kg m^2]; None: as calibrated."""

    mass: float
    com: Array
    inertia: Array | None = None


def fill_inertia(inertia: Inertia, mass: float, com: Array, J: Array | None) -> None:
    """Write a tool into a message; an inertia that is not known is NaN."""
    inertia.m = float(mass)
    inertia.com.x, inertia.com.y, inertia.com.z = np.asarray(com).tolist()
    for i, j in PAIRS:
        setattr(inertia, f'i{"xyz"[i]}{"xyz"[j]}', nan if J is None else float(J[i, j]))


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
        raise DataError(f'{TOPIC} is given in {named!r}, expected {frame!r}; not taken')
    com = np.array([inertia.com.x, inertia.com.y, inertia.com.z])
    if not (isfinite(inertia.m) and inertia.m > 0 and np.isfinite(com).all()):
        raise DataError(f'{TOPIC}: mass {inertia.m} kg at {com.tolist()} m is no tool, expected '
                        'the finite mass above 0 of all that hangs on the sensor; not taken')
    J = np.empty((3, 3))
    for i, j in PAIRS:
        J[i, j] = J[j, i] = getattr(inertia, f'i{"xyz"[i]}{"xyz"[j]}')
    if np.isnan(J).any() or not J.any():
        return ToolInUse(inertia.m, com)
    if not np.isfinite(J).all() or np.linalg.eigvalsh(J)[0] < 0:
        raise DataError(f'{TOPIC}: the inertia is none, {J.tolist()}; leave it NaN where it is '
                        'not known; not taken')
    return ToolInUse(inertia.m, com, J)


class ToolOnSensor:
    """
    What hangs on the sensor of a running observer: as calibrated, as told, or as tracked.

    An observer that tracks the tool publishes the topic and does not listen to it: what it finds
    never depends on what it takes off.
    """

    def __init__(self, node: LifecycleNode, chain: LiveObserver) -> None:
        self._node, self._chain = node, chain
        self._out: Any = None
        self._in: Any = None
        self._message: InertiaStamped | None = None
        self._told: ToolEstimate | None = None
        self._calibration: Calibration | None = None

    def configure(self, track: bool) -> None:
        """Create the publisher of an observer that tracks."""
        if track:
            self._out = self._node.create_lifecycle_publisher(InertiaStamped, TOPIC, LATCHED)

    def want(self, tracked: bool) -> None:
        """Take the tool as told or tracked from now on, or as calibrated."""
        self._chain.takes_tracked = tracked and self._out is not None
        if tracked and self._out is None and self._in is None:
            self._in = self._node.create_subscription(
                InertiaStamped, TOPIC, self._on_message, LATCHED)
        elif not tracked and self._in is not None:
            self._node.destroy_subscription(self._in)
            self._in = self._message = None

    def calibrated(self, calibration: Calibration, settings: PayloadSettings) -> None:
        """Begin with the tool of another calibration."""
        self._calibration = calibration
        if self._out is not None:
            self._chain.tracker = Tracker(payload_model(calibration, settings))
        self.apply()

    def restart(self) -> None:
        """Believe in the calibrated tool again, until readings tell another."""
        tracker = self._chain.tracker
        if tracker is not None:
            tracker.restart()
            self._told = None
            self.apply()

    def apply(self) -> None:
        """Take off what is known of the tool by a model that was designed of the calibration."""
        tracker = self._chain.tracker
        if self._chain.takes_tracked and tracker is not None:
            self._chain.take_tool(tracker.announced.mass, tracker.announced.com)
        elif self._message is not None and self._calibration is not None:
            try:
                tool = read_tool(self._message, self._calibration.sensor_frame)
            except DataError as error:
                self._node.get_logger().error(str(error))
                return
            self._chain.take_tool(*tool)
            self._node.get_logger().info(f'tool taken from {TOPIC}: mass {tool.mass:.4f} kg')

    def _on_message(self, message: InertiaStamped) -> None:
        self._message = message
        self.apply()

    def tell(self) -> None:
        """Publish the tracked tool where it is another one than the last."""
        tracker, calibration = self._chain.tracker, self._calibration
        if tracker is None or calibration is None or tracker.announced is self._told:
            return
        self._told = tracker.announced
        message = InertiaStamped()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = calibration.sensor_frame
        fill_inertia(message.inertia, self._told.mass, self._told.com,
                     None if calibration.inertia is None else calibration.inertia.value)
        self._out.publish(message)

    def report(self) -> tuple[dict[str, object], str]:
        """Return what /diagnostics say of the tool, and what to warn of, if anything."""
        model, tracker = self._chain.model, self._chain.tracker
        if model is None:
            return {}, ''
        values: dict[str, object] = {'mass taken off [kg]': model.load.m}
        if self._in is not None and self._message is None:
            return values, f'tool: nothing received on {TOPIC}; the calibrated one is taken off'
        if tracker is None:
            return values, ''
        return (values | tool_values(tracker.estimate),
                tool_warning(tracker.estimate, model.load.m))

    def release(self) -> None:
        """End publisher and subscription."""
        self.want(False)
        if self._out is not None:
            self._node.destroy_lifecycle_publisher(self._out)
        self._out = self._told = self._calibration = self._chain.tracker = None


def tool_values(found: ToolEstimate) -> dict[str, object]:
    """Return what /diagnostics say of a tracked tool."""
    values: dict[str, object] = {
        'tool tracking': found.state, 'tool mass [kg]': found.mass,
        'tool mass std [kg]': found.mass_std}
    if found.suspected == found.suspected:
        values['tool change suspected [kg]'] = found.suspected
        values['tool change suspected std [kg]'] = found.suspected_std
    return values


def tool_warning(found: ToolEstimate, in_use: float) -> str:
    """Return what a user should know of a tracked tool, where another mass may be in use [kg]."""
    if found.state == NOT_EXCITED and found.suspected == found.suspected:
        by = quantity(found.suspected, found.suspected_std, 'kg')
        return f'tool: may have changed by {by}, or something pushes; turn it to tell'
    if found.state == FROZEN and found.suspected == found.suspected:
        return 'tool: a steady force that is no weight; it is not taken for a tool'
    if found.state == TRACKING and abs(found.mass - in_use) > max(
            SURE * found.mass_std, 0.01 * in_use):
        return (f'tool: {quantity(found.mass, found.mass_std, "kg")} are on the sensor, '
                f'{size(in_use, "kg", 4)} are taken off; set tool: {TRACKED}')
    return ''


def calibration_message(calibration: Calibration) -> String:
    """Return the text of ``calibration.yaml`` as a message."""
    return String(data=dump(calibration))


def gain_message(calibration: Calibration) -> Float64MultiArray:
    """Return the paper's K: rows are the states x and dx/dt, columns the outputs."""
    assert calibration.observer is not None
    K = calibration.observer.K.value
    message = Float64MultiArray(data=K.ravel().tolist())
    message.layout.dim = [
        MultiArrayDimension(label='state x, dx/dt', size=2, stride=6),
        MultiArrayDimension(label='output x, dx/dt, d2x/dt2', size=3, stride=3)]
    return message


def accuracy_message(found: Accuracy | None) -> Float64MultiArray:
    """Return the covariance of the contact wrench's error, NaN where it is not known."""
    covariance = np.full((6, 6), nan) if found is None else found.covariance
    message = Float64MultiArray(data=covariance.ravel().tolist())
    message.layout.dim = [
        MultiArrayDimension(label='force x, y, z [N], torque x, y, z [N m]', size=6, stride=n)
        for n in (36, 6)]
    return message


def inertia_message(calibration: Calibration, stamp: Time) -> InertiaStamped:
    """Return mass, centre of mass and inertia about it, NaN where that is not identified."""
    message = InertiaStamped()
    message.header.stamp = stamp.to_msg()
    message.header.frame_id = calibration.sensor_frame
    fill_inertia(message.inertia, float(calibration.mass), calibration.com.value,
                 None if calibration.inertia is None else calibration.inertia.value)
    return message
