"""``forcecal plan``: a recording sequence that shows every effect of the library."""

import argparse
from typing import Any

from forcecal_ros.commands.common import (
    add_json,
    new_parser,
    print_json,
    say,
    say_if_compiling,
)
from forcecal_ros.commands.outputs import add_output, FILE, stdout_is_taken
from forcecal_ros.commands.progress import add_quiet, stages


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'plan',
        example='forcecal plan --rig rig.yaml -o plan.yaml\n'
                '  ros2 run forcecal_ros sequencer --ros-args --params-file plan.yaml')
    parser.add_argument('--rig', metavar='RIG.yaml',
                        help='rig to plan for: a file, or rig.yaml and rigid_tool.yaml of this '
                             'package (default: rig.yaml)')
    parser.add_argument('--contact', action='store_true',
                        help="touch the rig's wall as well; its effects show in no other way")
    add_output(parser, '-o', '--output', kind=FILE, metavar='PLAN.yaml',
               help='parameters for the sequencer to write, - for standard output')
    add_quiet(parser)
    add_json(parser)
    parser.set_defaults(run=run, inputs=('rig',))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.atomic_files import write_text
    from forcecal_ros.diagnose.plan_file import as_text, to_document, to_parameters
    from forcecal_ros.diagnose.planning import plan_for
    from forcecal_ros.simulators.rig.file import load_rig
    from forcecal_ros.simulators.rig.simulator import waits_for_compiler

    rig = load_rig(args.rig)
    say_if_compiling(waits_for_compiler(), 'the simulator')
    with stages(args) as stage:
        stage('simulating the sequence with every effect')
        planned = plan_for(rig, contact=args.contact)
    if args.output:
        write_text(args.output, to_parameters(planned))
    if args.json:
        print_json(to_document(planned))
    elif not stdout_is_taken(args):
        say(as_text(planned.excitation))
        t = planned.motion.target.t
        say(f'the sequence takes about {t[-1] - t[0]:.0f} s')
        if args.output:
            say(f'written to {args.output}')
    return 0
