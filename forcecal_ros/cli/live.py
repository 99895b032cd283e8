"""``forcecal live``: a page that shows what running nodes measure, estimate and do."""

import argparse
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.core.errors import UsageError


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(subparsers, 'live', inputs=('rig',), json=False, quiet=False,
                               example='forcecal live')
    parser.add_argument('--no-sim', action='store_true',
                        help='wait for messages of the robot (default: if no wrench is '
                             'published, a simulated rig and its nodes are started)')
    parser.add_argument('--sim', action='store_true',
                        help='always start a simulated rig, isolated from any robot')
    parser.add_argument('--rig', metavar='RIG.yaml',
                        help='rig to simulate; the gap is its difference from the nominal one')
    common.add_namespace(parser)
    parser.add_argument('--wrench', metavar='TOPIC', type=common.topic_name, default='wrench',
                        help="WrenchStamped of the robot's sensor")
    parser.add_argument('--port', type=common.port, default=8642,
                        help='port of this machine to serve the page on; 0: any free port')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    if args.no_sim and (args.sim or args.rig):
        raise UsageError('--no-sim excludes --sim and --rig; leave one of them out')
    with common.needs_ros():
        from forcecal_ros.nodes.live import LivePage
    from forcecal_ros.sim.rig.file import load_rig

    if args.rig:
        load_rig(args.rig)
    with LivePage(args.port) as page:
        try:
            if args.sim or args.rig or not (args.no_sim or _wrench_is_published(args)):
                return _simulated(args, page)
            return _robot(args, page)
        except KeyboardInterrupt:  # before all is up
            return 0


def _wrench_is_published(args: argparse.Namespace) -> bool:
    """Return whether a node publishes a wrench."""
    from forcecal_ros.nodes.client import temporary_node, until

    place = args.namespace.strip('/')
    with temporary_node('live') as ros:
        name = args.wrench if args.wrench.startswith('/') else f'/{place}/{args.wrench}'
        # time in which a robot that is there is found [s]: some ten times what discovery takes
        return until(ros, lambda: ros.node.count_publishers(name.replace('//', '/')) > 0, 3.0)


def _robot(args: argparse.Namespace, page: Any) -> int:
    """Show what is there; nothing is started."""
    from forcecal_ros.nodes.client import temporary_node
    from forcecal_ros.nodes.live import LiveView

    with temporary_node('live') as ros:
        view = LiveView(ros.node, args.namespace, args.wrench, simulated=False)
        return _show(page, ros, view, f'the robot in namespace /{args.namespace.strip("/")}, '
                     'which this page cannot move', lambda: None)


def _simulated(args: argparse.Namespace, page: Any) -> int:
    """Start the simulated rig and the nodes about it, and show them."""
    import os

    from forcecal_ros.nodes.client import own_domain, Processes, temporary_node
    from forcecal_ros.nodes.demo import FOR_SIMULATION, ON_TIME
    from forcecal_ros.nodes.live import LiveView

    common.warn_if_compiling('simulator', 'observer')
    rig = {'rig': os.path.realpath(args.rig)} if args.rig else {}
    clock = {'use_sim_time': True}
    with own_domain() as environment, temporary_node('live') as ros, \
            Processes(environment) as nodes:
        # latency: time that commands have to arrive in [s], so that a busy computer makes no gap
        # of them
        nodes.start('sim', {**rig, **ON_TIME, 'latency': 0.1})
        nodes.start('observer', {**clock, 'publish.inertial_wrench': True})
        nodes.start('sequencer', dict(FOR_SIMULATION))
        nodes.start('gap', clock)
        view = LiveView(ros.node, '', 'wrench', simulated=True)
        return _show(page, ros, view, f'a simulated rig, {args.rig or "nominal"}, that moves '
                     'when a button below is pressed', nodes.check)


def _show(page: Any, ros: Any, view: Any, robot: str, check: Any) -> int:
    """Serve until a signal."""
    from forcecal_ros.motion.plan import SEQUENCES
    from forcecal_ros.nodes.runtime import SIGNAL_CHECK
    from forcecal_ros.report.page import render_page

    text = render_page('live.html.j2', 'Live', robot=robot, nonce=page.nonce,
                       token=page.token if view.simulated else '', sequences=tuple(SEQUENCES))
    try:
        with page.showing(view, text):
            common.say(f'{page.address} shows {robot}; Ctrl-C ends it')
            while not ros.interrupted:
                check()
                ros.spin(SIGNAL_CHECK)
    finally:
        view.close()
    common.warn('ended' + ', with all nodes that it started' * view.simulated)
    return 0
