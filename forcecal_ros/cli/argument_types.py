"""Numbers and names on the command line: what cannot be right is refused before any work."""

from argparse import ArgumentTypeError
from collections.abc import Callable
from math import isfinite, pi
import re

SMALLEST_GRAVITY, LARGEST_GRAVITY = 1.6, 25.0
"""From the Moon's to Jupiter's [m/s^2]: what lies outside has a sign or another unit."""

FARTHEST = 1.0
"""A sensor on a wrist sits no farther from the force sensor along any axis [m]; 30 or 120 is
meant in millimetres."""

LAST_PORT = 65535
"""Of TCP."""

LARGEST_SEED = 2 ** 63 - 1
"""As an integer parameter of a node can hold."""


def real(text: str) -> float:
    """Read a finite number."""
    return _number(text, 'a number', lambda x: True)


def positive(text: str) -> float:
    """Read a number above 0."""
    return _number(text, 'a number above 0', lambda x: x > 0)


def not_negative(text: str) -> float:
    """Read a number from 0."""
    return _number(text, 'a number, 0 or more', lambda x: x >= 0)


def gravity(text: str) -> float:
    """Read the magnitude of gravity [m/s^2]."""
    return _number(
        text, f'the magnitude of gravity, {SMALLEST_GRAVITY} to {LARGEST_GRAVITY:g} m/s^2',
        lambda x: SMALLEST_GRAVITY <= x <= LARGEST_GRAVITY)


def angle(text: str) -> float:
    """Read an angle of at most one turn [rad]; more is meant in degrees."""
    return _number(text, 'an angle from -2 pi to 2 pi rad', lambda x: abs(x) <= 2.0 * pi)


def nearby(text: str) -> float:
    """Read a coordinate of what is mounted beside the force sensor [m]."""
    return _number(text, f'a coordinate from -{FARTHEST:g} to {FARTHEST:g} m',
                   lambda x: abs(x) <= FARTHEST)


def whole(text: str) -> int:
    """Read a whole number from 0, as a seed is."""
    return _whole(text, 0)


def at_least_one(text: str) -> int:
    """Read a whole number from 1."""
    return _whole(text, 1)


def port(text: str) -> int:
    """Read the number of a port; 0: any."""
    number = _whole(text, 0)
    if number > LAST_PORT:
        raise ArgumentTypeError(f'{text} is not the number of a port, 0 to {LAST_PORT}')
    return number


def _whole(text: str, least: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if not least <= value <= LARGEST_SEED:
        raise ArgumentTypeError(f'{text or "nothing"} is not a whole number, {least} or more')
    return value


def _number(text: str, wanted: str, fits: Callable[[float], bool]) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise ArgumentTypeError(f'{text or "nothing"} is not {wanted}') from error
    if not (isfinite(value) and fits(value)):
        raise ArgumentTypeError(f'{text} is not {wanted}')
    return value


_PART = r'[A-Za-z_][A-Za-z0-9_]*'
_TOPIC = re.compile(rf'/?{_PART}(/{_PART})*')
_NODE = re.compile(rf'/?({_PART}|\*\*?)(/({_PART}|\*\*?))*')
_ADDRESS = re.compile(r'(\w+://)?(\[[\da-fA-F:.]+\]|[^\s:/\[\]]+):\d+')


def topic_name(text: str) -> str:
    """Read the name of a topic, relative or absolute."""
    return _matching(text, _TOPIC, 'the name of a topic, as /ft/wrench')


def namespace(text: str) -> str:
    """Read a namespace; a slash at its end, and nothing at all, are allowed."""
    if text.strip('/'):
        _matching(text.rstrip('/'), _TOPIC, 'a namespace, as /recorded')
    return text


def node(text: str) -> str:
    """Read the name of a node as in a file of parameters, where it may be a pattern."""
    return _matching(text, _NODE, 'the name of a node')


def frame(text: str) -> str:
    """Read the name of a frame."""
    return _matching(text, re.compile(r'\S+'), 'the name of a frame')


def address(text: str) -> str:
    """Read where a scheduler listens."""
    return _matching(text, _ADDRESS, 'an address, as tcp://host:8786')


def _matching(text: str, pattern: re.Pattern[str], wanted: str) -> str:
    if not pattern.fullmatch(text):
        raise ArgumentTypeError(f'{text!r} is not {wanted}')
    return text
