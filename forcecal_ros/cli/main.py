"""``forcecal``: arguments in, result printed. All errors a user can mend become one line here."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
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
from forcecal_ros.cli import COMMANDS, GROUPS
from forcecal_ros.cli.common import or_nearest
from forcecal_ros.cli.outputs import check_outputs
from forcecal_ros.core.errors import ForcecalError, UsageError
from forcecal_ros.core.files import remedy

EPILOG = """\
forcecal COMMAND --help tells the options of a command, with an example.
exit status: 0 done, 1 the data cannot answer (one line on stderr says why), 2 wrong usage

example:
  forcecal sample rig -o sample                            two recordings, in seconds
  forcecal calibrate sample/sound --report report.html     writes calibration.yaml, too
  forcecal estimate sample/sound --calibration calibration.yaml -o contact
  forcecal diagnose sample/late -o diagnosis
"""

NAMES = 17
"""Columns that the names of commands take in the help: the longest and two more."""


class Given(argparse.Action):
    """Stores what is given, once: of two values nobody knows which was meant."""

    _before: Any = None

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: Any, option_string: str | None = None) -> None:
        """Put it into the arguments; a name that is empty is none."""
        if values == '' and self.type is None:
            raise argparse.ArgumentError(self, 'an empty name is given; name it')
        if self.option_strings and self._before not in (None, values):
            raise argparse.ArgumentError(
                self, f'{self._before} and {values} are given; give one')
        self._before = values
        setattr(namespace, self.dest, values)


class Parser(argparse.ArgumentParser):
    """
    Says in one line what is wrong.

    Attributes
    ----------
    options : list of str
        All that begin with two dashes.
    commands : mapping of str to Parser
        Those of the commands.
    """

    def __init__(self, **settings: Any) -> None:
        self.options: list[str] = []
        self.commands: Mapping[str, Parser] = {}
        super().__init__(**settings)
        for name in (None, 'store'):
            self.register('action', name, Given)

    def add_argument(self, *names: Any, **settings: Any) -> argparse.Action:
        """Add an argument, and remember how it is called."""
        self.options += [name for name in names if name.startswith('--')]
        return super().add_argument(*names, **settings)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and end with status 2."""
        self.exit(2, f'{self.prog}: {message}; {self.prog} --help tells more\n')


def build_parser(command: str = '') -> Parser:
    """
    Return the parser of the command line.

    Parameters
    ----------
    command : str
        The only one that will be needed; without it the parser lists the commands, and knows
        none of their arguments.
    """
    parser = Parser(
        prog='forcecal', epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Calibrate wrist force/torque sensors, estimate contact forces, and find '
                    'out why simulation and robot disagree.')
    parser.add_argument('--version', action='version', version=f'forcecal {__version__}')
    subparsers = parser.add_subparsers(metavar='COMMAND', required=True, help='one of those below')
    if command in COMMANDS:
        module = import_module(f'forcecal_ros.cli.{COMMANDS[command].module}')
        module.add_parser(subparsers)
    else:
        for name in COMMANDS:
            subparsers.add_parser(name)
        parser.epilog = f'{listed()}\n\n{EPILOG}'
    parser.commands = subparsers.choices
    return parser


def listed() -> str:
    """Return every command with what it does, by what it is for."""
    lines = []
    for purpose, commands in GROUPS.items():
        lines.append(f'{purpose}:')
        lines += [fill(one.summary, 79, initial_indent=f'  {name:<{NAMES}}',
                       subsequent_indent=' ' * (NAMES + 2)) for name, one in commands.items()]
    return '\n'.join(lines)


def parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the command line; wrong usage exits with 2, and says the nearest command or option."""
    first = arguments[0] if arguments else ''
    parser = build_parser(first)
    if not arguments:
        parser.print_help(sys.stderr)
        parser.exit(2)
    if not first.startswith('-') and first not in COMMANDS:
        parser.error(f'{first} is no command{or_nearest(first, COMMANDS)}')
    args, left = parser.parse_known_args(arguments)
    if left:
        command = parser.commands.get(first, parser)
        word = next((one for one in left if one.startswith('-')), left[0]).partition('=')[0]
        command.error(f'{word} is no argument here{or_nearest(word, command.options)}')
    return args


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Defaults to ``sys.argv[1:]``.

    Returns
    -------
    int
        0 done, 1 the data cannot answer, 2 wrong usage, 130 interrupted (128 and the signal).
    """
    # small matrices are slower on several threads, and round in another order on other machines
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if isinstance(sys.stdout, TextIOWrapper):  # a letter that a terminal lacks ends nothing
        sys.stdout.reconfigure(errors='replace')
    try:
        with _ended_as_by_ctrl_c():
            args = parsed(sys.argv[1:] if arguments is None else arguments)
            check_outputs(args)
            status = int(args.run(args))
            print(end='', flush=True)
            return status
    except UsageError as error:
        return _complain(str(error), 2)
    except ForcecalError as error:
        return _complain(str(error))
    except ModuleNotFoundError as error:
        from forcecal_ros.core.extras import missing  # the help does without

        if why := missing(error):
            return _complain(why)
        raise
    except BrokenPipeError:
        _give_up_stdout()
        return 1
    except OSError as error:
        _give_up_stdout()
        where = f'{error.filename}: ' if error.filename else ''
        do = remedy(error, 'check the path and its permissions')
        return _complain(f'{where}{error.strerror or error}; {do}')
    except KeyboardInterrupt as interrupt:
        with suppress(OSError):  # of a terminal that has closed
            print('forcecal: interrupted', file=sys.stderr)
        return 128 + (interrupt.args[0] if interrupt.args else signal.SIGINT)


@contextmanager
def _ended_as_by_ctrl_c() -> Iterator[None]:
    """Let SIGTERM, and a terminal that closes, leave nothing half done behind."""
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


def _complain(message: str, status: int = 1) -> int:
    print(f'forcecal: {" ".join(message.split())}', file=sys.stderr)
    return status


if __name__ == '__main__':
    sys.exit(main())
