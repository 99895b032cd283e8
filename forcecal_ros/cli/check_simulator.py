"""``forcecal check-simulator``: whether somebody's simulator can be compared with a robot."""

import argparse
import shlex
from typing import Any

from forcecal_ros.cli.common import (
    add_json,
    add_sensor_pose,
    add_topics,
    new_parser,
    print_json,
    read_likewise,
    read_poses_of_sensor,
    say,
)
from forcecal_ros.cli.simulators import (
    add_simulators,
    check_simulators,
    simulator_of,
)
from forcecal_ros.core.errors import UsageError


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'check-simulator',
        example='forcecal check-simulator my_bag --simulator my_robot:make')
    parser.add_argument('bag', metavar='BAG', help='recording whose commands it is run with')
    add_simulators(parser)
    add_topics(parser)
    add_sensor_pose(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.diagnose.conformance import conformance
    from forcecal_ros.sim.rig.file import load_rig

    check_simulators(args)
    if not (args.simulator or args.mujoco):
        raise UsageError('name what is to be checked: --simulator MODULE:FACTORY or --mujoco '
                         'MODEL.xml')
    found = conformance(simulator_of(args), read_poses_of_sensor(args, args.bag, joints=True),
                        load_rig('rigid_tool.yaml'))
    if args.json:
        print_json(found.document())
    else:
        say(str(found))
        say(f'next: {_next(args)}')
    return 0


def _next(args: argparse.Namespace) -> str:
    """Return the command that diagnoses with the simulator that was checked."""
    named = [word for name in ('simulator', 'mujoco', 'imu', 'ft_site', 'priors')
             if (value := getattr(args, name))
             for word in (f'--{name.replace("_", "-")}', value)]
    return shlex.join(('forcecal', 'diagnose', args.bag, *named,
                       *read_likewise(args), '-o', 'why'))
