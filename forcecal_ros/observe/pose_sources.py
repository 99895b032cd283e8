"""The pose of one frame in another, as transforms of /tf or positions of joints come."""

from collections import deque
from collections.abc import Callable, Sequence
from math import cos, isfinite, sin, sqrt
from typing import Any, NamedTuple

from forcecal_ros.core.cdr import FormReader, Layout
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import (
    compose,
    Quaternion,
    rotate,
    Vector,
    ZERO,
)
from forcecal_ros.core.schema import Vector7
from forcecal_ros.core.streams import CLOCK_JUMP_S
from forcecal_ros.io.transforms import FIELDS, FORM, Route, route, transforms_of
from forcecal_ros.io.urdf import Description, Joint
from forcecal_ros.observe.frames import combine, invert, Placement

KEPT_VALUES = 1000
"""Transforms that are kept of each frame, to interpolate between: one second at 1 kHz. One that is
later than that against the others counts as lost."""

NEVER_NS = -2**63
"""Before any stamp [ns]."""

HERE = Placement(ZERO, (0.0, 0.0, 0.0, 1.0))


class StampedPose(NamedTuple):
    """A pose, x y z [m] qx qy qz qw, at a stamp [ns]."""

    stamp_ns: int
    values: Vector7


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
        self._fixed: dict[str, Placement] = {}
        self._moving: dict[str, deque[tuple[int, Placement]]] = {}
        self._route: Route | None = None
        self._needed: set[str] = set()
        self._last = NEVER_NS
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
                self._moving.pop(one.child, None)
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
        for k, child in zip(range(1, len(values), FIELDS), self._children):
            if child in self._needed and (place := _placement(values[k + 6:k + FIELDS])):
                self._keep(child, values[k] * 1_000_000_000 + values[k + 1], place)
        return self._newest()

    def _keep(self, child: str, stamp: int, place: Placement) -> None:
        kept = self._moving.get(child)
        if kept is None:
            self._fixed.pop(child, None)
            kept = self._moving[child] = deque(maxlen=KEPT_VALUES)
        elif stamp <= kept[-1][0]:
            if kept[-1][0] - stamp < CLOCK_JUMP_S * 1e9:
                return
            self._forget()
            kept = self._moving[child] = deque(maxlen=KEPT_VALUES)
        kept.append((stamp, place))

    def _attach(self, parent: str, child: str) -> None:
        self._parents[child] = parent
        try:
            self._route = route(self._parents, self._base, self._frame, 'pose')
            self._needed, self.why_not = {*self._route.up, *self._route.down}, ''
        except DataError as error:
            self._route, self._needed, self.why_not = None, set(), str(error)

    def _forget(self) -> None:
        self._moving, self._last = {}, NEVER_NS

    def _newest(self) -> StampedPose | None:
        found = self._route
        if found is None:
            return None
        moving = [self._moving.get(frame) for frame in (*found.up, *found.down)
                  if frame not in self._fixed]
        if not moving or not all(moving):
            return None
        stamp = min(kept[-1][0] for kept in moving if kept)
        if stamp <= self._last:
            return None
        sensor, base = self._along(found.up, stamp), self._along(found.down, stamp)
        if sensor is None or base is None:
            return None
        self._last = stamp
        place = combine(invert(base), sensor)
        return StampedPose(stamp, (*place.position, *place.q))

    def _along(self, chain: tuple[str, ...], stamp: int) -> Placement | None:
        """Return where the first frame of a chain is in the parent of the last."""
        place = HERE
        for frame in chain:
            link = self._fixed.get(frame) or _at(self._moving[frame], stamp, _between)
            if link is None:
                return None
            place = combine(link, place)
        return place


def _placement(numbers: tuple[float, ...]) -> Placement | None:
    """Return the placement of a transform; None: it is no number, or turns by none."""
    x, y, z, a, b, c, d = numbers
    n = a * a + b * b + c * c + d * d
    if not (n > 0.0 and isfinite(n + x + y + z)):
        return None
    k = 1 / sqrt(n)
    return Placement((x, y, z), (a * k, b * k, c * k, d * k))


def _at(kept: deque[tuple[int, Any]], stamp: int, between: Callable[[Any, Any, float], Any]
        ) -> Any:
    """Return a value at a stamp that is no later than its newest; None: it was forgotten."""
    after_ns, after = kept[-1]
    if after_ns == stamp:
        return after
    for before_ns, before in reversed(kept):
        if before_ns <= stamp:
            return between(before, after, (stamp - before_ns) / (after_ns - before_ns))
        after_ns, after = before_ns, before
    return None


def _between(a: Placement, b: Placement, share: float) -> Placement:
    """Interpolate position and, along the chord that it is for so small a turn, orientation."""
    sign = share if sum(m * n for m, n in zip(a.q, b.q)) >= 0 else -share
    i, j, k, r = (m * (1 - share) + n * sign for m, n in zip(a.q, b.q))
    n = 1 / sqrt(i * i + j * j + k * k + r * r)
    x, y, z = (m * (1 - share) + n * share for m, n in zip(a.position, b.position))
    position: Vector = (x, y, z)
    return Placement(position, (i * n, j * n, k * n, r * n))


class Step(NamedTuple):
    """
    One moving joint, with all that is fixed before it.

    Attributes
    ----------
    slot : int
        Of its driver among ``JointPose.drivers``.
    gain, offset : float
        Its position is ``gain`` times the driver's, plus ``offset`` [rad or m].
    slides : bool
        Along ``along``, in place of turning.
    origin : Vector
        Where it is in the link of the step before [m].
    q, turned : Quaternion
        Its orientation is ``q cos(v/2) + turned sin(v/2)`` at the position v; ``q`` where it
        slides.
    along : Vector
        What it slides along; zero where it turns.
    """

    slot: int
    gain: float
    offset: float
    slides: bool
    origin: Vector
    q: Quaternion
    turned: Quaternion
    along: Vector


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
        way = route(description.parents, base, link, name, source)
        up = [description.joint(one) for one in reversed(way.up)]
        down = [description.joint(one) for one in way.down]
        self.drivers = tuple(sorted({joint.driver for joint in (*up, *down)} - {''}))
        if not self.drivers:
            raise DataError(f'{name}: no joint moves between {base} and {link} in {source}; name '
                            'the frame of the sensor and that of the base')
        self._steps, self._tail = _compiled(down, up, self.drivers)
        self._kept: list[deque[tuple[int, float]]] = [
            deque(maxlen=KEPT_VALUES) for _ in self.drivers]
        self._last: int | None = None
        self.why_not = 'no message'

    def take(self, stamp_ns: int, positions: Sequence[float | None]) -> StampedPose | None:
        """
        Take the positions of one message, in the order of ``drivers``; None: it lacks that joint.

        Returns
        -------
        StampedPose or None
            The pose that it completes, if it does.
        """
        given = [one for one in positions if one is not None]
        if len(given) == len(positions) and isfinite(sum(given)):
            self.why_not = ''
            return StampedPose(stamp_ns, self.pose(given))
        if not given:
            self._miss()
            return None
        if not isfinite(sum(given)):
            wrong = next(joint for joint, one in zip(self.drivers, positions)
                         if one is not None and not isfinite(one))
            self.why_not = f'the position of joint {wrong} is no finite number'
            return None
        return self._merged(stamp_ns, positions)

    def pose(self, positions: Sequence[float]) -> Vector7:
        """
        Return x y z [m] qx qy qz qw at positions of the drivers [rad or m].

        Rotation and product are written out: their calls would be a third of what this costs.
        """
        x = y = z = qx = qy = qz = 0.0
        qw = 1.0
        for slot, gain, offset, slides, (px, py, pz), (i, j, k, r), turned, along in self._steps:
            v = gain * positions[slot] + offset
            if slides:
                e, f, g = along
                px, py, pz, a, b, c, d = px + v * e, py + v * f, pz + v * g, i, j, k, r
            else:
                sine, cosine = sin(0.5 * v), cos(0.5 * v)
                e, f, g, h = turned
                a, b, c, d = (i * cosine + e * sine, j * cosine + f * sine,
                              k * cosine + g * sine, r * cosine + h * sine)
            u, v, w = 2 * (qy * pz - qz * py), 2 * (qz * px - qx * pz), 2 * (qx * py - qy * px)
            x += px + qw * u + qy * w - qz * v
            y += py + qw * v + qz * u - qx * w
            z += pz + qw * w + qx * v - qy * u
            qx, qy, qz, qw = (qw * a + qx * d + qy * c - qz * b, qw * b + qy * d + qz * a - qx * c,
                              qw * c + qz * d + qx * b - qy * a, qw * d - qx * a - qy * b - qz * c)
        place = combine(Placement((x, y, z), (qx, qy, qz, qw)), self._tail)
        return (*place.position, *place.q)

    def _miss(self) -> None:
        if self.why_not and not any(self._kept):
            self.why_not = f'no position of joint {", ".join(self.drivers)}'

    def _merged(self, stamp: int, positions: Sequence[float | None]) -> StampedPose | None:
        """Keep what a part of the joints is at; return the pose it completes."""
        for kept, one in zip(self._kept, positions):
            if one is None:
                continue
            if kept and stamp <= kept[-1][0]:
                if kept[-1][0] - stamp < CLOCK_JUMP_S * 1e9:
                    continue
                self._forget()
            kept.append((stamp, one))
        missing = [joint for joint, kept in zip(self.drivers, self._kept) if not kept]
        if missing:
            self.why_not = f'no position of joint {", ".join(missing)}'
            return None
        newest = min(kept[-1][0] for kept in self._kept)
        if self._last is not None and newest <= self._last:
            return None
        found = [_at(kept, newest, _mixed) for kept in self._kept]
        known = [one for one in found if one is not None]
        if len(known) < len(found):
            return None
        self._last, self.why_not = newest, ''
        return StampedPose(newest, self.pose(known))

    def _forget(self) -> None:
        for kept in self._kept:
            kept.clear()
        self._last = None


def _compiled(down: Sequence[Joint], up: Sequence[Joint], drivers: Sequence[str]
              ) -> tuple[tuple[Step, ...], Placement]:
    """Return the moving joints from the base to the link, and what is fixed behind the last."""
    steps: list[Step] = []
    place = HERE
    for joint, back in (*((one, True) for one in down), *((one, False) for one in up)):
        origin = _origin(joint)
        if not back:
            place = combine(place, origin)
        if joint.driver:
            sign = -1.0 if back else 1.0
            i, j, k = map(float, joint.axis)
            steps.append(Step(
                drivers.index(joint.driver), sign * float(joint.gain),
                sign * float(joint.offset), joint.slides, place.position, place.q,
                compose(place.q, (i, j, k, 0.0)),
                rotate(place.q, (i, j, k)) if joint.slides else ZERO))
            place = HERE
        if back:
            place = combine(place, invert(origin))
    return tuple(steps), place


def _origin(joint: Joint) -> Placement:
    R, p = joint.origin
    a, b, c, d = map(float, R.as_quat())
    x, y, z = map(float, p)
    return Placement((x, y, z), (a, b, c, d))


def _mixed(a: float, b: float, share: float) -> float:
    return a + (b - a) * share
