"""``forcecal simulate``: the rig under recorded commands."""

import argparse
from typing import Any

from forcecal_ros.cli import common


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'simulate', inputs=('commands', 'rig'),
        example='forcecal simulate --commands my_bag -o simulated_bag')
    parser.add_argument('--commands', metavar='BAG', required=True,
                        help='recording whose target_frame is replayed')
    parser.add_argument('--rig', metavar='RIG.yaml',
                        help='rig to simulate: a file, or rig.yaml and rigid_tool.yaml of this '
                             'package (default: rig.yaml)')
    parser.add_argument('--accelerometer', choices=('acc1', 'acc2'),
                        help='mounted accelerometer (default: that of the rig)')
    parser.add_argument('--seed', type=common.whole, default=0, help='seed of the sensor noise')
    parser.add_argument('--noise-free', action='store_true', help='simulate without sensor noise')
    common.add_output(parser, '-o', '--output', kind='recording', metavar='OUT_BAG', required=True)
    common.add_streams(parser)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from dataclasses import replace

    from forcecal_ros.checks.entry import checked
    from forcecal_ros.core.streams import Recording
    from forcecal_ros.core.topics import require
    from forcecal_ros.io.bags import write_recording
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import simulate

    rig = load_rig(args.rig)
    commands = common.read(args, args.commands)
    require(commands, ['target'])
    commands = checked(replace(Recording(), target=commands.target, phases=commands.phases,
                               start_ns=commands.start_ns))
    assert commands.target is not None
    common.warn_if_compiling('simulator')
    simulated = simulate(rig, commands.target, accelerometer=args.accelerometer,
                         noise=not args.noise_free, seed=args.seed)
    write_recording(args.output, replace(
        simulated, phases=commands.phases, start_ns=commands.start_ns))
    samples = {role: len(stream) for role in (
        'wrench', 'accelerometer', 'optidrive', 'pose', 'target', 'contact_truth')
        if (stream := getattr(simulated, role)) is not None}
    seconds = commands.target.t[-1] - commands.target.t[0]
    return common.show(args, {'output': args.output, 'samples': samples},
                       f'{args.output}: {seconds:.1f} s of commands simulated; '
                       + ', '.join(f'{n} {role}' for role, n in samples.items()))
