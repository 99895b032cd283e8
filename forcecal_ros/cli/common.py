"""Arguments and output that several commands share."""

import argparse
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
import json
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import COMMANDS

CLEAR = '\r\033[K'
"""Takes away a line that a terminal shows of progress."""

UNITS = {'S': ' s', 'HZ': ' Hz', 'KG': ' kg', 'RAD': ' rad', 'NS/M': ' N s/m', 'N/M': ' N/m'}
"""What follows a default, by the name that the help gives a number."""

CLOSE = 0.75
"""Share of letters that a wrong word has in common with what may have been meant."""

WORDS = (': frame_id is ', 'because their stamps jump', 'by another clock')
"""What is noted when a recording is read and may be why it is refused later."""

if TYPE_CHECKING:
    from forcecal_ros.core.streams import Recording


class Formatter(argparse.ArgumentDefaultsHelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Help with defaults shown where they say something, and the example as it was written."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default is None or action.default is False or action.default in ('', []):
            return action.help
        if isinstance(action.default, float):
            unit = UNITS.get(str(action.metavar), '')
            return f'{action.help} (default: {action.default:g}{unit})'
        return super()._get_help_string(action)


def new_parser(subparsers: Any, name: str, *, example: str) -> argparse.ArgumentParser:
    """Add a command with its summary and an example."""
    summary = COMMANDS[name].summary
    parser: argparse.ArgumentParser = subparsers.add_parser(
        name, help=summary, description=summary[0].upper() + summary[1:] + '.',
        epilog=f'example:\n  {example}', formatter_class=Formatter)
    return parser


def add_bag(parser: argparse.ArgumentParser, *, several: str = '') -> None:
    """
    Add the recording to read, how its topics are called, and the sign of its wrench.

    Parameters
    ----------
    several : str
        What becomes of several; without it there is one.
    """
    if several:
        parser.add_argument('bag', metavar='BAG', nargs='+', action=Listed,
                            help='rosbag2 folder or file (mcap, sqlite3); several, or @FILE with '
                                 f'one a line: {several}')
    else:
        parser.add_argument('bag', metavar='BAG', help='rosbag2 folder or file (mcap, sqlite3)')
    add_topics(parser)
    add_sensor_pose(parser)
    parser.add_argument(
        '--wrench-sign', type=int, choices=(1, -1),
        help='-1 for a driver that reports the wrench of the tool on its environment (default: '
             'as a calibration says, or 1)')


class Listed(argparse.Action):
    """Takes @FILE for what it lists, one a line, besides comments."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: Any, option_string: str | None = None) -> None:
        """Put what is named, and what is listed, into the arguments."""
        named = [line for word in values
                 for line in (self._listed(word[1:]) if word.startswith('@') else [word])]
        if not named or '' in named:
            what = 'an empty name' if named else 'nothing'
            raise argparse.ArgumentError(
                self, f'{what} is given; name a {self.metavar}, or @FILE with one a line')
        setattr(namespace, self.dest, named)

    def _listed(self, file: str) -> list[str]:
        try:
            lines = Path(file).read_text().splitlines()
            return [line for line in lines if line and not line.startswith('#')]
        except OSError as error:
            why = error.strerror
        except UnicodeDecodeError:
            why = 'it is no text'
        raise argparse.ArgumentError(
            self, f'@{file}: cannot be read ({why}); name a file with one {self.metavar} a line')


def add_topics(parser: argparse.ArgumentParser, option: str = '--topic', of: str = '') -> None:
    """Add ``--topic role=name``, or an option like it for the topics of something else."""
    parser.add_argument(
        option, metavar='ROLE=NAME', action='append', default=[], type=_role_and_name,
        help=f'name of a topic{of} by its role, e.g. wrench=/ft/data; may be repeated; '
             'pose=tf:BASE:SENSOR takes the pose from /tf, pose=urdf:FILE:BASE:LINK from joint '
             'states')


def add_sensor_pose(parser: argparse.ArgumentParser, option: str = '--sensor-from-pose',
                    of: str = '') -> None:
    """Add the transform from the frame whose pose was recorded to ft_sensor."""
    from forcecal_ros.cli.argument_types import real

    parser.add_argument(
        option, metavar=('X', 'Y', 'Z', 'QX', 'QY', 'QZ', 'QW'), nargs=7, type=real,
        help=f'pose of ft_sensor in the frame whose pose{of} was recorded and commanded, e.g. a '
             'flange or TCP [m, quaternion] (default: the recorded pose is that of ft_sensor, or '
             'as a calibration says)')


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument('--json', action='store_true', help='print the result as JSON')


def _role_and_name(text: str) -> tuple[str, str]:
    from forcecal_ros.core.topics import ROLES

    role, _, name = text.partition('=')
    if not (role and name):
        raise argparse.ArgumentTypeError(f'{text} is not ROLE=NAME, as wrench=/ft/data')
    if role not in ROLES:
        raise argparse.ArgumentTypeError(
            f'{role} is no role{or_nearest(role, ROLES) or one_of(ROLES)}')
    return role, name


def or_nearest(word: str, names: Collection[str]) -> str:
    """Return what to say after a word that is no name: the name that may have been meant."""
    from difflib import get_close_matches

    near = [name for name in names if word and name.startswith(word)] or get_close_matches(
        word, list(names), 1, CLOSE)
    return f' (did you mean {near[0]}?)' if near else ''


def one_of(names: Collection[str]) -> str:
    """Return what to say after a word that is like none of the names."""
    return f'; take one of {", ".join(names)}'


def topic_names(args: argparse.Namespace, option: str = '--topic') -> dict[str, str]:
    """
    Return what ``--topic``, or an option like it, said: role to name.

    Raises
    ------
    UsageError
        A role has two names.
    """
    from forcecal_ros.core.errors import UsageError

    names: dict[str, str] = {}
    for role, name in getattr(args, option.strip('-').replace('-', '_')):
        if names.setdefault(role, name) != name:
            raise UsageError(f'{option}: {role} is called {names[role]} and {name}; name one')
    return names


def read_likewise(args: argparse.Namespace, *, poses: bool = True) -> tuple[str, ...]:
    """Return the words by which another command finds the same in the recording."""
    topics = [word for role, name in args.topic for word in ('--topic', f'{role}={name}')]
    given = args.sensor_from_pose if poses else None
    return (*topics, *(('--sensor-from-pose', *(f'{x:g}' for x in given)) if given else ()))


def read_poses_of_sensor(
        args: argparse.Namespace, bag: str, option: str = '--sensor-from-pose',
        topics: str = '--topic', wrench_sign: int | None = None, *, joints: bool = False
        ) -> 'Recording':
    """
    Read a recording as the arguments say, its poses taken to ft_sensor where they say how.

    Parameters
    ----------
    option, topics : str
        Those of :func:`add_sensor_pose` and :func:`add_topics`.
    wrench_sign : int, optional
        By default that of ``--wrench-sign``, or 1 where there is no such option.
    joints : bool
        Whether to read the measured positions of joints, too.
    """
    from forcecal_ros.io.bags import read_recording
    from forcecal_ros.observe.frames import mounting_of, taken_to_sensor

    with from_arguments():
        mounting = mounting_of(getattr(args, option.strip('-').replace('-', '_')) or (), option)
    sign = getattr(args, 'wrench_sign', None) if wrench_sign is None else wrench_sign
    return taken_to_sensor(read_recording(
        bag, topics=topic_names(args, topics), wrench_sign=sign or 1, joints=joints), mounting)


def read_checked(args: argparse.Namespace, bag: str, wanted: Collection[str] = ('wrench',), *,
                 raw_wrench: bool = False) -> 'Recording':
    """
    Read a recording as the arguments say, and check it.

    Parameters
    ----------
    args : argparse.Namespace
        Of a parser with :func:`add_bag`.
    wanted : collection of str
        Roles that it has to hold.
    raw_wrench : bool
        Its wrench holds raw channels, before their matrix.

    Raises
    ------
    DataError
        It cannot be read, or something is wrong with it.
    """
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.core.topics import require

    recording = read_poses_of_sensor(args, bag)
    with with_reading_of(recording):
        recording = checked(recording, raw_wrench).recording
    require(recording, wanted)
    return recording


@contextmanager
def with_reading_of(recording: 'Recording') -> Iterator[None]:
    """Add to what is refused what reading found: several frames, a clock that jumps."""
    from forcecal_ros.core.errors import ForcecalError

    try:
        yield
    except ForcecalError as error:
        found = [note for note in recording.notes if any(words in note for words in WORDS)]
        raise type(error)('; '.join([str(error), *found])) from error


def print_json(document: Mapping[str, Any]) -> None:
    """Print one JSON document, without NaN or infinity."""
    print(json.dumps(document, indent=2, allow_nan=False))


@contextmanager
def from_arguments() -> Iterator[None]:
    """Take settings that are refused for wrong usage: they come from the command line alone."""
    from forcecal_ros.core.errors import ConfigError, UsageError

    try:
        yield
    except ConfigError as error:
        raise UsageError(str(error)) from error


@contextmanager
def needs_ros() -> Iterator[None]:
    """
    Import what only works where ROS 2 is.

    Raises
    ------
    ConfigError
        It is not there; with the command that brings it.
    """
    from forcecal_ros.core.errors import ConfigError
    from forcecal_ros.core.extras import installing, missing

    try:
        yield
    except ImportError as error:
        if (error.name or '').startswith('forcecal_ros') or (
                isinstance(error, ModuleNotFoundError) and missing(error)):
            raise
        setup = Path('/opt/ros/jazzy/setup.bash')
        remedy = f'source {setup}' if setup.exists() else installing('ros')
        raise ConfigError(f'ROS 2 is not there ({error}); {remedy}') from error


def say(text: str) -> None:
    """Print one line of result."""
    print(text, flush=True)


def say_if_compiling(waits: bool, what: str) -> None:
    """Say what a first run waits for."""
    if waits:
        warn(f'compiling {what} for this computer, some ten seconds; only the first run waits '
             'for that')


def warn(text: str) -> None:
    """Print one line that the user should know of, on stderr."""
    print(f'{CLEAR * sys.stderr.isatty()}forcecal: note: {" ".join(text.split())}',
          file=sys.stderr)
