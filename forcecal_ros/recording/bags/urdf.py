"""Poses out of joint states and a URDF, where neither a pose nor /tf was recorded."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.bags.batch import Integers
from forcecal_ros.recording.bags.collect import Series
from forcecal_ros.recording.bags.storage import Bag
from forcecal_ros.recording.kinematic_chain import pose_along
from forcecal_ros.recording.topics import STRING, Topic
from forcecal_ros.recording.transforms import route
from forcecal_ros.recording.urdf import joints_of
import numpy as np

PREFIX = 'urdf:'
"""``urdf:FILE:BASE:LINK`` in place of a topic's name; FILE may be a topic of the recording."""


class _Told(NamedTuple):
    """Positions of one joint [rad or m] at increasing stamps [ns]."""

    stamp_ns: Integers
    position: Array


def pose_of_joints(bag: Bag, named: str, joint_states: Topic | None) -> tuple[Series, str]:
    """
    Return the pose of a link in another, out of joint states.

    Parameters
    ----------
    bag : Bag
    named : str
        ``urdf:FILE:BASE:LINK``.
    joint_states : Topic or None

    Returns
    -------
    Series and str
        Position and quaternion x y z w, stamped as the busiest of the joints between the two, and
        the link whose pose that is.

    Raises
    ------
    DataError
        Description, links or joints are not there.
    """
    parts = named.removeprefix(PREFIX).rsplit(':', 2)
    if len(parts) < 3 or not all(parts):
        raise DataError(f'{named}: expected urdf:FILE:BASE:LINK, e.g. '
                        'urdf:robot.urdf:base_link:tool0')
    source, base, link = parts
    joints = joints_of(_description(bag, source), source)
    way = route({child: joint.parent for child, joint in joints.items()}, base, link, named,
                source)
    if joint_states is None:
        raise DataError(f'{named}: there are no joint states in the recording; record '
                        '/joint_states, or name the topic with --topic joint_states=NAME')
    drivers = {joints[frame].driver for frame in (*way.up, *way.down)} - {''}
    if not drivers:
        raise DataError(f'{named}: no joint moves between {base} and {link}; name the frame of '
                        'the sensor and that of the base')
    told = _told(bag, joint_states, drivers, named)
    busiest = max(told.values(), key=lambda one: len(one.stamp_ns)).stamp_ns
    stamps = busiest[(busiest >= max(one.stamp_ns[0] for one in told.values()))
                     & (busiest <= min(one.stamp_ns[-1] for one in told.values()))]
    positions = {joint: np.interp(_since(stamps, busiest), _since(one.stamp_ns, busiest),
                                  one.position) for joint, one in told.items()}
    bag.notes.add(f'pose: of {link} in {base}, from {joint_states.name} and {source}')
    poses = pose_along(way, lambda frame: joints[frame].placement(positions, len(stamps)),
                       len(stamps))
    return Series(stamps, poses, base), link


def _since(stamps: Integers, start: Integers) -> Array:
    return np.asarray((stamps - start[0]) * 1e-9)


def _description(bag: Bag, source: str) -> bytes:
    """Return the URDF of a file, or of a topic that holds it."""
    topics = {topic for topic in bag.topics
              if topic.name.lstrip('/') == source.lstrip('/') and topic.type == STRING}
    told = b''
    for batch in bag.batches(topics):
        for start, length in zip(batch.start.tolist(), batch.length.tolist()):
            message: Any = bag.typestore().deserialize_cdr(
                batch.buffer[start:start + length], STRING)
            told = message.data.encode()
    if told:
        return told
    try:
        return Path(source).read_bytes()
    except OSError as error:
        raise DataError(f'{source}: cannot be read ({error.strerror}), and is no topic of the '
                        'recording; name a URDF, or the topic that holds it') from error


def _told(bag: Bag, topic: Topic, drivers: set[str], named: str) -> Mapping[str, _Told]:
    """Return what joints were said to be at, in whatever messages and order."""
    read: dict[str, list[tuple[int, float]]] = {}
    for batch in bag.batches({topic}):
        for start, length in zip(batch.start.tolist(), batch.length.tolist()):
            message: Any = bag.typestore().deserialize_cdr(
                batch.buffer[start:start + length], topic.type)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            for joint, position in zip(message.name, message.position):
                read.setdefault(joint, []).append((stamp, float(position)))
    if missing := sorted(drivers - set(read)):
        raise DataError(f'{named}: {topic.name} holds no joint {", ".join(missing)}; joints are '
                        f'{", ".join(sorted(read)) or "none"}')
    told = {joint: _increasing(read[joint]) for joint in drivers}
    if short := sorted(joint for joint, one in told.items() if len(one.stamp_ns) < 2):
        raise DataError(f'{named}: {topic.name} tells {", ".join(short)} less than twice')
    return told


def _increasing(rows: list[tuple[int, float]]) -> _Told:
    """Leave out what is no number, and all but the first of a stamp."""
    stamps, first = np.unique(np.array([stamp for stamp, x in rows if np.isfinite(x)], np.int64),
                              return_index=True)
    return _Told(stamps, np.array([x for _, x in rows if np.isfinite(x)])[first])
