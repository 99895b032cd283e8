"""Joints of a URDF: where each link is in its parent at given positions of the joints."""

from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.io.transforms import Placement
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
    driver : str
        Joint whose position moves it, itself or the one that it mimics; empty: it is fixed.
    gain, offset : float
        Its position is ``gain`` times the driver's, plus ``offset`` [rad or m].
    origin : tuple of Rotation and ndarray, shape (3,)
        Frame of the joint in the parent [m].
    axis : ndarray, shape (3,)
        Unit vector, in the frame of the joint; zero where it is fixed.
    slides : bool
        Along the axis, in place of turning about it.
    limited : bool
        It turns between limits, unlike a wheel.
    """

    parent: str
    driver: str
    gain: float
    offset: float
    origin: tuple[Rotation, Array]
    axis: Array
    slides: bool
    limited: bool = False

    def placement(self, positions: Mapping[str, Array], n: int) -> Placement:
        """Return where the link is in its parent at ``n`` positions of the drivers."""
        R, p = self.origin
        if not self.driver:
            return R * Rotation.identity(n), np.tile(p, (n, 1))
        moved = np.outer(self.gain * positions[self.driver] + self.offset, self.axis)
        if self.slides:
            return R * Rotation.identity(n), p + R.apply(moved)
        return R * Rotation.from_rotvec(moved), np.tile(p, (n, 1))


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
            raise DataError(f'{place} is {kind or "of no type"}; fixed, revolute, continuous and '
                            'prismatic joints are known')
        xyz, rpy = (_numbers(_attribute(element, 'origin', part, '0 0 0'), f'{place}: {part}')
                    for part in ('xyz', 'rpy'))
        origin, parent = (Rotation.from_euler('xyz', rpy), xyz), self.parents[link]
        if kind == 'fixed':
            return Joint(parent, '', 1.0, 0.0, origin, np.zeros(3), False)
        axis = _numbers(_attribute(element, 'axis', 'xyz', '1 0 0'), f'{place}: axis')
        if not axis.any():
            raise DataError(f'{place}: its axis is zero; expected a direction')
        (gain,), (offset,) = (
            _numbers(_attribute(element, 'mimic', part, otherwise), f'{place}: {part}', 1)
            for part, otherwise in (('multiplier', '1'), ('offset', '0')))
        return Joint(parent, _attribute(element, 'mimic', 'joint', name), gain, offset, origin,
                     axis / np.linalg.norm(axis), kind in _SLIDES, kind == 'revolute')


def _root(description: bytes, name: str) -> Element:
    try:
        text = description.decode()
        if '<!DOCTYPE' in text or '<!ENTITY' in text:
            raise DataError(f'{name}: it defines entities, by which a short text becomes a huge '
                            'one; a URDF needs none')
        robot = ElementTree.fromstring(text)  # noqa: S314  # entities are refused above
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise DataError(f'{name}: it is no XML ({error})') from error
    if robot.tag != 'robot' or robot.find('joint') is None:
        raise DataError(f'{name}: it is no URDF of joints (a {robot.tag}); of a xacro make one by '
                        'xacro robot.urdf.xacro > robot.urdf')
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
