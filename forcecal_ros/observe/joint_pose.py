"""The pose of one link of a URDF in another, as positions of its joints come."""

from collections import deque
from collections.abc import Sequence
from math import cos, isfinite, sin
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.schema import Vector7
from forcecal_ros.io.transforms import route
from forcecal_ros.io.urdf import Description, Joint
from forcecal_ros.observe.frames import Placement
from forcecal_ros.observe.tracking import product, Quaternion, rotate, Vector, ZERO
from forcecal_ros.observe.transforms import CLOCK_WENT_BACK, HERE, KEPT, StampedPose


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

    A message that holds all joints is a pose at its stamp, whatever came before. Where joints come
    in messages of their own, a pose is given at the newest instant that all of them know.

    Parameters
    ----------
    base, link : str
        Links of it.
    name, source : str
        What asked for it, and where the description came from, for messages.

    Attributes
    ----------
    drivers : tuple of str
        Joints whose positions are wanted, in their order.
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
        self._kept: list[deque[tuple[int, float]]] = [deque(maxlen=KEPT) for _ in self.drivers]
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
        place, q = _behind((x, y, z), (qx, qy, qz, qw), *self._tail)
        return (*place, *q)

    def _miss(self) -> None:
        if self.why_not and not any(self._kept):
            self.why_not = f'no position of joint {", ".join(self.drivers)}'

    def _merged(self, stamp: int, positions: Sequence[float | None]) -> StampedPose | None:
        """Keep what a part of the joints is at; return the pose it completes."""
        for kept, one in zip(self._kept, positions):
            if one is None:
                continue
            if kept and stamp <= kept[-1][0]:
                if kept[-1][0] - stamp < CLOCK_WENT_BACK:
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
        found = [_at(kept, newest) for kept in self._kept]
        known = [one for one in found if one is not None]
        if len(known) < len(found):
            return None
        self._last, self.why_not = newest, ''
        return StampedPose(newest, self.pose(known))

    def _forget(self) -> None:
        for kept in self._kept:
            kept.clear()
        self._last = None


def _behind(place: Vector, q: Quaternion, origin: Vector, own: Quaternion
            ) -> tuple[Vector, Quaternion]:
    """Return where a frame is whose place in another is known, of where that one is."""
    x, y, z = place
    a, b, c = rotate(q, origin)
    return (x + a, y + b, z + c), product(q, own)


def _compiled(down: Sequence[Joint], up: Sequence[Joint], drivers: Sequence[str]
              ) -> tuple[tuple[Step, ...], Placement]:
    """Return the moving joints from the base to the link, and what is fixed behind the last."""
    steps: list[Step] = []
    place, q = ZERO, HERE.q
    for joint, back in (*((one, True) for one in down), *((one, False) for one in up)):
        origin = _origin(joint)
        if not back:
            place, q = _behind(place, q, *origin)
        if joint.driver:
            sign = -1.0 if back else 1.0
            i, j, k = map(float, joint.axis)
            steps.append(Step(
                drivers.index(joint.driver), sign * float(joint.gain),
                sign * float(joint.offset), joint.slides, place, q, product(q, (i, j, k, 0.0)),
                rotate(q, (i, j, k)) if joint.slides else ZERO))
            place, q = ZERO, HERE.q
        if back:
            x, y, z, w = origin.q
            inverse = (-x, -y, -z, w)
            a, b, c = rotate(inverse, origin.position)
            place, q = _behind(place, q, (-a, -b, -c), inverse)
    return tuple(steps), Placement(place, q)


def _origin(joint: Joint) -> Placement:
    R, p = joint.origin
    a, b, c, d = map(float, R.as_quat())
    x, y, z = map(float, p)
    return Placement((x, y, z), (a, b, c, d))


def _at(kept: deque[tuple[int, float]], stamp: int) -> float | None:
    """Return a position at a stamp that is no later than its newest; None: it was forgotten."""
    after_ns, after = kept[-1]
    if after_ns == stamp:
        return after
    for before_ns, before in reversed(kept):
        if before_ns <= stamp:
            return before + (after - before) * (stamp - before_ns) / (after_ns - before_ns)
        after_ns, after = before_ns, before
    return None
