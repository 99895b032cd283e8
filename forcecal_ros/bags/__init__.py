"""The only reader and writer of recordings (rosbag2); it needs no ROS installation."""

from forcecal_ros.bags.read import (
    Columns, read_columns, read_recording, read_texts, require,
)

__all__ = ['Columns', 'read_columns', 'read_recording', 'read_texts', 'require']
