"""Poses out of joint states and a URDF, where neither a pose nor /tf was recorded."""

from collections.abc import Mapping
from pathlib import Path

from forcecal_ros.errors import DataError
from forcecal_ros.recording.bags.cdr import Decoder
from forcecal_ros.recording.bags.collect import Collector, Series
from forcecal_ros.recording.bags.storage import Bag
from forcecal_ros.recording.kinematic_chain import pose_along
from forcecal_ros.recording.topics import STRING, Topic
from forcecal_ros.recording.transforms import route
from forcecal_ros.recording.urdf import Description
import numpy as np

PREFIX = 'urdf:'
"""``urdf:FILE:BASE:LINK`` in place of a topic's name; FILE may be a topic of the recording."""


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
    description = Description(_description(bag, source), source)
    way = route(description.parents, base, link, named, source)
    joints = {frame: description.joint(frame) for frame in (*way.up, *way.down)}
    if joint_states is None:
        raise DataError(f'{named}: there are no joint states in the recording; record '
                        '/joint_states, or name the topic with --topic joint_states=NAME')
    drivers = {joint.driver for joint in joints.values()} - {''}
    if not drivers:
        raise DataError(f'{named}: no joint moves between {base} and {link}; name the frame of '
                        'the sensor and that of the base')
    told = _reported_joints(bag, joint_states, drivers, named)
    busiest = max(told.values(), key=lambda one: len(one.stamp_ns)).stamp_ns
    stamps = busiest[(busiest >= max(one.stamp_ns[0] for one in told.values()))
                     & (busiest <= min(one.stamp_ns[-1] for one in told.values()))]
    start = int(busiest[0])
    positions = {joint: np.interp((stamps - start) / 1e9, one.seconds(start), one.values[:, 0])
                 for joint, one in told.items()}
    bag.notes.add(f'pose: of {link} in {base}, from {joint_states.name} and {source}')
    poses = pose_along(way, lambda frame: joints[frame].placement(positions, len(stamps)),
                       len(stamps))
    return Series(stamps, poses, base), link


def _description(bag: Bag, source: str) -> bytes:
    """Return the URDF of a file, or of a topic that holds it."""
    topic = next((topic for topic in bag.topics if topic.type == STRING
                  and topic.name.lstrip('/') == source.lstrip('/')), None)
    if topic is not None:
        told = _series(bag, topic, {'data': Collector(bag, topic, ['data'], text=True)})['data']
        if told is not None:
            return str(told.values[-1, 0]).encode()
    try:
        return Path(source).read_bytes()
    except OSError as error:
        raise DataError(f'{source}: cannot be read ({error.strerror}), and is no topic of the '
                        'recording; name a URDF, or the topic that holds it') from error


def _reported_joints(bag: Bag, topic: Topic, drivers: set[str], named: str) -> dict[str, Series]:
    """Return what joints were said to be at, in whatever messages and order."""
    series = _series(bag, topic, {
        joint: Collector(bag, topic, [f'position[{joint}]']) for joint in sorted(drivers)})
    told = {joint: one for joint, one in series.items() if one is not None}
    if missing := sorted(drivers - set(told)):
        raise DataError(f'{named}: {topic.name} holds no joint {", ".join(missing)}; joints are '
                        f'{", ".join(sorted(_names(bag, topic))) or "none"}')
    if short := sorted(joint for joint, one in told.items() if len(one.stamp_ns) < 2):
        raise DataError(f'{named}: {topic.name} tells {", ".join(short)} less than twice')
    return told


def _series(bag: Bag, topic: Topic, collectors: Mapping[str, Collector]
            ) -> dict[str, Series | None]:
    for batch in bag.batches({topic}):
        for collector in collectors.values():
            collector.add(batch)
    return {name: collector.series(bag.notes) for name, collector in collectors.items()}


def _names(bag: Bag, topic: Topic) -> set[str]:
    decoder = Decoder(bag.typestore(), topic.type)
    return {text for batch in bag.batches({topic}) for group in decoder.groups(batch)
            for path, text in group.layout.text.items() if path.startswith('name[')}
