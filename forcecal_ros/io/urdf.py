"""Joints of a URDF: where each link is in its parent at given positions of the joints."""

from collections.abc import Mapping
import math
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, compose, Vector, ZERO
from forcecal_ros.core.schema import Vector7
from forcecal_ros.io.transforms import pose_along, Route, route
import numpy as np
from scipy.spatial.transform import Rotation

FARTHEST_TURN = 4.0 * np.pi
"""Angle that no joint and no wrist reaches [rad], so that it is in degrees: arms turn by one turn
either way, and unwrapped angles may pass one."""

_TURNS = ('revolute', 'continuous')
_SLIDES = ('prismatic',)


class Joint(NamedTuple):
    """
    What holds a link on its parent.

    Attributes
    ----------
    parent : str
        Link.
    origin : tuple of 7 float
        Pose of the joint in the parent, x y z [m] qx qy qz qw.
    driver : str
        Joint whose position moves it, itself or the one that it mimics; empty: it is fixed.
    gain, offset : float
        Its position is ``gain`` times the driver's, plus ``offset`` [rad or m].
    axis : tuple of 3 float
        Unit vector, in the parent.
    slides : bool
        Along the axis, in place of turning about it.
    limited : bool
        It turns between limits, unlike a wheel.
    """

    parent: str
    origin: Vector7
    driver: str = ''
    gain: float = 1.0
    offset: float = 0.0
    axis: Vector = ZERO
    slides: bool = False
    limited: bool = False

    def at(self, positions: Mapping[str, Any]) -> Vector7:
        """Return where its link is in the parent, by the drivers' positions, one each or many."""
        if not self.driver:
            return self.origin
        v, (e, f, g) = self.gain * positions[self.driver] + self.offset, self.axis
        (x, y, z), q = self.origin[:3], self.origin[3:]
        if self.slides:
            return (x + v * e, y + v * f, z + v * g, *q)
        library: Any = math if isinstance(v, float) else np  # of one number much faster
        sine, cosine = library.sin(0.5 * v), library.cos(0.5 * v)
        return (x, y, z, *compose((sine * e, sine * f, sine * g, cosine), q))


class Description:
    """
    Links and joints of a URDF; what simulators and controllers put beside them is not judged.

    Parameters
    ----------
    text : bytes
        XML.
    name : str
        Where it came from, for messages.

    Raises
    ------
    DataError
        It is no URDF.
    """

    def __init__(self, text: bytes, name: str) -> None:
        self._name = name
        self._joints = {_attribute(joint, 'child', 'link', ''): joint
                        for joint in _root(text, name).findall('joint')}

    @property
    def parents(self) -> dict[str, str]:
        """Each link's parent."""
        return {link: _attribute(joint, 'parent', 'link', '')
                for link, joint in self._joints.items()}

    def joint(self, link: str) -> Joint:
        """
        Return the joint that holds a link.

        Raises
        ------
        DataError
            It cannot be computed.
        """
        element = self._joints[link]
        kind, name = element.get('type', ''), element.get('name', '')
        place = f'{self._name}: joint {name}'
        if kind not in ('fixed', *_TURNS, *_SLIDES):
            raise DataError(f'{place} is {kind or "of no type"}; only fixed, revolute, continuous '
                            'and prismatic joints are supported')
        xyz, rpy = (_numbers(_attribute(element, 'origin', part, '0 0 0'), f'{place}: {part}')
                    for part in ('xyz', 'rpy'))
        turn, parent = Rotation.from_euler('xyz', rpy), self.parents[link]
        origin: Any = (*xyz.tolist(), *turn.as_quat().tolist())
        if kind == 'fixed':
            return Joint(parent, origin)
        axis = _numbers(_attribute(element, 'axis', 'xyz', '1 0 0'), f'{place}: axis')
        if not axis.any():
            raise DataError(f'{place}: its axis is zero, expected a direction')
        (gain,), (offset,) = (
            _numbers(_attribute(element, 'mimic', part, otherwise), f'{place}: {part}', 1)
            for part, otherwise in (('multiplier', '1'), ('offset', '0')))
        along: Any = tuple(turn.apply(axis / np.linalg.norm(axis)).tolist())
        return Joint(parent, origin, _attribute(element, 'mimic', 'joint', name), float(gain),
                     float(offset), along, kind in _SLIDES, kind == 'revolute')


class Chain(NamedTuple):
    """The joints between a link and a base, and the way that leads over them."""

    way: Route
    joints: Mapping[str, Joint]

    @property
    def drivers(self) -> tuple[str, ...]:
        """Joints whose positions are needed, in their order."""
        return tuple(sorted({joint.driver for joint in self.joints.values()} - {''}))

    def pose(self, positions: Mapping[str, Any]) -> Vector7:
        """Return the pose of the link in the base, by the drivers' positions [rad or m]."""
        return pose_along(self.way, lambda link: self.joints[link].at(positions))


def chain(description: Description, base: str, link: str, name: str, source: str) -> Chain:
    """
    Find the joints between a link and a base.

    Parameters
    ----------
    name, source : str
        What requested it, and where the description came from, for messages.

    Raises
    ------
    DataError
        A link is not there, nothing moves between the two, or a joint cannot be computed.
    """
    way = route(description.parents, base, link, name, source)
    found = Chain(way, {one: description.joint(one) for one in (*way.up, *way.down)})
    if not found.drivers:
        raise DataError(f'{name}: no joint between {base} and {link} in {source} moves; pass the '
                        'base frame and the sensor frame')
    return found


def _root(description: bytes, name: str) -> Element:
    try:
        text = description.decode()
        if '<!DOCTYPE' in text or '<!ENTITY' in text:
            raise DataError(f'{name}: it defines XML entities, which are refused for safety; '
                            'remove them')
        robot = ElementTree.fromstring(text)  # noqa: S314  # entities are refused above
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise DataError(f'{name}: not valid XML ({error})') from error
    if robot.tag != 'robot' or robot.find('joint') is None:
        raise DataError(f'{name}: not a URDF with joints (root element {robot.tag}); convert a '
                        'xacro with xacro robot.urdf.xacro > robot.urdf')
    return robot


def _attribute(joint: Element, tag: str, attribute: str, otherwise: str) -> str:
    found = joint.find(tag)
    return otherwise if found is None else found.get(attribute, otherwise)


def _numbers(text: str, place: str, count: int = 3) -> Array:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.array([np.nan])
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise DataError(f'{place} is {text!r}; expected {count} number{"s" * (count > 1)}')
    return numbers
