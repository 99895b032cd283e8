"""Poses out of /tf and /tf_static: the chain of transforms from one frame to another."""

from dataclasses import dataclass, field
from struct import error as StructError

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.bags.collect import Series
from forcecal_ros.recording.bags.storage import Bag
from forcecal_ros.recording.kinematic_chain import Placement, pose_along
from forcecal_ros.recording.transforms import (
    frames_of,
    route,
    TF,
    Transform,
    TransformReader,
    way_up,
)
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

PREFIX = 'tf:'
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
    bag : Bag
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
                bag.notes.add(f'/tf holds no frame {wrench_frame!r}, that of the wrench; for the '
                              'pose give --topic pose=tf:BASE:SENSOR, of '
                              f'{", ".join(sorted(frames_of(parents)))}')
            return None
        base, sensor = way_up(parents, wrench_frame)[-1], wrench_frame
        name = 'pose'
    else:
        base, _, sensor = named.partition(PREFIX)[2].partition(':')
        name = named
    way = route(parents, base, sensor, name)
    moving = [links[f] for f in (*way.up, *way.down) if len(links[f].stamps) > 1]
    if not moving:
        if named:
            raise DataError(f'{named}: nothing moves between {base} and {sensor}; name the frame '
                            'of the sensor and that of the base')
        return None
    busiest = max(moving, key=lambda link: len(link.stamps))
    stamps = np.unique(busiest.stamps)
    first = max(min(link.stamps) for link in moving)
    last = min(max(link.stamps) for link in moving)
    stamps = stamps[(stamps >= first) & (stamps <= last)]
    bag.notes.add(f'pose: of {sensor} in {base}, from /tf')
    values = pose_along(way, lambda frame: _at(links[frame], stamps), len(stamps))
    return Series(stamps, values, base), sensor


def _links(bag: Bag) -> dict[str, _Link]:
    read, links = TransformReader(), dict[str, _Link]()
    for batch in bag.batches({topic for topic in bag.topics if topic.type == TF}):
        for start, length in zip(batch.start.tolist(), batch.length.tolist()):
            try:
                found = read(bytes(batch.buffer[start:start + length]))
            except (StructError, IndexError):
                bag.notes.add('/tf: messages that cannot be read were left out')
                continue
            for one in found:
                _take(one, links, bag)
    return links


def _take(one: Transform, links: dict[str, _Link], bag: Bag) -> None:
    if not np.isfinite(one.numbers).all() or not any(one.numbers[3:]):
        bag.notes.add(f'/tf: {one.child} without a number was left out')
        return
    link = links.setdefault(one.child, _Link(one.parent))
    link.parent = one.parent
    link.stamps.append(one.stamp_ns)
    link.numbers.append(one.numbers)


def _at(link: _Link, stamps: Array) -> Placement:
    times, index = np.unique(link.stamps, return_index=True)
    numbers = np.array(link.numbers)[index]
    if len(times) == 1:
        numbers = np.repeat(numbers, len(stamps), axis=0)
        return Rotation.from_quat(numbers[:, 3:]), numbers[:, :3]
    t, at = (times - times[0]) * 1e-9, np.clip((stamps - times[0]) * 1e-9, 0.0, None)
    at = np.minimum(at, t[-1])
    place = np.stack([np.interp(at, t, column) for column in numbers[:, :3].T], axis=1)
    return Slerp(t, Rotation.from_quat(numbers[:, 3:]))(at), place
