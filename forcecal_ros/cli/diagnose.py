"""``forcecal diagnose``: where, why and how far a recording departs from the simulator."""

import argparse
import os
import shlex
from typing import Any

from forcecal_ros.cli.common import (
    add_sensor_pose,
    add_topics,
    new_parser,
    read_likewise,
    read_poses_of_sensor,
    say_if_compiling,
    topic_names,
)
from forcecal_ros.cli.each_recording import add_bags, Answer
from forcecal_ros.cli.each_recording import run as run_each
from forcecal_ros.cli.outputs import add_output, RESULTS, write_results
from forcecal_ros.cli.progress import stages
from forcecal_ros.cli.simulators import add_simulators, check_simulators, simulator_of
from forcecal_ros.core.errors import UsageError

RIGID = 'rigid_tool.yaml'
"""Whose tolerances a calibrated tool has where no rig is named."""

NOMINAL = "this package's rig.yaml, nominal"

ASSUMED = ('nothing says what was recorded, so it is compared with the rig that this package '
           'simulates; if it is another robot, calibrate its tool (forcecal calibrate) and give '
           '--calibration')

UNLIKE = ('unknown', 'partial')
"""Verdicts after which it matters that nobody named what was recorded."""

SIMULATORS = ('simulator', 'mujoco', 'simulated')
"""Options that name a simulator of the user's."""

FILES = ('diagnosis.json', 'report.html', 'rig_patched.yaml', 'calibration_patched.yaml',
         'model_patched.xml')
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
    parser.add_argument('--simulated', metavar='SIM_BAG',
                        help='what your own simulator recorded of the same commands, wrench and '
                             'current_pose; command target_frame, too, if the robot is late')
    parser.add_argument('--heldout-simulated', metavar='SIM_BAG2',
                        help='what it recorded of the commands of --heldout')
    parser.add_argument('--simulated-wrench-sign', type=int, choices=(1, -1), default=1,
                        help="-1: the simulator's wrench points the other way, as MuJoCo's")
    add_topics(parser, '--simulated-topic', " of the simulator's")
    add_sensor_pose(parser, '--simulated-sensor-from-pose', ' in the simulator')
    add_simulators(parser)
    parser.add_argument('--accelerometer', choices=('acc1', 'acc2'),
                        help='which one is mounted (default: recognised by its volts)')
    parser.add_argument('--robot', metavar='NAME',
                        help='whose recording it is, kept in diagnosis.json for forcecal fleet')
    add_output(parser, '-o', '--output', kind=RESULTS, metavar='DIR', required=True,
               help='folder for diagnosis.json, report.html and rig_patched.yaml (or '
                    'calibration_patched.yaml, or model_patched.xml); earlier results are '
                    'kept as NAME~; of several BAGs, a folder of such folders')
    parser.set_defaults(run=run, inputs=('bag', 'heldout', 'rig', 'calibration', 'simulated',
                                         'heldout_simulated', 'mujoco', 'priors'))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    if args.heldout and os.path.realpath(args.heldout) in map(os.path.realpath, args.bag):
        raise UsageError(f'--heldout: {args.heldout} cannot judge what is fitted to it; leave it '
                         'out, and parts of every phase are held out')
    check_simulators(args)
    _check_one_model(args)
    if args.simulated:
        _check_pairs(args)
    elif args.heldout_simulated:
        raise UsageError('--heldout-simulated wants --simulated, too: what the simulator recorded '
                         'of the first commands')
    elif args.simulated_topic or args.simulated_sensor_from_pose:
        raise UsageError('--simulated-topic and --simulated-sensor-from-pose want --simulated, '
                         'too')
    return run_each(args, answer)


def _check_one_model(args: argparse.Namespace) -> None:
    """Refuse a simulator of the user's beside another model, or with several recordings."""
    named = [name for name in (*SIMULATORS, 'rig', 'calibration') if getattr(args, name)]
    if not named or named[0] not in SIMULATORS:
        return
    if len(named) > 1:
        raise UsageError(f'--{named[0]} and --{named[1]} exclude each other: one model at a time')
    if len(args.bag) > 1:
        raise UsageError(f'--{named[0]} goes with exactly one BAG; diagnose one after the other')


def _check_pairs(args: argparse.Namespace) -> None:
    """Refuse what makes no pairs of the robot's recordings and the simulator's."""
    topic_names(args, '--simulated-topic')
    if bool(args.heldout) != bool(args.heldout_simulated):
        missing = '--heldout' if args.heldout_simulated else '--heldout-simulated'
        raise UsageError(f'--heldout and --heldout-simulated go together; give {missing} as well')
    given = [path for path in (*args.bag, args.heldout, args.simulated, args.heldout_simulated)
             if path]
    if len(set(map(os.path.realpath, given))) < len(given):
        raise UsageError("--simulated: one bag is given twice; name the robot's and the "
                         "simulator's")


def answer(args: argparse.Namespace) -> Answer:
    """Diagnose one recording."""
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.sim.rig.file import load_rig

    if args.simulator or args.mujoco:
        return _by_simulator(args)
    if args.simulated:
        return _by_simulated(args)
    calibration = load(args.calibration) if args.calibration else None
    rig = load_rig(args.rig or (RIGID if calibration else None))
    with stages(args) as stage:
        stage(f'reading {args.bag}')
        recording, heldout = _read(args)
        if calibration or not recording.target:
            stage('comparing the wrench with the measured motion')
            return _by_motion(args, recording, heldout, rig, calibration)
        stage('replaying the commands and weighing effects')
        return _by_commands(args, recording, heldout, rig)


def _read(args: argparse.Namespace, joints: bool = False) -> tuple[Any, Any]:
    """Return the recording, and the one to judge on if there is one."""
    return (read_poses_of_sensor(args, args.bag, joints=joints),
            read_poses_of_sensor(args, args.heldout, joints=joints) if args.heldout else None)


def _by_commands(args: argparse.Namespace, recording: Any, heldout: Any, rig: Any) -> Answer:
    """Replay the commands through the rig."""
    from forcecal_ros.diagnose.by_commands import diagnose
    from forcecal_ros.diagnose.by_tracked import diagnose_tracked, is_tracked
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.result import to_document
    from forcecal_ros.sim.rig.file import dump_rig
    from forcecal_ros.sim.rig.simulator import waits_for_compiler

    say_if_compiling(waits_for_compiler(), 'the simulator')
    by = diagnose_tracked if is_tracked(rig) else diagnose
    outcome = by(recording, heldout, rig, args.accelerometer)
    files = {'rig_patched.yaml': dump_rig(outcome.rig)} if outcome.datasets else {}
    document = to_document(outcome.diagnosis, units(), next(iter(files), None))
    return _written(args, (recording, heldout), outcome, rig, units(), document, files)


def _by_motion(args: argparse.Namespace, recording: Any, heldout: Any, rig: Any,
               calibration: Any) -> Answer:
    """Compare the wrench with the measured motion."""
    from forcecal_ros.diagnose.by_motion import delay_std, diagnose_motion, inertia_std
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.patched import patched_calibration
    from forcecal_ros.diagnose.say.result import to_document
    from forcecal_ros.io.calibration_file import dump
    from forcecal_ros.sim.rigid_tool import (
        rigid_tool_of_calibration,
        rigid_tool_of_rig,
        RigidTool,
    )

    rigid_tool = (rigid_tool_of_calibration(calibration, rig) if calibration
                  else rigid_tool_of_rig(rig))
    outcome = diagnose_motion(
        _as_calibrated(args, recording, calibration), _as_calibrated(args, heldout, calibration),
        rigid_tool, calibration, args.accelerometer)
    of_channels = units(rigid_tool.accelerometer_unit)
    files = {}
    document = to_document(outcome.diagnosis, of_channels, None)
    document['explained_by'] = 'measured motion'
    if calibration and outcome.datasets:
        assert isinstance(outcome.rig, RigidTool)
        document['calibration'] = 'calibration_patched.yaml'
        files[document['calibration']] = dump(patched_calibration(
            calibration, outcome.rig, delay_std(outcome), inertia_std(outcome)))
    return _written(args, (recording, heldout), outcome, rig, of_channels, document, files)


def _by_simulated(args: argparse.Namespace) -> Answer:
    """Compare the wrench with what a simulator recorded."""
    from forcecal_ros.diagnose.by_simulated import diagnose_simulated, Pair
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.result import to_document
    from forcecal_ros.sim.rig.file import load_rig

    with stages(args) as stage:
        def read(bag: str, of: str, sign: int) -> Any:
            stage(f'reading {bag}')
            return read_poses_of_sensor(args, bag, f'--{of}sensor-from-pose', f'--{of}topic', sign)

        pairs = [Pair(read(real, '', args.wrench_sign or 1),
                      read(simulated, 'simulated-', args.simulated_wrench_sign))
                 for real, simulated in ((args.bag, args.simulated),
                                         (args.heldout, args.heldout_simulated)) if real]
        stage('comparing the wrench with the simulated')
        rig, of_channels = load_rig(RIGID), units('m/s^2')
        found = diagnose_simulated(pairs[0], pairs[1] if len(pairs) > 1 else None, rig)
        document = to_document(found.outcome.diagnosis, of_channels, None)
        document |= {'explained_by': 'simulated recording', **found.document()}
        return _written(args, tuple(pair.real for pair in pairs), found.outcome, rig,
                        of_channels, document, {})


def _by_simulator(args: argparse.Namespace) -> Answer:
    """Run somebody's simulator with the recorded commands."""
    from forcecal_ros.diagnose.by_simulator import diagnose_rerun
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.result import to_document
    from forcecal_ros.sim.rig.file import load_rig

    with stages(args) as stage:
        simulator = simulator_of(args)
        stage(f'reading {args.bag}')
        recording, heldout = _read(args, joints=True)
        stage(f'running {simulator.name} with other numbers')
        rig, of_channels = load_rig(RIGID), units('m/s^2')
        found = diagnose_rerun(recording, heldout, simulator, rig)
        document = to_document(found.outcome.diagnosis, of_channels, None)
        document |= {'explained_by': simulator.name, **found.document()}
        text = simulator.patched(found.numbers) if found.changed else None
        files = {} if text is None else {'model_patched.xml': text}
        document['model'] = next(iter(files), None)
        answer = _written(args, (recording, heldout), found.outcome, rig, of_channels, document,
                          files)
        told = [f'change {one}' for one in found.changed]
        return answer._replace(text='\n'.join([answer.text, *told]))


def _as_calibrated(args: argparse.Namespace, recording: Any, calibration: Any) -> Any:
    """Bring poses to ft_sensor, base to level and readings to their axes, as calibrated."""
    from forcecal_ros.cli.contact import in_sign_of
    from forcecal_ros.core.axes import in_axes_of_pose, levelled
    from forcecal_ros.observe.frames import taken_as_calibrated

    if recording is None or calibration is None:
        return recording
    taken = in_sign_of(calibration, args.wrench_sign, taken_as_calibrated(
        recording, calibration, args.calibration))
    return in_axes_of_pose(levelled(taken, calibration.gravity_direction),
                           calibration.sensor_rotation)


def _named(args: argparse.Namespace) -> str:
    """Return the models that the user named, or nothing."""
    return ' and '.join(filter(None, (
        args.simulator, args.mujoco, args.simulated, args.heldout_simulated, args.calibration,
        args.rig)))


def _name_it(args: argparse.Namespace) -> Any:
    """Say what to do where a recording is unlike the rig that nobody named."""
    from forcecal_ros.report.words import Step

    return Step('Name the tool that was recorded (forcecal calibrate makes the file), and '
                'diagnose again:', shlex.join((
                    'forcecal', 'diagnose', args.bag, '--calibration', 'calibration.yaml',
                    *read_likewise(args), '-o', args.output)))


def _source(args: argparse.Namespace, recording: Any) -> dict[str, str]:
    """Say whose recording it was, and when it was made and diagnosed."""
    from datetime import datetime, timezone

    made = {} if recording.start_ns <= 0 else {'recorded': datetime.fromtimestamp(
        recording.start_ns // 10**9, timezone.utc).isoformat()}
    return {'recording': recording.source, **({'robot': args.robot} if args.robot else {}), **made,
            'created': datetime.now(timezone.utc).isoformat(timespec='seconds')}


def _written(args: argparse.Namespace, given: tuple[Any, ...], outcome: Any, rig: Any,
             of_channels: dict[str, str], document: dict[str, Any], files: dict[str, str]
             ) -> Answer:
    """Write what was found, a report of it, and other files."""
    import json

    from forcecal_ros.diagnose.say.advice import advice
    from forcecal_ros.report.diagnosis import render
    from forcecal_ros.report.diagnosis_view import view_of, view_without_signals
    from forcecal_ros.report.diagnosis_words import headline, next_step
    from forcecal_ros.report.words import origin

    diagnosis, folder = outcome.diagnosis, args.output
    recordings, named = [one for one in given if one is not None], _named(args)
    assumed = () if named else (ASSUMED,)
    document['notes'] = [*assumed, *document['notes']]
    document['source'] = _source(args, recordings[0])
    view = (view_of(outcome, advice(diagnosis, rig), of_channels) if outcome.datasets
            else view_without_signals(diagnosis))
    step = (_name_it(args) if assumed and diagnosis.verdict in UNLIKE
            else next_step(diagnosis, args.bag, folder, tuple(files), view.advice,
                            read_likewise(args)))
    write_results(folder, {
        'diagnosis.json': json.dumps(document, indent=2, allow_nan=False) + '\n',
        'report.html': render(
            view, [*origin(recordings), f'compared with {named or NOMINAL}'], step),
        **files}, FILES)
    verdict = f'{diagnosis.verdict}: {diagnosis.reason}'
    said = headline(diagnosis)
    text = '\n'.join((verdict, *((said,) if diagnosis.effects else ()),
                      f'next: {step.words} {step.command}'.rstrip(), f'written to {folder}'))
    return Answer(document, text, verdict,
                  (*assumed, *recordings[0].notes, *diagnosis.notes),
                  1 if diagnosis.verdict == 'invalid_data' else 0)
