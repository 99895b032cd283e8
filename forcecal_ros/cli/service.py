"""``forcecal start``, ``abort``, ``preview``, ``save``, ``tare``: a service of a running node."""

import argparse
from typing import Any

from forcecal_ros.cli.argument_types import namespace, positive
from forcecal_ros.cli.common import add_json, needs_ros, new_parser, print_json, say

SERVICES = {'start': '{}/start', 'abort': '{}/abort', 'preview': 'sequencer/preview',
            'save': 'sequencer/save_calibration', 'tare': 'observer/tare'}
"""Service of each command; where a brace stands, of the node that moves the robot."""


def add_parser(subparsers: Any) -> None:
    """Declare the commands."""
    for verb, service in SERVICES.items():
        parser = new_parser(subparsers, verb, example=f'forcecal {verb}')
        if '{}' in service:
            parser.add_argument('--node', choices=('sequencer', 'impedance'), default='sequencer',
                                help='node that moves the robot')
        add_namespace(parser)
        parser.add_argument('--patience', metavar='S', type=positive, default=10.0,
                            help='how long to wait for the node and for its answer')
        add_json(parser)
        parser.set_defaults(run=run, service=service)


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Add ``--namespace``."""
    parser.add_argument('--namespace', metavar='NAME', type=namespace, default='',
                        help='namespace of the nodes, e.g. /left')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    with needs_ros():
        from forcecal_ros.nodes.client import ask, temporary_node
    from forcecal_ros.core.errors import DataError

    path = f'{args.namespace.strip("/")}/{args.service.format(getattr(args, "node", ""))}'
    service = f'/{path.lstrip("/")}'
    with temporary_node('asking') as ros:
        answer = ask(ros, service, args.patience)
    if not answer.success:
        raise DataError(f'{service}: {answer.message}')
    if args.json:
        print_json({'service': service, 'message': answer.message})
    else:
        say(answer.message)
    return 0
