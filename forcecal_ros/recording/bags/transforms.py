"""Poses out of /tf and /tf_static: the chain of transforms from one frame to another."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.bags.collect import Series
from forcecal_ros.recording.bags.storage import Bag
import numpy as np
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation, Slerp

TF = 'tf2_msgs/msg/TFMessage'

PREFIX = 'tf:'
"""``tf:BASE:SENSOR`` in place of a topic's name."""

DEEPEST = 200
"""Transforms from a frame to the root of its tree: more go round in a circle."""


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
    if not named:
        if wrench_frame not in links:
            if links:
                bag.notes.add(f'/tf holds no frame {wrench_frame!r}, that of the wrench; for the '
                              'pose give --topic pose=tf:BASE:SENSOR, of '
                              f'{", ".join(sorted(_frames(links)))}')
            return None
        base, sensor = _way_up(links, wrench_frame)[-1], wrench_frame
    else:
        _, _, frames = named.partition(PREFIX)
        base, _, sensor = frames.partition(':')
        for frame in (base, sensor):
            if frame not in _frames(links):
                raise DataError(f'{named}: there is no frame {frame!r} in /tf; frames are '
                                f'{", ".join(sorted(_frames(links))) or "none"}')
    up, down = _way_up(links, sensor), _way_up(links, base)
    common = next((frame for frame in up if frame in down), None)
    if common is None:
        raise DataError(f'{named}: {base} and {sensor} are in different trees of /tf; name two '
                        'frames that are connected')
    chain, back = up[:up.index(common)], down[:down.index(common)]
    moving = [links[f] for f in (*chain, *back) if len(links[f].stamps) > 1]
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
    R, p = _along(links, chain, stamps)
    S, q = _along(links, back, stamps)
    bag.notes.add(f'pose: of {sensor} in {base}, from /tf')
    values = np.hstack([S.inv().apply(p - q), (S.inv() * R).as_quat()])
    return Series(stamps, values, base), sensor


def _links(bag: Bag) -> dict[str, _Link]:
    store, links = bag.typestore(), dict[str, _Link]()
    for batch in bag.batches({topic for topic in bag.topics if topic.type == TF}):
        for start, length in zip(batch.start.tolist(), batch.length.tolist()):
            _take(store, batch.buffer[start:start + length], links, bag)
    return links


def _take(store: Typestore, message: bytes, links: dict[str, _Link], bag: Bag) -> None:
    try:
        read: Any = store.deserialize_cdr(message, TF)
    except Exception:  # noqa: BLE001 - of a damaged message anything may come
        bag.notes.add('/tf: messages that cannot be read were left out')
        return
    for one in read.transforms:
        p, q, stamp = one.transform.translation, one.transform.rotation, one.header.stamp
        numbers = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
        if not np.isfinite(numbers).all() or not any(numbers[3:]):
            bag.notes.add(f'/tf: {one.child_frame_id} without a number was left out')
            continue
        parent, child = (name.lstrip('/') for name in (one.header.frame_id, one.child_frame_id))
        link = links.setdefault(child, _Link(parent))
        link.parent = parent
        link.stamps.append(stamp.sec * 10**9 + stamp.nanosec)
        link.numbers.append(numbers)


def _frames(links: Mapping[str, _Link]) -> set[str]:
    return {*links, *(link.parent for link in links.values())}


def _way_up(links: Mapping[str, _Link], frame: str) -> list[str]:
    """Return a frame and all above it, the root of its tree last."""
    way = [frame]
    while way[-1] in links:
        way.append(links[way[-1]].parent)
        if len(way) > DEEPEST:
            raise DataError(f'/tf: the parents of {frame} go round in a circle')
    return way


def _along(links: Mapping[str, _Link], chain: list[str], stamps: Array) -> tuple[Rotation, Array]:
    """Return where the first frame of a chain is in the parent of the last."""
    R, p = Rotation.identity(len(stamps)), np.zeros((len(stamps), 3))
    for frame in chain:
        own, place = _at(links[frame], stamps)
        p = own.apply(p) + place
        R = own * R
    return R, p


def _at(link: _Link, stamps: Array) -> tuple[Rotation, Array]:
    times, index = np.unique(link.stamps, return_index=True)
    numbers = np.array(link.numbers)[index]
    if len(times) == 1:
        numbers = np.repeat(numbers, len(stamps), axis=0)
        return Rotation.from_quat(numbers[:, 3:]), numbers[:, :3]
    t, at = (times - times[0]) * 1e-9, np.clip((stamps - times[0]) * 1e-9, 0.0, None)
    at = np.minimum(at, t[-1])
    place = np.stack([np.interp(at, t, column) for column in numbers[:, :3].T], axis=1)
    return Slerp(t, Rotation.from_quat(numbers[:, 3:]))(at), place
