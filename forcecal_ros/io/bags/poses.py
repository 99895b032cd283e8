"""Poses where none were recorded: out of /tf and /tf_static, or of joint states and a URDF."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain as chain_of
from pathlib import Path
from struct import error as StructError
from typing import Any

from forcecal_ros.core.cdr import FormReader
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import Vector7
from forcecal_ros.core.topics import STRING, Topic
from forcecal_ros.io.bags.messages import joint_names
from forcecal_ros.io.bags.series import Collector, Series, series_of
from forcecal_ros.io.bags.storage import Bag
from forcecal_ros.io.transforms import (
    FORM,
    frames_of,
    pose_along,
    route,
    TF,
    Transform,
    transforms_of,
    way_up,
)
from forcecal_ros.io.urdf import chain, Description, FARTHEST_TURN, Joint
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

FROM_TF = 'tf:'
"""``tf:BASE:SENSOR`` in place of a topic's name."""


@dataclass
class _Link:
    """Where a frame is in its parent, message by message."""

    parent: str
    stamps: list[int] = field(default_factory=list)
    numbers: list[tuple[float, ...]] = field(default_factory=list)


def pose_series(bag: Bag, named: str, wrench_frame: str) -> tuple[Series, str] | None:
    """
    Return the pose of the sensor's frame in the base, out of a recording's transforms.

    Parameters
    ----------
    named : str
        ``tf:BASE:SENSOR``; empty: the frame of the wrench in the root of its tree.
    wrench_frame : str

    Returns
    -------
    Series and str, or None
        Position and quaternion x y z w, stamped as the busiest transform between the two, and the
        frame whose pose that is; None where nothing was named and there are no transforms that
        move.

    Raises
    ------
    DataError
        What was named is no pair of frames of one tree.
    """
    links = _links(bag)
    parents = {frame: link.parent for frame, link in links.items()}
    if not named:
        if wrench_frame not in links:
            if links:
                bag.notes.add(f'/tf has no frame {wrench_frame!r} (the frame of the wrench); for '
                              'the pose, pass --topic pose=tf:BASE:SENSOR with two of '
                              f'{", ".join(sorted(frames_of(parents)))}')
            return None
        base, sensor = way_up(parents, wrench_frame)[-1], wrench_frame
        name = 'pose'
    else:
        base, _, sensor = named.partition(FROM_TF)[2].partition(':')
        name = named
    way = route(parents, base, sensor, name)
    moving = [links[f] for f in (*way.up, *way.down) if len(links[f].stamps) > 1]
    if not moving:
        if named:
            raise DataError(f'{named}: no transform between {base} and {sensor} moves; pass the '
                            'base frame and the sensor frame')
        return None
    busiest = max(moving, key=lambda link: len(link.stamps))
    stamps = np.unique(busiest.stamps)
    first = max(min(link.stamps) for link in moving)
    last = min(max(link.stamps) for link in moving)
    stamps = stamps[(stamps >= first) & (stamps <= last)]
    bag.notes.add(f'pose: of {sensor} in {base}, from /tf')
    pose = pose_along(way, lambda frame: _at(links[frame], stamps))
    return Series(stamps, _rows(pose, stamps), base), sensor


def _links(bag: Bag) -> dict[str, _Link]:
    read, links = FormReader(FORM), dict[str, _Link]()
    for batch in bag.batches({topic for topic in bag.topics if topic.type == TF}):
        for start, length in zip(batch.start.tolist(), batch.length.tolist()):
            try:
                found = transforms_of(*read(bytes(batch.buffer[start:start + length])))
            except (StructError, IndexError):
                bag.notes.add('/tf: unreadable messages were left out')
                continue
            for one in found:
                _take(one, links, bag)
    return links


def _take(one: Transform, links: dict[str, _Link], bag: Bag) -> None:
    if not np.isfinite(one.numbers).all() or not any(one.numbers[3:]):
        bag.notes.add(f'/tf: invalid transforms of {one.child} were left out')
        return
    link = links.setdefault(one.child, _Link(one.parent))
    link.parent = one.parent
    link.stamps.append(one.stamp_ns)
    link.numbers.append(one.numbers)


def _at(link: _Link, stamps: Array) -> Any:
    """Return poses of a frame in its parent; before the first and after the last, these."""
    times, index = np.unique(link.stamps, return_index=True)
    numbers = np.array(link.numbers)[index]
    turns, t = Rotation.from_quat(numbers[:, 3:]), (times - times[0]) * 1e-9
    if len(times) == 1:
        return (*numbers[0, :3], *turns.as_quat()[0])
    at = np.clip((stamps - times[0]) * 1e-9, 0.0, t[-1])
    return (*(np.interp(at, t, column) for column in numbers[:, :3].T),
            *Slerp(t, turns)(at).as_quat().T)


def _rows(pose: Vector7, stamps: Array) -> Array:
    """Return poses as rows (n, 7); what is the same at all stamps is one number."""
    return np.stack([np.broadcast_to(one, stamps.shape) for one in pose], axis=1)


FROM_URDF = 'urdf:'
"""``urdf:FILE:BASE:LINK`` in place of a topic's name; FILE may be a topic of the recording."""


def pose_of_joints(bag: Bag, named: str, joint_states: Topic | None) -> tuple[Series, str]:
    """
    Return the pose of a link in another, out of joint states.

    Parameters
    ----------
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
    parts = named.removeprefix(FROM_URDF).rsplit(':', 2)
    if len(parts) < 3 or not all(parts):
        raise DataError(f'{named}: expected urdf:FILE:BASE:LINK, e.g. '
                        'urdf:robot.urdf:base_link:tool0')
    source, base, link = parts
    between = chain(Description(_description(bag, source), source), base, link, named, source)
    if joint_states is None:
        raise DataError(f'{named}: the recording has no joint states; record /joint_states')
    reported = _reported_joints(bag, joint_states, between.drivers, named)
    busiest = max(reported.values(), key=lambda one: len(one.stamp_ns)).stamp_ns
    stamps = busiest[(busiest >= max(one.stamp_ns[0] for one in reported.values()))
                     & (busiest <= min(one.stamp_ns[-1] for one in reported.values()))]
    start = int(busiest[0])
    positions = {joint: np.interp((stamps - start) / 1e9, one.seconds(start), one.values[:, 0])
                 for joint, one in reported.items()}
    refuse_degrees(between.joints.values(), positions, joint_states.name)
    bag.notes.add(f'pose: of {link} in {base}, from {joint_states.name} and {source}')
    return Series(stamps, _rows(between.pose(positions), stamps), base), link


def _description(bag: Bag, source: str) -> bytes:
    """Return the URDF of a file, or of a topic that holds it."""
    topic = next((topic for topic in bag.topics if topic.type == STRING
                  and topic.name.lstrip('/') == source.lstrip('/')), None)
    if topic is not None:
        urdf = series_of(bag, topic, ['data'], text=True)
        if urdf is not None:
            return str(urdf.values[-1, 0]).encode()
    try:
        return Path(source).read_bytes()
    except OSError as error:
        raise DataError(f'{source}: not a readable file ({error.strerror}) or topic of the '
                        'recording; pass a URDF') from error


def refuse_degrees(joints: Iterable[Joint], positions: Mapping[str, Array], topic: str) -> None:
    """
    Refuse joints that turn between limits and stand where none of them reaches.

    Parameters
    ----------
    positions : mapping of str to ndarray, shape (n,)
        By joint [rad].
    topic : str
        For messages.

    Raises
    ------
    DataError
        Names the joint and its position.
    """
    for joint in joints:
        farthest = float(np.abs(positions[joint.driver]).max()) if joint.driver else 0.0
        if joint.limited and farthest > FARTHEST_TURN:
            raise DataError(
                f'{topic}: joint {joint.driver} is at {farthest:.3g} rad, which a joint with '
                'limits cannot reach: positions are in degrees; publish radians')


def _reported_joints(bag: Bag, topic: Topic, drivers: Collection[str], named: str
                     ) -> dict[str, Series]:
    """Return the reported positions of joints, in any messages and order."""
    collectors = {joint: Collector(bag, topic, [f'position[{joint}]']) for joint in drivers}
    for batch in bag.batches({topic}):
        for collector in collectors.values():
            collector.add(batch)
    reported = {joint: one for joint, collector in collectors.items()
                if (one := collector.series(bag.notes)) is not None}
    if missing := [joint for joint in drivers if joint not in reported]:
        names = joint_names(bag.typestore(), topic.type, bag.batches({topic}))
        raise DataError(f'{named}: {topic.name} has no joint {", ".join(missing)}; its joints are '
                        f'{", ".join(sorted(set(chain_of(*names)))) or "none"}')
    if short := sorted(joint for joint, one in reported.items() if len(one.stamp_ns) < 2):
        raise DataError(f'{named}: {topic.name} has fewer than two messages of '
                        f'{", ".join(short)}; record longer')
    return reported

