"""Arguments, output, progress and places to write to that several commands share."""

import argparse
from argparse import ArgumentTypeError
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
import json
from math import isfinite
import os
from pathlib import Path
import re
import sys
from threading import Event, Thread
import time
from typing import Any, NamedTuple, TYPE_CHECKING, TypeVar

from forcecal_ros.cli import COMMANDS, VERBS
from forcecal_ros.core.errors import ConfigError, ForcecalError, UsageError
from forcecal_ros.core.extras import program
from forcecal_ros.core.files import descriptor_of, refuse_file, refuse_folder, STANDARD_OUTPUT

if TYPE_CHECKING:
    from forcecal_ros.core.streams import Recording

T = TypeVar('T')

CLEAR = '\r\033[K'
"""Removes a line of progress from a terminal."""

UNITS = {'S': ' s', 'HZ': ' Hz', 'KG': ' kg', 'DEG': ' deg', 'NS/M': ' N s/m', 'N/M': ' N/m'}
"""Unit that follows a default, by the name that the help gives a number."""

_COMMANDS = re.compile(
    rf'(?<![\w/.-])forcecal(?= (?:--help|{"|".join((*COMMANDS, *VERBS))})(?![\w-]))')
"""The name of the program where a command follows."""

PROGRESS_DELAY_S = 2.0
"""Work that is done sooner shows no progress on a terminal."""

READING_NOTES = (': frame_id is ', 'because their stamps jump', 'by another clock')
"""Notes of the reader that may be why a recording is refused later."""

POSE7 = ('X', 'Y', 'Z', 'QX', 'QY', 'QZ', 'QW')


class Formatter(argparse.ArgumentDefaultsHelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Help with defaults and their units, and the example as it was written."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default is None or action.default is False or action.default in ('', []):
            return action.help
        if isinstance(action.default, float):
            unit = UNITS.get(str(action.metavar), '')
            return f'{action.help} (default: {action.default:g}{unit})'
        return super()._get_help_string(action)


def new_parser(subparsers: Any, name: str, *, example: str, summary: str = '',
               inputs: tuple[str, ...] = (), json: bool = True, quiet: bool = True
               ) -> argparse.ArgumentParser:
    """
    Add a command with its summary, an example, ``--json``, ``--quiet`` and ``--debug``.

    Parameters
    ----------
    inputs : tuple of str
        Arguments that name files or folders to read, which no output may replace.
    """
    summary = summary or COMMANDS[name]
    parser: argparse.ArgumentParser = subparsers.add_parser(
        name, help=summary, description=summary[0].upper() + summary[1:] + '.',
        epilog=f'example:\n  {example}', formatter_class=Formatter)
    out = group(parser, 'output')
    if json:
        out.add_argument('--json', action='store_true', help='print the result as JSON')
    if quiet:
        out.add_argument('--quiet', action='store_true', help='show no progress')
    out.add_argument('--debug', action='store_true', help='show the traceback of an error')
    parser.set_defaults(parser=parser, inputs=inputs)
    return parser


def group(parser: argparse.ArgumentParser, title: str) -> Any:
    """Return the group of options with a title, a new one if there is none."""
    known = [one for one in parser._action_groups if one.title == title]  # noqa: SLF001
    return known[0] if known else parser.add_argument_group(title)


def add_bag(parser: argparse.ArgumentParser, *, several: str = '') -> None:
    """
    Add the recording to read, how its topics are called, and the sign of its wrench.

    Parameters
    ----------
    several : str
        What becomes of several; without it there is one.
    """
    if several:
        parser.add_argument('bag', metavar='BAG', nargs='+',
                            help='rosbag2 folder or file (mcap, sqlite3); several, or @FILE with '
                                 f'one per line: {several}')
    else:
        parser.add_argument('bag', metavar='BAG', help='rosbag2 folder or file (mcap, sqlite3)')
    add_streams(parser)
    group(parser, 'recording').add_argument(
        '--wrench-sign', type=int, choices=(1, -1),
        help='-1 for a driver that reports the wrench of the tool on its environment (default: '
             'that of the calibration, or 1)')


def add_streams(parser: argparse.ArgumentParser, of: str = '') -> None:
    """
    Add names of topics, and the transform from the frame whose pose was recorded to ft_sensor.

    Parameters
    ----------
    of : str
        ``simulated-``: of what a simulator recorded.
    """
    options = group(parser, 'model' if of else 'recording')
    whose, where = (" of the simulator's", ' in the simulator') if of else ('', '')
    options.add_argument(
        f'--{of}topic', metavar='ROLE=NAME', action='append', default=[], type=_role_and_name,
        help=f'topic name{whose} for a role, e.g. wrench=/ft/data; may be repeated; '
             'pose=tf:BASE:SENSOR reads the pose from /tf, pose=urdf:FILE:BASE:LINK from joint '
             'states')
    if not of:
        options.add_argument('--preset', metavar='NAME', type=preset,
                             help='topic names of a robot driver: ur, franka, kuka_fri, '
                                  'broadcaster')
    options.add_argument(
        f'--{of}sensor-from-pose', metavar=POSE7, nargs=7, type=real,
        help=f'pose of ft_sensor in the frame whose pose{where} was recorded and commanded, e.g. '
             'a flange or TCP [m, quaternion] (default: that of the calibration; else the '
             'recorded pose is that of ft_sensor)')


def add_gravity(options: Any, *defaults: str) -> None:
    """Add the magnitude and direction of gravity."""
    size, direction = defaults or ('9.80665 m/s^2', '0 0 -1')
    options.add_argument('--gravity', metavar='M/S^2', type=gravity,
                         help=f'magnitude of gravity at the robot (default: {size})')
    options.add_argument('--gravity-direction', metavar=('X', 'Y', 'Z'), nargs=3, type=real,
                         help="direction of gravity in the robot's base, of any length, if the "
                              f'base is tilted (default: {direction})')


def gravity_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return magnitude and direction of gravity as fields of settings."""
    from forcecal_ros.core.axes import unit_direction
    from forcecal_ros.core.geometry import STANDARD_GRAVITY

    direction = args.gravity_direction
    if direction is not None and not any(direction):
        raise UsageError('--gravity-direction 0 0 0 is not a direction; give 0 0 -1 for an '
                         'upright base')
    return {'gravity': args.gravity or STANDARD_GRAVITY,
            'gravity_direction': unit_direction(direction)}


def word(what: str, module: str, names: str) -> Callable[[str], str]:
    """Return a function that reads one of the names that a module of this package lists."""
    def take(name: str) -> str:
        known = getattr(import_module(f'forcecal_ros.{module}'), names)
        if name not in known:
            nearest = or_nearest(name, known) or f'; choose one of {", ".join(known)}'
            raise ArgumentTypeError(f'{name} is not {what}{nearest}')
        return name

    return take


preset = word('a preset', 'core.topics', 'ROBOTS')


def _role_and_name(text: str) -> tuple[str, str]:
    role, _, name = text.partition('=')
    if not (role and name):
        raise ArgumentTypeError(f'{text} is not ROLE=NAME, e.g. wrench=/ft/data')
    return word('a role', 'core.topics', 'ROLES')(role), name


def or_nearest(word: str, names: Collection[str]) -> str:
    """Return what follows a word that is not a name: the name that may have been meant."""
    from difflib import get_close_matches

    # share of letters that a wrong word has in common with what may have been meant
    near = [name for name in names if word and name.startswith(word)] or get_close_matches(
        word, list(names), 1, 0.75)
    return f' (did you mean {near[0]}?)' if near else ''


def topic_names(args: argparse.Namespace, bag: str = '', of: str = '') -> dict[str, str]:
    """
    Return role to name, by ``--topic`` or an option like it, then by ``--preset``.

    Parameters
    ----------
    bag : str
        Recording whose topics a preset's names are looked for in.
    of : str
        As for :func:`add_streams`.

    Raises
    ------
    UsageError
        A role has two names.
    """
    names: dict[str, str] = {}
    for role, name in _given(args, f'{of}topic'):
        if names.setdefault(role, name) != name:
            raise UsageError(f'--{of}topic: {role} is {names[role]} and also {name}; keep one')
    if bag and not of:
        names = preset_topics(getattr(args, 'preset', None) or '', bag) | names
    return names


def preset_topics(name: str, bag: str) -> dict[str, str]:
    """Return role to name of the topics of a preset that a recording holds."""
    if not name:
        return {}
    from forcecal_ros.core.topics import topics_by_role
    from forcecal_ros.io.bags import read_topics

    recorded = {topic.name for topic in read_topics(bag)}
    return {role: topic for role, topic in topics_by_role(name).items()
            if ('/tf' if topic.startswith('tf:') else topic) in recorded}


def read_likewise(args: argparse.Namespace, *, poses: bool = True) -> tuple[str, ...]:
    """Return the words by which another command finds the same in the recording."""
    topics = [word for role, name in args.topic for word in ('--topic', f'{role}={name}')]
    named = ['--preset', args.preset] if getattr(args, 'preset', None) else []
    given = args.sensor_from_pose if poses else None
    return (*named, *topics,
            *(('--sensor-from-pose', *(f'{x:g}' for x in given)) if given else ()))


def _given(args: argparse.Namespace, option: str) -> Any:
    """Return the value of an option; None if the command does not have it."""
    return getattr(args, option.replace('-', '_'), None)


def read(args: argparse.Namespace, bag: str, of: str = '', *, joints: bool = False
         ) -> 'Recording':
    """
    Read a recording as the arguments describe it, its poses taken to ft_sensor; no checks.

    Parameters
    ----------
    of : str
        As for :func:`add_streams`.
    joints : bool
        Whether to read the measured positions of joints, too.
    """
    from forcecal_ros.io.bags import read_recording
    from forcecal_ros.observe.frames import mounting_of, taken_to_sensor

    with from_arguments():
        mounting = mounting_of(_given(args, f'{of}sensor-from-pose') or (),
                               f'--{of}sensor-from-pose')
    return taken_to_sensor(read_recording(
        bag, topics=topic_names(args, bag, of), wrench_sign=_given(args, f'{of}wrench-sign'),
        joints=joints), mounting)


def read_checked(args: argparse.Namespace, bag: str, roles: Collection[str] = ('wrench',), *,
                 raw_wrench: bool = False) -> 'Recording':
    """
    Read a recording as the arguments describe it, and check it.

    Parameters
    ----------
    roles : collection of str
        What it has to hold.
    raw_wrench : bool
        Its wrench holds raw channels, before their matrix.

    Raises
    ------
    DataError
        It cannot be read, or something is wrong with it.
    """
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.core.topics import require

    recording = read(args, bag)
    with with_notes_of(recording):
        recording = checked(recording, raw_wrench)
    require(recording, roles)
    return recording


@contextmanager
def with_notes_of(recording: 'Recording') -> Iterator[None]:
    """Add to a refusal what reading found: several frames, a clock that jumps."""
    try:
        yield
    except ForcecalError as error:
        found = [note for note in recording.notes if any(word in note for word in READING_NOTES)]
        error.args = ('; '.join([str(error), *found]),)
        raise


@contextmanager
def from_arguments() -> Iterator[None]:
    """Turn refused settings into wrong usage, where they come from the command line alone."""
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
        It is not there; with the command that installs it.
    """
    from forcecal_ros.core.extras import installing, missing

    try:
        yield
    except ImportError as error:
        if (error.name or '').startswith('forcecal_ros') or (
                isinstance(error, ModuleNotFoundError) and missing(error)):
            raise
        setup = Path('/opt/ros/jazzy/setup.bash')
        remedy = f'source {setup}' if setup.exists() else installing('ros')
        raise ConfigError(f'ROS 2 is not available ({error}); {remedy}') from error


def as_started(text: str) -> str:
    """Return a text whose commands begin as this one was started, as by ./run."""
    return _COMMANDS.sub(lambda _: program(), text)


def say(text: str) -> None:
    """Print one line of result."""
    print(as_started(text), flush=True)


def show(args: argparse.Namespace, document: Mapping[str, Any], text: str,
         notes: Iterable[str] = (), status: int = 0) -> int:
    """
    Print a result: notes on stderr; the document with ``--json``, else the text.

    Returns
    -------
    int
        The status. No text is printed where a file goes to standard output.
    """
    for note in notes:
        warn(note)
    if args.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    elif not stdout_is_taken(args):
        say(text)
    return status


def warn(text: str) -> None:
    """Print one note for the user on stderr."""
    print(f'{CLEAR * sys.stderr.isatty()}forcecal: note: {" ".join(text.split())}',
          file=sys.stderr)


def warn_if_compiling(*parts: str) -> None:
    """Note that a first run waits for the ``simulator`` or the ``observer`` to be compiled."""
    modules = {'simulator': 'sim.rig.simulator', 'observer': 'observe.batch'}
    if any(import_module(f'forcecal_ros.{modules[part]}').waits_for_compiler() for part in parts):
        warn(f'compiling the {" and the ".join(parts)}; this takes about 10 s, on the first run '
             'only')


def bar(args: argparse.Namespace, **settings: Any) -> Any:
    """Return a progress bar of tqdm: share done and time left, on a terminal."""
    from tqdm import tqdm

    return tqdm(leave=False, delay=PROGRESS_DELAY_S, disable=args.quiet or None, **settings)


@contextmanager
def stages(args: argparse.Namespace, after: float = PROGRESS_DELAY_S
           ) -> Iterator[Callable[[str], None]]:
    """
    Show which stage a command is in, and for how long: a line on a terminal, notes elsewhere.

    Parameters
    ----------
    after : float
        When a terminal begins to show it [s].

    Yields
    ------
    callable
        Takes the name of each stage as it begins.
    """
    if args.quiet or not sys.stderr.isatty():
        yield lambda stage: None if args.quiet else warn(stage)
        return
    began, ended, current = time.monotonic(), Event(), ['']

    def work() -> None:
        while not ended.wait(0.2):  # whole seconds are shown
            if (seconds := time.monotonic() - began) > after:
                print(f'{CLEAR}{seconds:3.0f} s  {current[0]}', end='', file=sys.stderr,
                      flush=True)

    line = Thread(target=work, daemon=True)
    line.start()
    try:
        yield lambda stage: current.__setitem__(0, stage)
    finally:
        ended.set()
        line.join()
        print(CLEAR, end='', file=sys.stderr, flush=True)


def _reading(expected: str, read: Callable[[str], T], fits: Callable[[T], object]
             ) -> Callable[[str], T]:
    """Return a function that reads a word of an option, and refuses one that does not fit."""
    def take(text: str) -> T:
        with suppress(ValueError):
            if fits(value := read(text)):
                return value
        raise ArgumentTypeError(f'{text!r} is not {expected}')

    return take


def number(expected: str, fits: Callable[[float], bool]) -> Callable[[str], float]:
    """Return a function that reads a finite number within limits."""
    return _reading(expected, float, lambda x: isfinite(x) and fits(x))


real = number('a number', lambda x: True)
positive = number('a number above 0', lambda x: x > 0)
not_negative = number('a number of 0 or more', lambda x: x >= 0)
# from the Moon's to Jupiter's: a number outside has a wrong sign or another unit
gravity = number('a magnitude of gravity from 1.6 to 25 m/s^2', lambda x: 1.6 <= x <= 25.0)
# a sensor on a wrist is no farther from the force sensor: 30 or 120 is meant in millimetres
nearby = number('a coordinate from -1 to 1 m', lambda x: abs(x) <= 1.0)


whole = _reading('an integer, 0 or more', int, lambda x: 0 <= x < 2**63)
at_least_one = _reading('an integer, 1 or more', int, lambda x: 1 <= x < 2**63)
port = _reading('an integer, 0 to 65535', int, lambda x: 0 <= x <= 65535)


def _matching(pattern: str, expected: str) -> Callable[[str], str]:
    """Return a function that reads a name of a form."""
    return _reading(expected, str, re.compile(pattern).fullmatch)


_PART = r'[A-Za-z_][A-Za-z0-9_]*'
topic_name = _matching(rf'/?{_PART}(/{_PART})*', 'a topic name, e.g. /ft/wrench')
namespace = _matching(rf'/?|/?{_PART}(/{_PART})*/?', 'a namespace, e.g. /left')
node = _matching(rf'/?({_PART}|\*\*?)(/({_PART}|\*\*?))*', 'a node name')
frame = _matching(r'\S+', 'a frame name')
address = _matching(r'(\w+://)?(\[[\da-fA-F:.]+\]|[^\s:/\[\]]+):\d+',
                    'an address, e.g. tcp://host:8786')


def add_namespace(options: Any, what: str = 'namespace of the nodes, e.g. /left') -> None:
    """Add ``--namespace``."""
    options.add_argument('--namespace', metavar='NAME', type=namespace, default='', help=what)


class Output(NamedTuple):
    """
    An argument that names a place to write to.

    Attributes
    ----------
    name, option : str
        In the parsed arguments, and as the user writes it.
    kind : str
        ``file``, which may be standard output; ``results``, a folder that is written into; or
        ``recording``, which is replaced.
    suffix : str
        Follows a recording's name if results of many recordings go to one folder.
    """

    name: str
    option: str
    kind: str
    suffix: str = ''


def add_output(parser: argparse.ArgumentParser, *options: str, kind: str, metavar: str,
               suffix: str = '', help: str = 'recording to write', more: str = '',  # noqa: A002
               **settings: Any) -> None:
    """Add an argument that names a place to write to, and say what becomes of what is there."""
    earlier = f'; an earlier one is kept as {"NAME" if kind == "results" else metavar}~{more}'
    action = group(parser, 'output').add_argument(
        *options, metavar=metavar, help=help + earlier, **settings)
    declared = parser.get_default('outputs') or ()
    parser.set_defaults(outputs=(*declared, Output(action.dest, options[0], kind, suffix)))


def is_many(args: argparse.Namespace) -> bool:
    """Return whether results go to a folder, under the names of the recordings."""
    return hasattr(args, 'jobs') and (
        len(args.bag) > 1 or str(args.output or '').endswith('/'))


def check_outputs(args: argparse.Namespace) -> None:
    """
    Make sure that what a command will write can be written; ``-`` becomes standard output.

    Raises
    ------
    UsageError
        A place cannot be written to, or is one that the command reads.
    """
    taken: dict[Path, str] = {}
    for output in getattr(args, 'outputs', ()):
        value = getattr(args, output.name)
        if value is None:
            continue
        try:
            path = _check_output(args, output, value)
        except ConfigError as error:
            raise UsageError(f'{output.option}: {error}') from error
        if path in taken:
            raise UsageError(f'{taken[path]} and {output.option} both name {value}; '
                             f'give {output.option} another path')
        taken[path] = output.option


def _check_output(args: argparse.Namespace, output: Output, value: str) -> Path:
    """Return the place, links followed."""
    many = is_many(args)
    if not value:
        raise ConfigError('the path is empty; give one')
    if value == '-':
        if many or output.kind != 'file':
            raise ConfigError('a folder cannot be written to standard output; give its path')
        value = str(STANDARD_OUTPUT)
        setattr(args, output.name, value)
    if many:
        if output.suffix and value.endswith(output.suffix) and not Path(value).is_dir():
            raise ConfigError(f'several BAGs require a folder, not {value}; give e.g. results/')
        refuse_folder(value, replaced=False)
    elif output.kind == 'file':
        refuse_file(value)
        if getattr(args, 'json', False) and is_stdout(value):
            raise ConfigError('standard output holds one document only; leave --json out')
    else:
        if output.kind == 'recording' and Path(value).is_file():
            raise ConfigError(f'{value} is a file, a recording is a folder; give another path')
        refuse_folder(value, replaced=output.kind == 'recording')
    if output.kind != 'results' and not many:
        refuse_inputs(value, output.kind, _inputs(args))
    return Path(os.path.realpath(value))


def refuse_inputs(place: str, kind: str, inputs: Iterable[str]) -> None:
    """Raise ConfigError if ``place`` is one of ``inputs``, holds one, or is part of one."""
    path = Path(os.path.realpath(place))
    part = path.name == 'metadata.yaml' or not {'.mcap', '.db3'}.isdisjoint(path.suffixes)
    for name in inputs:
        source = Path(os.path.realpath(name))
        if path in (source, *(source.parents if kind == 'recording' else ())) or (
                source in path.parents and part):
            raise ConfigError(f'{place} would overwrite the input {name}; name '
                              f'another {"folder" if kind == "recording" else "file"}')


def is_stdout(value: str | None) -> bool:
    """Return whether a file goes where results are printed."""
    return value is not None and descriptor_of(Path(value)) == 1


def stdout_is_taken(args: argparse.Namespace) -> bool:
    """Return whether a file goes to standard output."""
    return any(o.kind == 'file' and is_stdout(getattr(args, o.name))
               for o in getattr(args, 'outputs', ()))


def _inputs(args: argparse.Namespace) -> Iterator[str]:
    for name in getattr(args, 'inputs', ()):
        value = getattr(args, name)
        if value:
            yield from [value] if isinstance(value, str) else value
