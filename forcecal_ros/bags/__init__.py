"""The only reader and writer of recordings (rosbag2); it needs no ROS installation."""

from forcecal_ros.bags.columns import Columns, read_columns, read_texts
from forcecal_ros.bags.ordered import Raw, read_messages, read_topics
from forcecal_ros.bags.pieces import Piece, read_pieces
from forcecal_ros.bags.read import read_recording, require
from forcecal_ros.bags.write import BagWriter, write_recording, write_signals

__all__ = [
    'BagWriter', 'Columns', 'Piece', 'Raw', 'read_columns', 'read_messages', 'read_pieces',
    'read_recording', 'read_texts', 'read_topics', 'require', 'write_recording', 'write_signals',
]
