"""``forcecal diagnose``: where, why and how far a recording departs from the simulator."""

import argparse
from typing import Any

from forcecal_ros.commands.common import new_parser, say_if_compiling, topic_names
from forcecal_ros.commands.fleet import add_bags, Answer
from forcecal_ros.commands.fleet import run as run_each


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'diagnose',
        summary='find where and why a recording departs from the simulator, and how far the gap '
                'shrinks',
        example='forcecal diagnose my_bag --heldout another_bag -o diagnosis')
    add_bags(parser)
    parser.add_argument('--heldout', metavar='BAG',
                        help='second recording, another trajectory, to judge on (default: parts '
                             'of every phase of the first)')
    parser.add_argument('--rig', metavar='RIG.yaml',
                        help='rig to compare with: a file, or rig.yaml and rigid_tool.yaml of '
                             'this package (default: rig.yaml)')
    parser.add_argument('--accelerometer', choices=('acc1', 'acc2'),
                        help='which one is mounted (default: recognised by its volts)')
    parser.add_argument('-o', '--output', metavar='DIR', required=True,
                        help='folder for diagnosis.json, rig_patched.yaml and report.html; of '
                             'several BAGs, a folder of such folders')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    return run_each(args, answer, {'output': ''}, ['heldout', 'rig'])


def answer(args: argparse.Namespace) -> Answer:
    """Diagnose one recording."""
    import json
    from pathlib import Path

    from forcecal_ros.bags import read_recording
    from forcecal_ros.diagnose.channels import CHANNELS
    from forcecal_ros.diagnose.pipeline import diagnose
    from forcecal_ros.diagnose.result import to_document
    from forcecal_ros.files import write_text
    from forcecal_ros.report.diagnosis import render
    from forcecal_ros.sim.rig_file import dump_rig, load_rig
    from forcecal_ros.sim.simulator import waits_for_compiler

    rig = load_rig(args.rig)
    recording, *more = (
        read_recording(bag, topics=topic_names(args), wrench_sign=args.wrench_sign)
        for bag in (args.bag, args.heldout) if bag is not None)
    say_if_compiling(waits_for_compiler(), 'the simulator')
    outcome = diagnose(recording, more[0] if more else None, rig, args.accelerometer)
    diagnosis, folder = outcome.diagnosis, Path(args.output)
    answered = diagnosis.verdict != 'invalid_data'
    document = to_document(diagnosis, {c.name: c.unit for c in CHANNELS},
                           'rig_patched.yaml' if answered else None)
    write_text(folder / 'diagnosis.json', json.dumps(document, indent=2, allow_nan=False) + '\n')
    if answered:
        write_text(folder / 'rig_patched.yaml', dump_rig(outcome.rig))
        write_text(folder / 'report.html', render(outcome))
    verdict = f'{diagnosis.verdict}: {diagnosis.reason}'
    return Answer(document, f'{verdict}\nwritten to {folder}', verdict,
                  (*recording.notes, *diagnosis.notes), 0 if answered else 1)
