"""Poses of another frame, a flange's or a TCP's, read and commanded as those of ft_sensor."""

from collections.abc import Callable
from typing import Any

from forcecal_ros.nodes.wire import Reader, Sample
from forcecal_ros.observe.frames import Placement
from forcecal_ros.observe.mounting import at_the_sensor, mounting_of
from forcecal_ros.schema import Parameter
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

SENSOR_FROM_POSE = Parameter(
    'sensor.from_pose', [0.0], 'x y z [m] qx qy qz qw of ft_sensor in the frame whose pose '
    'current_pose says and target_frame commands, a flange or a TCP; one number: both are of '
    'ft_sensor')


def mounting_parameter(node: Node) -> Placement | None:
    """
    Return what the parameter says.

    Raises
    ------
    ConfigError
        It is no pose.
    """
    name = SENSOR_FROM_POSE.name
    numbers: Any = node.get_parameter(name).value
    return mounting_of(numbers, f'parameter {name}')


def pose_reader(mounting: Placement | None) -> Callable[[bytes], Sample]:
    """Return a reader of poses that makes them those of ft_sensor."""
    read = Reader(PoseStamped)
    if mounting is None:
        return read

    def of_sensor(raw: bytes) -> Sample:
        stamp_ns, values = read(raw)
        return Sample(stamp_ns, at_the_sensor(mounting, values))

    return of_sensor
