"""``forcecal``: arguments in, result printed; every error that a user can fix is one line."""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from io import TextIOWrapper
import os
import signal
import sys
from textwrap import fill
from threading import current_thread, main_thread
from types import FrameType
from typing import Any, NoReturn

from forcecal_ros import __version__
from forcecal_ros.cli import COMMANDS, GROUPS, VERBS
from forcecal_ros.cli.common import as_started, check_outputs, or_nearest
from forcecal_ros.core.errors import ForcecalError, UsageError, with_id
from forcecal_ros.core.files import remedy

EPILOG = """\
forcecal COMMAND --help shows the options of a command, with an example.
exit status: 0 done, 1 the data cannot give a result (one line on stderr gives the
  reason), 2 wrong usage, 3 found what --fail-on names, 130 interrupted

example:
  forcecal sample rig -o sample                            two recordings, in seconds
  forcecal check sample/sound                              what is in it
  forcecal calibrate sample/sound --report report.html     also writes calibration.yaml
  forcecal estimate sample/sound --calibration calibration.yaml -o contact
  forcecal diagnose sample/late -o diagnosis

an error ends with its id, e.g. [FC0202]; docs/reference/errors.md explains it
eval "$(register-python-argcomplete forcecal)" enables tab completion
"""


USAGE_ID = 'FC0001'
"""Ends what the parser prints; see :data:`forcecal_ros.core.errors.KINDS`."""


class StoreOnce(argparse.Action):
    """Stores a value; a second, different one is refused, since either may have been meant."""

    _before: Any = None

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: Any, option_string: str | None = None) -> None:
        """Put it into the arguments; an empty name is refused."""
        if self.type is None and '' in (values if isinstance(values, list) else [values]):
            raise argparse.ArgumentError(self, 'the value is empty; give one')
        if self.option_strings and self._before not in (None, values):
            raise argparse.ArgumentError(
                self, f'it is given twice ({self._before}, {values}); keep one')
        self._before = values
        setattr(namespace, self.dest, values)


class Parser(argparse.ArgumentParser):
    """Reports wrong usage in one line, with status 2."""

    commands: Mapping[str, 'Parser'] = {}
    """Parsers of the commands, by name."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(fromfile_prefix_chars='@', **settings)
        for name in (None, 'store'):
            self.register('action', name, StoreOnce)

    @property
    def options(self) -> list[str]:
        """All that begin with two dashes, those of its commands among them."""
        own = [name for action in self._actions for name in action.option_strings
               if name.startswith('--')]
        return [*own, *(name for one in self.commands.values() for name in one.options)]

    def convert_arg_line_to_args(self, arg_line: str) -> list[str]:
        """Return what a line of @FILE lists; nothing of a comment."""
        if not arg_line.isprintable():
            raise UnicodeError
        return [arg_line] if arg_line and not arg_line.startswith('#') else []

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and end with status 2."""
        self.exit(2, f'{self.prog}: {message}; '
                  f'{as_started(self.prog + " --help")} shows more [{USAGE_ID}]\n')


def build_parser(command: str = '') -> Parser:
    """
    Return the parser of the command line.

    Parameters
    ----------
    command : str
        The only one that is needed; without it the parser lists the commands without their
        arguments.
    """
    parser = Parser(
        prog='forcecal', epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Calibrate wrist force/torque sensors, estimate contact forces, and find '
                    'out why simulation and robot disagree.')
    parser.add_argument('--version', action='version', version=f'forcecal {__version__}')
    subparsers = parser.add_subparsers(metavar='COMMAND', required=True, help='one listed below')
    if command in COMMANDS:
        name = 'import_csv' if command == 'import' else command.replace('-', '_')
        module = import_module(f'forcecal_ros.cli.{name}')
        module.add_parser(subparsers)
        subparsers.choices[command].set_defaults(run=module.run)
    else:
        for name in COMMANDS:
            subparsers.add_parser(name)
        parser.epilog = f'{command_list()}\n\n{EPILOG}'
    parser.commands = subparsers.choices
    return parser


def command_list() -> str:
    """Return every command with what it does, by purpose."""
    lines = []
    for purpose, commands in GROUPS.items():
        lines.append(f'{purpose}:')
        lines += [fill(summary, 79, initial_indent=f'  {name:<11}',
                       subsequent_indent=' ' * 13)
                  for name, summary in commands.items()]
    return '\n'.join(lines)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the command line; wrong usage exits with 2, and names the nearest word."""
    if '_ARGCOMPLETE' in os.environ:  # the shell wants what may follow
        from argcomplete import autocomplete

        words = os.environ['COMP_LINE'].split()
        autocomplete(build_parser(words[1] if len(words) > 1 else ''))
    if arguments and arguments[0] in VERBS:
        arguments = ['robot', *arguments]
    first = arguments[0] if arguments else ''
    parser = build_parser(first)
    if not arguments:
        parser.print_help(sys.stderr)
        parser.exit(2)
    if not first.startswith('-') and first not in COMMANDS:
        parser.error(f'{first} is not a command{or_nearest(first, (*COMMANDS, *VERBS))}')
    try:
        args, left = parser.parse_known_args(arguments)
    except UnicodeError:  # Python before 3.12 raises one by itself
        parser.error('the file after @ is not text; list one BAG or DIR per line')
    if left:
        command = getattr(args, 'parser', parser)
        word = next((one for one in left if one.startswith('-')), left[0]).partition('=')[0]
        command.error(f'{word} is not an argument here{or_nearest(word, command.options)}')
    return args


def main(arguments: Sequence[str] | None = None,
         parse: Callable[[Sequence[str]], argparse.Namespace] = parse) -> int:
    """
    Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Defaults to ``sys.argv[1:]``.
    parse : callable
        Turns them into what ``check_outputs`` and ``run`` take.

    Returns
    -------
    int
        0 done, 1 the data cannot answer, 2 wrong usage, 3 found what ``--fail-on`` names, 130
        interrupted (128 and the signal).
    """
    # small matrices are slower on several threads, and round in another order on other machines
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if isinstance(sys.stdout, TextIOWrapper):  # a letter that a terminal lacks ends nothing
        sys.stdout.reconfigure(errors='replace')
    args = argparse.Namespace()
    try:
        with _signals_as_interrupts():
            args = parse(sys.argv[1:] if arguments is None else arguments)
            check_outputs(args)
            status = int(args.run(args))
            print(end='', flush=True)
            return status
    except BrokenPipeError:
        _give_up_stdout()
        return 1
    except KeyboardInterrupt as interrupt:
        with suppress(OSError):  # of a terminal that has closed
            print('forcecal: interrupted', file=sys.stderr)
        return 128 + (interrupt.args[0] if interrupt.args else signal.SIGINT)
    except (ForcecalError, ModuleNotFoundError, OSError) as error:
        if not (message := _in_one_line(error)):
            raise
        if getattr(args, 'debug', False):
            import traceback

            traceback.print_exc()
        print(f'forcecal: {as_started(with_id(error, message))}', file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1


def _in_one_line(error: Exception) -> str:
    """Return what is wrong and how to fix it; empty for an error of the program itself."""
    if isinstance(error, ModuleNotFoundError):
        from forcecal_ros.core.extras import missing  # the help does without

        return missing(error)
    if isinstance(error, OSError):
        _give_up_stdout()
        where = f'{error.filename}: ' if error.filename else ''
        do = remedy(error, 'check the path and its permissions')
        return f'{where}{error.strerror or error}; {do}'
    return str(error)


@contextmanager
def _signals_as_interrupts() -> Iterator[None]:
    """Let SIGTERM, and a terminal that closes, end a command as Ctrl-C does, without scratch."""
    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt(number)

    before = {}
    if current_thread() is main_thread():
        before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGHUP)
                  if signal.getsignal(number) is signal.SIG_DFL}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _give_up_stdout() -> None:
    """Drop what standard output does not take, which Python would try to write once more."""
    try:
        print(end='', flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == '__main__':
    sys.exit(main())
