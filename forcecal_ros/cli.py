"""``forcecal``: arguments in, result printed. All errors a user can mend become one line here."""

import argparse
from collections.abc import Sequence
from importlib import import_module
import os
import sys

from forcecal_ros import __version__
from forcecal_ros.errors import ForcecalError

COMMANDS = {
    'demo': 'demo',
    'calibrate': 'calibrate',
    'estimate': 'estimate',
    'export': 'export',
    'simulate': 'simulate',
    'identify-robot': 'identify_robot',
    'diagnose': 'diagnose',
    'plan': 'plan',
    'insitu': 'insitu',
    'gravity': 'gravity',
    'impedance': 'impedance',
    'import': 'import_csv',
    'record': 'record',
    'play': 'play',
}
"""Word on the command line -> module in ``forcecal_ros.commands``."""

EPILOG = """\
exit status: 0 done, 1 the data cannot answer (one line on stderr says why), 2 wrong usage

example:
  forcecal demo                          calibrate a simulated rig over ROS 2, end to end
  forcecal calibrate BAG -o cal.yaml     identify tool, sensor and noise from a recording
  forcecal estimate BAG --calibration cal.yaml -o OUT_BAG
"""


def build_parser(command: str | None = None) -> argparse.ArgumentParser:
    """
    Return the parser of the command line, every command with its own help.

    Parameters
    ----------
    command : str, optional
        The only one that will be needed: the others, and what they import, are not loaded.

    Returns
    -------
    argparse.ArgumentParser
    """
    parser = argparse.ArgumentParser(
        prog='forcecal', epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Calibrate wrist force/torque sensors, estimate contact forces, and find '
                    'out why simulation and robot disagree.')
    parser.add_argument('--version', action='version', version=f'forcecal {__version__}')
    subparsers = parser.add_subparsers(metavar='COMMAND', required=True)
    for module in [COMMANDS[command]] if command in COMMANDS else COMMANDS.values():
        import_module(f'forcecal_ros.commands.{module}').add_parser(subparsers)
    return parser


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
        0 done, 1 the data cannot answer, 130 interrupted; wrong usage exits with 2.
    """
    # small matrices are slower on several threads, and round in another order on other machines
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    args = build_parser(arguments[0] if arguments else None).parse_args(arguments)
    try:
        return int(args.run(args))
    except ForcecalError as error:
        return _complain(str(error))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        where = f'{error.filename}: ' if error.filename else ''
        return _complain(f'{where}{error.strerror or error}; check the path and its permissions')
    except KeyboardInterrupt:
        print('forcecal: interrupted', file=sys.stderr)
        return 130


def _complain(message: str) -> int:
    print(f'forcecal: {" ".join(message.split())}', file=sys.stderr)
    return 1


if __name__ == '__main__':
    sys.exit(main())
