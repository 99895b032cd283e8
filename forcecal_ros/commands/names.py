"""Names on the command line: what ROS 2 would refuse is refused before any work."""

from argparse import ArgumentTypeError
import re

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
