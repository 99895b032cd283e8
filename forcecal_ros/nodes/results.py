"""A calibration as the messages that the sequencer publishes."""

from math import nan

from forcecal_ros.calibration.file import dump
from forcecal_ros.calibration.model import Calibration
from forcecal_ros.nodes.tool_topic import fill_inertia
from forcecal_ros.observe.accuracy import Accuracy
from geometry_msgs.msg import InertiaStamped
import numpy as np
from rclpy.time import Time
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String


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
