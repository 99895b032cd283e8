"""The pose of one frame in another, as transforms of /tf or positions of joints come."""

from collections import deque
from collections.abc import Callable, Sequence
from math import inf, isfinite, sqrt
from typing import Any, NamedTuple

from forcecal_ros.core.cdr import FormReader, Layout
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.schema import Vector7
from forcecal_ros.core.streams import CLOCK_JUMP_S
from forcecal_ros.io.transforms import FIELDS, FORM, pose_along, Route, route, transforms_of
from forcecal_ros.io.urdf import chain, Description


class StampedPose(NamedTuple):
    """A pose, x y z [m] qx qy qz qw, at a stamp [ns]."""

    stamp_ns: int
    values: Vector7


class Newest:
    """
    Values of several sources, each with its stamps: what all of them are at one instant.

    Parameters
    ----------
    between : callable
        (value, later value, share of the way) -> value between them.
    """

    def __init__(self, between: Callable[[Any, Any, float], Any]) -> None:
        self._between = between
        self.forget()

    def forget(self) -> None:
        """Forget all values."""
        self._kept: dict[str, deque[tuple[int, Any]]] = {}
        self._last = -inf

    def drop(self, source: str) -> None:
        """Forget the values of one source."""
        self._kept.pop(source, None)

    def keep(self, source: str, stamp: int, value: Any) -> None:
        """Keep a value; late ones are left out, and a clock that was set back begins anew."""
        kept = self._kept.get(source)
        if kept and stamp <= kept[-1][0]:
            if kept[-1][0] - stamp < CLOCK_JUMP_S * 1e9:
                return
            self.forget()
        # one second at 1 kHz: a source that is later than that against the others counts as lost
        self._kept.setdefault(source, deque(maxlen=1000)).append((stamp, value))

    def missing(self, sources: Sequence[str]) -> list[str]:
        """Return the sources without any value."""
        return [one for one in sources if one not in self._kept]

    def at_once(self, sources: Sequence[str]) -> tuple[int, dict[str, Any]] | None:
        """Return the newest stamp that all know, and their values; None: none since the last."""
        if not sources or self.missing(sources):
            return None
        stamp = min(self._kept[one][-1][0] for one in sources)
        if stamp <= self._last:
            return None
        values = {one: self._at(self._kept[one], stamp) for one in sources}
        if None in values.values():
            return None
        self._last = stamp
        return stamp, values

    def _at(self, kept: deque[tuple[int, Any]], stamp: int) -> Any:
        """Return a value at a stamp that is no later than its newest; None: it was forgotten."""
        after_ns, after = kept[-1]
        if after_ns == stamp:
            return after
        for before_ns, before in reversed(kept):
            if before_ns <= stamp:
                return self._between(before, after, (stamp - before_ns) / (after_ns - before_ns))
            after_ns, after = before_ns, before
        return None


class TransformPose:
    """
    Poses of a frame in a base, each at the newest instant that all transforms between them know.

    As often as the slowest moving transform between the two comes; transforms that come more often
    are interpolated to its stamp.

    Attributes
    ----------
    why_not : str
        Why there is no pose yet, where frames are unknown or not connected.
    """

    def __init__(self, base: str, frame: str) -> None:
        self._base, self._frame = base, frame
        self._read = FormReader(FORM)
        self._parents: dict[str, str] = {}
        self._fixed: dict[str, Vector7] = {}
        self._moving = Newest(_between)
        self._route = Route((), ())
        self._layout: Layout | None = None
        self._children: tuple[str, ...] = ()
        self.why_not = 'no message'

    def take_static(self, raw: bytes) -> None:
        """
        Take a serialised message of /tf_static.

        Raises
        ------
        struct.error
            It is shorter than it states.
        """
        for one in transforms_of(*self._read(raw)):
            if (place := _placement(one.numbers)) is not None:
                self._fixed[one.child] = place
                self._moving.drop(one.child)
                self._attach(one.parent, one.child)

    def take(self, raw: bytes) -> StampedPose | None:
        """
        Take a serialised message of /tf; return the pose that it completes, if it does.

        Raises
        ------
        struct.error
            It is shorter than it states.
        """
        layout, values = self._read(raw)
        if layout is not self._layout:
            found = list(transforms_of(layout, values))
            self._layout, self._children = layout, tuple(one.child for one in found)
            for one in found:
                if self._parents.get(one.child) != one.parent:
                    self._attach(one.parent, one.child)
        up, down = self._route
        for k, child in zip(range(1, len(values), FIELDS), self._children):
            if ((child in up or child in down)
                    and (place := _placement(values[k + 6:k + FIELDS]))):
                self._fixed.pop(child, None)
                self._moving.keep(child, values[k] * 1_000_000_000 + values[k + 1], place)
        known = self._moving.at_once([one for one in (*up, *down) if one not in self._fixed])
        if known is None:
            return None
        stamp, moving = known
        links = self._fixed | moving
        return StampedPose(stamp, pose_along(self._route, links.__getitem__))

    def _attach(self, parent: str, child: str) -> None:
        self._parents[child] = parent
        try:
            self._route = route(self._parents, self._base, self._frame, 'pose')
            self.why_not = ''
        except DataError as error:
            self._route, self.why_not = Route((), ()), str(error)


def _placement(numbers: tuple[float, ...]) -> Vector7 | None:
    """Return the placement of a transform; None: it is no number, or turns by none."""
    x, y, z, a, b, c, d = numbers
    n = a * a + b * b + c * c + d * d
    if not (n > 0.0 and isfinite(n + x + y + z)):
        return None
    k = 1 / sqrt(n)
    return x, y, z, a * k, b * k, c * k, d * k


def _between(before: Vector7, after: Vector7, share: float) -> Vector7:
    """Interpolate position and, along the chord that it is for so small a turn, orientation."""
    sign = share if sum(m * n for m, n in zip(before[3:], after[3:])) >= 0 else -share
    x, y, z = (m * (1 - share) + n * share for m, n in zip(before[:3], after[:3]))
    i, j, k, r = (m * (1 - share) + n * sign for m, n in zip(before[3:], after[3:]))
    n = 1 / sqrt(i * i + j * j + k * k + r * r)
    return x, y, z, i * n, j * n, k * n, r * n


class JointPose:
    """
    Poses of a link in a base, by the positions of the joints between them.

    A message that holds all joints is a pose at its stamp, independent of earlier messages. Where
    joints come in messages of their own, a pose is given at the newest instant that all of them
    know.

    Parameters
    ----------
    base, link : str
        Links of it.
    name, source : str
        What requested it, and where the description came from, for messages.

    Attributes
    ----------
    drivers : tuple of str
        Joints whose positions are needed, in their order.
    why_not : str
        Why there is no pose, where there is none.

    Raises
    ------
    DataError
        A link is not there, nothing moves between the two, or a joint cannot be computed.
    """

    def __init__(self, description: Description, base: str, link: str, name: str,
                 source: str) -> None:
        self._chain = chain(description, base, link, name, source)
        self.drivers = self._chain.drivers
        self._parts = Newest(lambda a, b, share: a + (b - a) * share)
        self.why_not = 'no message'

    def take(self, stamp_ns: int, positions: Sequence[float | None]) -> StampedPose | None:
        """
        Take the positions of one message, in the order of ``drivers``; None: it lacks that joint.

        Returns
        -------
        StampedPose or None
            The pose that it completes, if it does.
        """
        given = {joint: one for joint, one in zip(self.drivers, positions) if one is not None}
        if not isfinite(sum(given.values())):
            wrong = next(joint for joint, one in given.items() if not isfinite(one))
            self.why_not = f'the position of joint {wrong} is not a finite number'
            return None
        if len(given) < len(self.drivers):
            for joint, one in given.items():
                self._parts.keep(joint, stamp_ns, one)
            missing = self._parts.missing(self.drivers)
            if missing and (given or self.why_not):
                self.why_not = f'no position of joint {", ".join(missing)}'
            known = self._parts.at_once(self.drivers)
            if known is None:
                return None
            stamp_ns, given = known
        self.why_not = ''
        return StampedPose(stamp_ns, self._chain.pose(given))
