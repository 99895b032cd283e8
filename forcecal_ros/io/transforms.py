"""Messages of /tf, the way from one of their frames to another, and the pose along it."""

from collections.abc import Callable, Mapping, Sequence
from struct import error as StructError
from struct import Struct, unpack_from
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.spatial.transform import Rotation

TF = 'tf2_msgs/msg/TFMessage'

DEEPEST = 200
"""Transforms from a frame to the root of its tree: more go round in a circle."""


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


FIELDS = 13
"""Of one transform: sec, nanosec, length and text of either name, and seven numbers."""


class Layout(NamedTuple):
    """Where everything is in messages of one length, as long as their names are the same."""

    unpack: Callable[[bytes], tuple[Any, ...]]
    names: tuple[tuple[Any, ...], ...]
    frames: tuple[tuple[str, str], ...]


class TransformReader:
    """Reads serialised TFMessages; one publisher's are all laid out alike, which is remembered."""

    def __init__(self) -> None:
        self._layouts: dict[tuple[int, int], Layout] = {}

    def __call__(self, raw: bytes) -> list[Transform]:
        """
        Read one message.

        Raises
        ------
        struct.error
            It is shorter than it states.
        """
        return transforms_of(*self.laid_out(raw))

    def laid_out(self, raw: bytes) -> tuple[Layout, tuple[Any, ...]]:
        """
        Return where everything is in one message, the same object for the same names, and values.

        Raises
        ------
        struct.error
            It is shorter than it states.
        """
        key = raw[1], len(raw)
        layout = self._layouts.get(key)
        values = layout.unpack(raw) if layout else ()
        if layout is None or _names(values) != layout.names:
            if len(self._layouts) > 100:
                self._layouts.clear()
            layout = self._layouts[key] = _layout(raw)
            values = layout.unpack(raw)
        return layout, values


def transforms_of(layout: Layout, values: tuple[Any, ...]) -> list[Transform]:
    """Return the transforms of one message."""
    return [Transform(parent, child, values[k] * 1_000_000_000 + values[k + 1],
                      values[k + 6:k + FIELDS])
            for k, (parent, child) in zip(range(0, len(values), FIELDS), layout.frames)]


def _names(values: tuple[Any, ...]) -> tuple[tuple[Any, ...], ...]:
    """Return the texts; where they are the same, lengths differ by zeros behind them only."""
    return values[3::FIELDS], values[5::FIELDS]


def _layout(raw: bytes) -> Layout:
    """Walk through a message; alignment counts from behind the first 4 bytes."""
    order = '<' if raw[1] == 1 else '>'
    (count,) = unpack_from(order + 'I', raw, 4)
    at, parts = 8, [order, '8x']
    for _ in range(count):
        for head in ('iI', ''):
            padding = -at % 4
            at += padding + 4 * len(head)
            (length,) = unpack_from(order + 'I', raw, at)
            if length > len(raw):
                raise StructError('a name is longer than its message')
            parts.append(f'{padding}x{head}I{length}s')
            at += 4 + length
        padding = (4 - at) % 8
        parts.append(f'{padding}x7d')
        at += padding + 56
        if at > len(raw):
            raise StructError('a message is shorter than it states')
    struct = Struct(''.join(parts))
    values = struct.unpack_from(raw)
    names = _names(values)
    frames = zip(map(_text, names[0]), map(_text, names[1]))
    return Layout(struct.unpack_from, names, tuple(frames))


def _text(name: bytes) -> str:
    return name.rstrip(b'\0').decode(errors='replace').lstrip('/')


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
        way.append(parents[way[-1]])
        if len(way) > DEEPEST:
            raise DataError(f'{source}: the parents of {frame} go round in a circle')
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
            raise DataError(f'{name}: there is no frame {one!r} in {source}; frames are '
                            f'{", ".join(sorted(known)) or "none"}')
    up, down = way_up(parents, frame, source), way_up(parents, base, source)
    common = next((one for one in up if one in down), None)
    if common is None:
        raise DataError(f'{name}: {base} and {frame} are in different trees of {source}; name two '
                        'frames that are connected')
    return Route(tuple(up[:up.index(common)]), tuple(down[:down.index(common)]))


Placement = tuple[Rotation, Array]
"""Rotations and places (n, 3) [m] of a frame in its parent."""


def pose_along(way: Route, placement: Callable[[str], Placement], n: int) -> Array:
    """
    Return the pose of a frame in a base.

    Parameters
    ----------
    way : Route
        From the frame and from the base up to where they meet.
    placement : callable
        Frame -> where it is in its parent, of ``n`` samples.

    Returns
    -------
    ndarray, shape (n, 7)
        x y z [m] qx qy qz qw.
    """
    R, p = _along(way.up, placement, n)
    S, q = _along(way.down, placement, n)
    return np.hstack([S.inv().apply(p - q), (S.inv() * R).as_quat()])


def _along(frames: Sequence[str], placement: Callable[[str], Placement], n: int) -> Placement:
    """Return where the first frame of a chain is in the parent of the last."""
    R, p = Rotation.identity(n), np.zeros((n, 3))
    for frame in frames:
        own, place = placement(frame)
        p = own.apply(p) + place
        R = own * R
    return R, p
