"""``forcecal robot``: services of running nodes, and how they are."""

import argparse
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.core.errors import DataError

SERVICES = {
    'start': ('{}/start', 'start the motion of the sequencer, or of the impedance node'),
    'abort': ('{}/abort', 'stop the motion of the sequencer, or of the impedance node'),
    'preview': ('sequencer/preview', 'show what the sequencer would do, without moving'),
    'save': ('sequencer/save_calibration',
             'write the calibration of the sequencer to the file of its parameter save.path'),
    'tare': ('observer/tare',
             'zero the contact wrench at the present reading, at rest without contact'),
    'status': ('', 'show the state of each running node'),
}
"""Service and summary of each verb; a brace is the node that moves the robot."""


def add_parser(subparsers: Any) -> None:
    """Declare the command and its verbs."""
    parser = common.new_parser(subparsers, 'robot', json=False, quiet=False,
                               example='forcecal robot start\n  forcecal robot status')
    verbs = parser.add_subparsers(metavar='VERB', required=True)
    for verb, (service, summary) in SERVICES.items():
        one = common.new_parser(verbs, verb, summary=summary, example=f'forcecal {verb}',
                                quiet=False)
        if '{}' in service:
            one.add_argument('--node', choices=('sequencer', 'impedance'), default='sequencer',
                             help='node that moves the robot')
        common.add_namespace(one)
        one.add_argument('--timeout', metavar='S', type=common.positive,
                         default=10.0 if service else 5.0,
                         help='how long to wait for the node and for its answer' if service else
                         'how long to listen: discovery by DDS may take 3 s, and each '
                         'node reports once a second')
        one.set_defaults(service=service)
    parser.commands = verbs.choices  # type: ignore[attr-defined]


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    return _call(args) if args.service else _status(args)


def _call(args: argparse.Namespace) -> int:
    """Call a service and print its answer."""
    with common.needs_ros():
        from forcecal_ros.nodes.client import ask, temporary_node

    path = f'{args.namespace.strip("/")}/{args.service.format(getattr(args, "node", ""))}'
    service = f'/{path.lstrip("/")}'
    with temporary_node('asking') as ros:
        answer = ask(ros, service, args.timeout)
    if not answer.success:
        raise DataError(f'{service}: {answer.message}')
    return common.show(args, {'service': service, 'message': answer.message}, answer.message)


def _status(args: argparse.Namespace) -> int:
    """Print what the nodes report on /diagnostics."""
    with common.needs_ros():
        from forcecal_ros.nodes.client import node_statuses, temporary_node, WORDS

    namespace = args.namespace.strip('/')
    with temporary_node('status') as ros:
        found = {name: status for name, status in node_statuses(ros, args.timeout).items()
                 if not namespace or name.startswith(f'{namespace}/')}
    if not found:
        raise DataError(f'no node reports on /diagnostics within {args.timeout:g} s; start it '
                        'with the same ROS_DOMAIN_ID and --namespace')
    return common.show(args, {'nodes': {name: {
        'level': WORDS[status.level], 'message': status.message,
        'values': {pair.key: pair.value for pair in status.values}}
        for name, status in found.items()}}, '\n'.join(
            f'{name}: {WORDS[status.level]}: {status.message}' for name, status in found.items()))
