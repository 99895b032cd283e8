"""``forcecal status``: how the running nodes are."""

import argparse
from typing import Any

from forcecal_ros.cli.argument_types import positive
from forcecal_ros.cli.common import add_json, needs_ros, new_parser, print_json, say
from forcecal_ros.cli.service import add_namespace


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(subparsers, 'status', example='forcecal status')
    add_namespace(parser)
    parser.add_argument('--listen', metavar='S', type=positive, default=3.0,
                        help='how long to listen; each node says once a second how it is')
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    with needs_ros():
        from forcecal_ros.nodes.client import node_statuses, temporary_node, WORDS
    from forcecal_ros.core.errors import DataError

    namespace = args.namespace.strip('/')
    with temporary_node('status') as ros:
        found = {name: status for name, status in node_statuses(ros, args.listen).items()
                 if not namespace or name.startswith(f'{namespace}/')}
    if not found:
        raise DataError(f'no node was heard on /diagnostics within {args.listen:g} s; start it '
                        'with the same ROS_DOMAIN_ID and --namespace')
    if args.json:
        print_json({'nodes': {name: {
            'level': WORDS[status.level], 'message': status.message,
            'values': {pair.key: pair.value for pair in status.values}}
            for name, status in found.items()}})
    else:
        for name, status in found.items():
            say(f'{name}: {WORDS[status.level]}: {status.message}')
    return 0
