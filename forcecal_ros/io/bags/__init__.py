"""The only reader and writer of recordings (rosbag2); it needs no ROS installation."""

from forcecal_ros.io.bags.read import (
    BagChunk,
    Raw,
    read_calibrations,
    read_chunks,
    read_messages,
    read_recording,
    read_topics,
)
from forcecal_ros.io.bags.write import BagWriter, write_recording, write_signals

__all__ = [
    'BagChunk', 'BagWriter', 'Raw', 'read_calibrations', 'read_chunks', 'read_messages',
    'read_recording', 'read_topics', 'write_recording', 'write_signals',
]
