"""``forcecal export``: a calibration for other packages."""

import argparse
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.core.errors import UsageError

USED_BY = {'--node': ('broadcaster', 'gravity_filter', 'admittance'),
             '--base-frame': ('gravity_filter', 'admittance'), '--sensor-in-flange': ('ur',)}
"""Option -> consumers that use it."""

BASE = 'base_link'


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'export', inputs=('calibration',), json=False, quiet=False,
        example='forcecal export calibration.yaml --for broadcaster -o broadcaster.yaml')
    parser.add_argument('calibration', metavar='CALIBRATION', help='calibration.yaml')
    parser.add_argument('--for', dest='consumer', required=True, choices=(
        'broadcaster', 'gravity_filter', 'admittance', 'ur', 'kth', 'ft_tools'),
        help='force_torque_sensor_broadcaster, GravityCompensation of control_filters, '
             'admittance_controller, payload of a Universal Robot, force_torque_tools of KTH, '
             'ft_tools_ros2')
    parser.add_argument('--node', metavar='NAME', type=common.node,
                        help='name of the node that receives the parameters (default: its usual '
                             'name)')
    parser.add_argument('--base-frame', metavar='FRAME', type=common.frame, default=BASE,
                        help='frame whose z points up')
    parser.add_argument('--sensor-in-flange', metavar=common.POSE7, nargs=7, type=common.real,
                        help='ur: pose of the sensor in the flange [m, quaternion] (default: '
                             'identity)')
    common.add_output(parser, '-o', '--output', kind='file', metavar='FILE',
                      help='file to write (default: print)')


def refuse_unused(args: argparse.Namespace) -> None:
    """Refuse options that the consumer does not use, and a quaternion of zeros."""
    given = {'--node': args.node, '--base-frame': args.base_frame != BASE,
             '--sensor-in-flange': args.sensor_in_flange}
    for option, consumers in USED_BY.items():
        if given[option] and args.consumer not in consumers:
            raise UsageError(f'{option} is not used by {args.consumer}, only by '
                             f'{", ".join(consumers)}; leave it out')
    if args.sensor_in_flange and not any(args.sensor_in_flange[3:]):
        raise UsageError('--sensor-in-flange: a quaternion of zeros is not a rotation; give x y z '
                         '[m] and qx qy qz qw, or 0 0 0 1 if the axes coincide')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.core.files import write_text
    from forcecal_ros.core.geometry import matrix_from_quaternion
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.io.exports import export, Place
    import numpy as np

    refuse_unused(args)
    place = np.array(args.sensor_in_flange or (0, 0, 0, 0, 0, 0, 1))
    text = export(load(args.calibration), args.consumer, Place(
        args.node or '', args.base_frame, matrix_from_quaternion(place[3:]), place[:3]))
    if args.output:
        write_text(args.output, text)
        if not common.stdout_is_taken(args):
            common.say(f'written to {args.output}')
    else:
        print(text, end='')
    return 0
