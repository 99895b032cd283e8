"""Messages of /tf, the way from one of their frames to another, and the pose along it."""

from collections.abc import Callable, Iterator, Mapping
from functools import reduce
from typing import Any, NamedTuple

from forcecal_ros.core.cdr import Layout
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import combine, invert, ITSELF
from forcecal_ros.core.schema import Vector7

TF = 'tf2_msgs/msg/TFMessage'


class Transform(NamedTuple):
    """Where a frame is in its parent: x y z [m] qx qy qz qw, at a stamp [ns]."""

    parent: str
    child: str
    stamp_ns: int
    numbers: tuple[float, ...]


class Route(NamedTuple):
    """Frames whose transforms lead from a frame, and from a base, up to where the two meet."""

    up: tuple[str, ...]
    down: tuple[str, ...]


FORM = (('i', 'I', 's', 's', '7d'),)
"""Of a TFMessage: stamp, names of parent and child, x y z [m] qx qy qz qw of each transform."""

FIELDS = 13
"""Values of one transform, as :class:`FormReader` gives them after their count."""


def transforms_of(layout: Layout, values: tuple[Any, ...]) -> Iterator[Transform]:
    """Yield the transforms of one message of ``FORM``."""
    names = [name.lstrip('/') for name in layout.texts]
    for k, parent, child in zip(range(1, len(values), FIELDS), names[::2], names[1::2]):
        yield Transform(parent, child, values[k] * 1_000_000_000 + values[k + 1],
                        values[k + 6:k + FIELDS])


def frames_of(parents: Mapping[str, str]) -> set[str]:
    """Return all frames of a mapping from frame to parent."""
    return {*parents, *parents.values()}


def way_up(parents: Mapping[str, str], frame: str, source: str = '/tf') -> list[str]:
    """
    Return a frame and all above it, the root of its tree last.

    Raises
    ------
    DataError
        The parents go round in a circle.
    """
    way = [frame]
    while way[-1] in parents:
        if parents[way[-1]] in way:
            raise DataError(f'{source}: the parents of {frame} form a loop')
        way.append(parents[way[-1]])
    return way


def route(parents: Mapping[str, str], base: str, frame: str, name: str, source: str = '/tf'
          ) -> Route:
    """
    Return the way from a frame to a base.

    Parameters
    ----------
    parents : mapping of str to str
        Frame to parent.
    name, source : str
        What requested it, and what holds the frames, for messages.

    Raises
    ------
    DataError
        A frame is not there, or the two are not connected.
    """
    known = frames_of(parents)
    for one in (base, frame):
        if one not in known:
            raise DataError(f'{name}: no frame {one!r} in {source}; frames are '
                            f'{", ".join(sorted(known)) or "none"}')
    up, down = way_up(parents, frame, source), way_up(parents, base, source)
    common = next((one for one in up if one in down), None)
    if common is None:
        raise DataError(f'{name}: {base} and {frame} are in different trees of {source}; pass two '
                        'connected frames')
    return Route(tuple(up[:up.index(common)]), tuple(down[:down.index(common)]))


def pose_along(way: Route, place_of: Callable[[str], Vector7]) -> Vector7:
    """
    Return the pose of a frame in a base.

    Parameters
    ----------
    way : Route
        From the frame and from the base up to where they meet.
    place_of : callable
        Frame -> its pose in its parent, at one instant or at many.
    """
    up, down = (reduce(lambda place, frame: combine(place_of(frame), place), frames, ITSELF)
                for frames in way)
    return combine(invert(down), up)
