"""``forcecal diagnose``: where, why and how far a recording departs from the simulator."""

import argparse
import os
from typing import Any

from forcecal_ros.commands.common import new_parser, say_if_compiling, topic_names
from forcecal_ros.commands.fleet import add_bags, Answer
from forcecal_ros.commands.fleet import run as run_each
from forcecal_ros.commands.outputs import add_output, RESULTS, write_results
from forcecal_ros.commands.progress import stages
from forcecal_ros.errors import UsageError

RIGID = 'rigid_tool.yaml'
"""Whose tolerances a calibrated tool has where no rig is named."""

FILES = ('diagnosis.json', 'report.html', 'rig_patched.yaml', 'calibration_patched.yaml')
"""All that a diagnosis may write."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'diagnose',
        example='forcecal diagnose my_bag --heldout another_bag -o diagnosis')
    add_bags(parser)
    parser.add_argument('--heldout', metavar='BAG',
                        help='second recording, another trajectory, to judge on (default: parts '
                             'of every phase of the first)')
    parser.add_argument('--rig', metavar='RIG.yaml',
                        help='rig to compare with: a file, or rig.yaml and rigid_tool.yaml of '
                             'this package (default: rig.yaml)')
    parser.add_argument('--calibration', metavar='C.yaml',
                        help='what is known of tool and sensors where no commands were recorded: '
                             'the wrench is then compared with the measured motion (default: the '
                             'numbers of the rig)')
    parser.add_argument('--accelerometer', choices=('acc1', 'acc2'),
                        help='which one is mounted (default: recognised by its volts)')
    add_output(parser, '-o', '--output', kind=RESULTS, metavar='DIR', required=True,
               help='folder for diagnosis.json, report.html and rig_patched.yaml (or '
                    'calibration_patched.yaml); results that are there are kept as NAME~; of '
                    'several BAGs, a folder of such folders')
    parser.set_defaults(run=run, inputs=('bag', 'heldout', 'rig', 'calibration'))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    if args.heldout and os.path.realpath(args.heldout) in map(os.path.realpath, args.bag):
        raise UsageError(f'--heldout: {args.heldout} cannot judge what is fitted to it; leave it '
                         'out, and parts of every phase are held out')
    return run_each(args, answer)


def answer(args: argparse.Namespace) -> Answer:
    """Diagnose one recording."""
    from forcecal_ros.calibration.file import load
    from forcecal_ros.recording.bags import read_recording
    from forcecal_ros.simulators.rig.file import load_rig

    calibration = load(args.calibration) if args.calibration else None
    rig = load_rig(args.rig or (RIGID if calibration else None))
    with stages(args) as stage:
        stage(f'reading {args.bag}')
        recording, *more = (
            read_recording(bag, topics=topic_names(args), wrench_sign=args.wrench_sign)
            for bag in (args.bag, args.heldout) if bag is not None)
        heldout = more[0] if more else None
        if calibration or not recording.target:
            stage('comparing the wrench with the measured motion')
            return _by_motion(args, recording, heldout, rig, calibration)
        stage('replaying the commands and weighing effects')
        return _by_commands(args, recording, heldout, rig)


def _by_commands(args: argparse.Namespace, recording: Any, heldout: Any, rig: Any) -> Answer:
    """Replay the commands through the rig."""
    from forcecal_ros.diagnose.advice import advice
    from forcecal_ros.diagnose.channels import units
    from forcecal_ros.diagnose.pipeline import diagnose
    from forcecal_ros.diagnose.result import to_document
    from forcecal_ros.report.diagnosis import render
    from forcecal_ros.report.diagnosis_view import view_of, view_without_signals
    from forcecal_ros.simulators.rig.file import dump_rig
    from forcecal_ros.simulators.rig.simulator import waits_for_compiler

    say_if_compiling(waits_for_compiler(), 'the simulator')
    outcome = _with_model(args, diagnose(recording, heldout, rig, args.accelerometer))
    answered = outcome.diagnosis.verdict != 'invalid_data'
    document = to_document(outcome.diagnosis, units(),
                           'rig_patched.yaml' if answered else None)
    view = (view_of(outcome, advice(outcome.diagnosis, rig), units()) if answered
            else view_without_signals(outcome.diagnosis))
    files = {'report.html': render(view)}
    if answered:
        files['rig_patched.yaml'] = dump_rig(outcome.rig)
    return _written(args, recording, outcome.diagnosis, document, files)


def _by_motion(args: argparse.Namespace, recording: Any, heldout: Any, rig: Any,
               calibration: Any) -> Answer:
    """Compare the wrench with the measured motion."""
    from forcecal_ros.calibration.file import dump
    from forcecal_ros.diagnose.advice import advice
    from forcecal_ros.diagnose.body import body_of_calibration, body_of_rig, patched
    from forcecal_ros.diagnose.by_motion import delay_std, diagnose_motion
    from forcecal_ros.diagnose.channels import units
    from forcecal_ros.diagnose.result import to_document
    from forcecal_ros.report.diagnosis import render
    from forcecal_ros.report.diagnosis_view import view_of, view_without_signals

    body = body_of_calibration(calibration, rig) if calibration else body_of_rig(rig)
    outcome = _with_model(args, diagnose_motion(
        _level(recording, calibration), _level(heldout, calibration), body, calibration,
        args.accelerometer))
    of_channels = units(body.accelerometer_unit)
    view = (view_of(outcome, advice(outcome.diagnosis, rig), of_channels) if outcome.cases
            else view_without_signals(outcome.diagnosis))
    files = {'report.html': render(view)}
    document = to_document(outcome.diagnosis, of_channels, None)
    document['explained_by'] = 'measured motion'
    if calibration and outcome.cases:
        document['calibration'] = 'calibration_patched.yaml'
        files[document['calibration']] = dump(patched(calibration, outcome.rig,
                                                      delay_std(outcome)))
    return _written(args, recording, outcome.diagnosis, document, files)


def _level(recording: Any, calibration: Any) -> Any:
    """Bring a recording to a base that is level."""
    from forcecal_ros.recording.level import levelled

    if recording is None or calibration is None:
        return recording
    return levelled(recording, calibration.gravity_direction)


def _with_model(args: argparse.Namespace, outcome: Any) -> Any:
    """Say in the notes what was compared with where nobody chose it."""
    from dataclasses import replace

    if args.rig or args.calibration:
        return outcome
    return replace(outcome, diagnosis=replace(outcome.diagnosis, notes=(
        ("compared with this package's simulated rig (rig.yaml), as no --rig and no --calibration "
         'was given'), *outcome.diagnosis.notes)))


def _written(args: argparse.Namespace, recording: Any, diagnosis: Any,
             document: dict[str, Any], files: dict[str, str]) -> Answer:
    import json

    folder = args.output
    write_results(folder, {
        'diagnosis.json': json.dumps(document, indent=2, allow_nan=False) + '\n', **files}, FILES)
    verdict = f'{diagnosis.verdict}: {diagnosis.reason}'
    return Answer(document, f'{verdict}\nwritten to {folder}', verdict,
                  (*recording.notes, *diagnosis.notes),
                  1 if diagnosis.verdict == 'invalid_data' else 0)
