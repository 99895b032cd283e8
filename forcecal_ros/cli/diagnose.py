"""``forcecal diagnose``: where, why and how far a recording departs from the simulator."""

import argparse
import os
import shlex
from typing import Any, NamedTuple

from forcecal_ros.cli.common import (
    add_sensor_pose,
    add_topics,
    group,
    MODEL,
    new_parser,
    read,
    read_likewise,
    show,
    stages,
    topic_names,
    warn_if_compiling,
)
from forcecal_ros.cli.many import add_bags, Answer
from forcecal_ros.cli.many import run as run_each
from forcecal_ros.cli.outputs import add_output, RESULTS
from forcecal_ros.core.errors import UsageError
from forcecal_ros.core.files import write_results

RIGID = 'rigid_tool.yaml'
"""Gives the tolerances of a calibrated tool if no rig is named."""

NOMINAL = "this package's rig.yaml, nominal"

ASSUMED = ('nothing says what was recorded, so it is compared with the rig that this package '
           'simulates; if it is another robot, calibrate its tool (forcecal calibrate) and give '
           '--calibration')

UNLIKE = ('unknown', 'partial')
"""Verdicts after which it matters that the recorded robot was not named."""

SIMULATORS = ('simulator', 'mujoco', 'simulated')
"""Options that name a simulator of the user's."""

FILES = ('diagnosis.json', 'report.html', 'rig_patched.yaml', 'calibration_patched.yaml',
         'model_patched.xml')
"""All that a diagnosis may write."""

FOUND = 3
"""Exit status if what ``--fail-on`` names was found."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'diagnose',
        example='forcecal diagnose my_bag --heldout another_bag -o diagnosis\n'
                '  forcecal diagnose my_bag --mujoco arm.xml --check   # can it be compared?')
    add_bags(parser)
    parser.add_argument('--check', action='store_true',
                        help='only check whether --simulator or --mujoco can be compared with a '
                             'robot; nothing is written')
    parser.add_argument('--fail-on', choices=('gap',),
                        help='gap: exit with status 3 for every verdict but no_gap')
    recording = group(parser, 'recording')
    recording.add_argument('--heldout', metavar='BAG',
                           help='second recording, another trajectory, to judge on (default: '
                                'parts of every phase of the first)')
    recording.add_argument('--accelerometer', choices=('acc1', 'acc2'),
                           help='which one is mounted (default: recognised by its volts)')
    recording.add_argument('--robot', metavar='NAME',
                           help='name of the robot, kept in diagnosis.json for forcecal fleet')
    model = group(parser, MODEL)
    model.add_argument('--rig', metavar='RIG.yaml',
                       help='rig to compare with: a file, or rig.yaml and rigid_tool.yaml of '
                            'this package (default: rig.yaml)')
    model.add_argument('--calibration', metavar='C.yaml',
                       help='what is known of tool and sensors: the wrench is then compared with '
                            'the measured motion (default: the numbers of the rig)')
    model.add_argument('--simulated', metavar='SIM_BAG',
                       help='what your own simulator recorded of the same commands, wrench and '
                            'current_pose; command target_frame, too, if the robot is late')
    model.add_argument('--heldout-simulated', metavar='SIM_BAG2',
                       help='what it recorded of the commands of --heldout')
    model.add_argument('--simulated-wrench-sign', type=int, choices=(1, -1), default=1,
                       help="-1: the simulator's wrench has the opposite sign, as MuJoCo's")
    add_topics(parser, '--simulated-topic', " of the simulator's")
    add_sensor_pose(parser, '--simulated-sensor-from-pose', ' in the simulator')
    model.add_argument('--simulator', metavar='MODULE:FACTORY',
                       help='your own simulator, which is run with the recorded commands: a '
                            'function without arguments that returns an object with '
                            'parameters() and simulate(inputs, parameters); its code is '
                            'executed')
    model.add_argument('--mujoco', metavar='MODEL.xml',
                       help='your robot as an MJCF, which MuJoCo runs with the recorded commands '
                            'of its joints')
    model.add_argument('--ft-site', metavar='NAME',
                       help="with --mujoco: site of the model's force-torque sensor (default: "
                            'that of its only force sensor)')
    model.add_argument('--imu', metavar='NAME',
                       help="with --mujoco: site of the model's accelerometer, on the tool "
                            '(default: it is not compared)')
    model.add_argument('--priors', metavar='FILE.yaml',
                       help="how well the simulator's parameters are known, lines of NAME: SIGMA "
                            "(1 sigma, in the parameter's unit)")
    add_output(parser, '-o', '--output', kind=RESULTS, metavar='DIR', default='diagnosis',
               help='folder for diagnosis.json, report.html and rig_patched.yaml (or '
                    'calibration_patched.yaml, or model_patched.xml); earlier results are '
                    'kept as NAME~; of several BAGs, a folder of such folders')
    parser.set_defaults(run=run, inputs=('bag', 'heldout', 'rig', 'calibration', 'simulated',
                                         'heldout_simulated', 'mujoco', 'priors'))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    _check_models(args)
    if args.check:
        return _check_simulator(args)
    return run_each(args, answer)


def _check_models(args: argparse.Namespace) -> None:
    """Refuse options that contradict each other, or lack another."""
    if args.heldout and os.path.realpath(args.heldout) in map(os.path.realpath, args.bag):
        raise UsageError(f'--heldout: {args.heldout} cannot judge what is fitted to it; leave it '
                         'out, and parts of every phase are held out')
    for option, given in (('--ft-site', args.ft_site), ('--imu', args.imu)):
        if given and not args.mujoco:
            raise UsageError(f'{option} requires --mujoco: it names a site of that model')
    if args.priors and not (args.mujoco or args.simulator):
        raise UsageError('--priors requires --mujoco or --simulator, whose parameters they are of')
    if args.check and (not (args.simulator or args.mujoco) or len(args.bag) > 1):
        raise UsageError('--check requires one BAG and what is to be checked: --simulator '
                         'MODULE:FACTORY or --mujoco MODEL.xml')
    named = [name for name in (*SIMULATORS, 'rig', 'calibration') if getattr(args, name)]
    if named and named[0] in SIMULATORS:
        if len(named) > 1:
            raise UsageError(f'--{named[0]} and --{named[1]} exclude each other: one model at a '
                             'time')
        if len(args.bag) > 1:
            raise UsageError(f'--{named[0]} goes with exactly one BAG; diagnose one after the '
                             'other')
    if args.simulated:
        topic_names(args, '--simulated-topic')
        if bool(args.heldout) != bool(args.heldout_simulated):
            missing = '--heldout' if args.heldout_simulated else '--heldout-simulated'
            raise UsageError('--heldout and --heldout-simulated go together; give '
                             f'{missing} as well')
        given = [path for path in (*args.bag, args.heldout, args.simulated,
                                   args.heldout_simulated) if path]
        if len(set(map(os.path.realpath, given))) < len(given):
            raise UsageError("--simulated: one bag is given twice; name the robot's and the "
                             "simulator's")
    elif args.heldout_simulated or args.simulated_topic or args.simulated_sensor_from_pose:
        raise UsageError('--heldout-simulated, --simulated-topic and '
                         '--simulated-sensor-from-pose require --simulated, too: what the '
                         'simulator recorded of the commands of BAG')


def _simulator_of(args: argparse.Namespace) -> Any:
    """Load the simulator of the arguments."""
    from forcecal_ros.sim.mujoco import load_mujoco
    from forcecal_ros.sim.third_party import load_simulator, third_party, with_priors

    if args.mujoco:
        found = third_party(args.mujoco, load_mujoco(args.mujoco, args.ft_site, args.imu))
    else:
        found = load_simulator(args.simulator)
    return with_priors(found, args.priors) if args.priors else found


def _check_simulator(args: argparse.Namespace) -> int:
    """Print whether a simulator can be compared with a robot, and the command that does it."""
    from forcecal_ros.diagnose.conformance import conformance
    from forcecal_ros.sim.rig.file import load_rig

    found = conformance(_simulator_of(args), read(args, args.bag[0], joints=True),
                        load_rig(RIGID))
    named = [word for name in ('simulator', 'mujoco', 'imu', 'ft_site', 'priors')
             if (value := getattr(args, name))
             for word in (f'--{name.replace("_", "-")}', value)]
    command = shlex.join(('forcecal', 'diagnose', args.bag[0], *named, *read_likewise(args), '-o',
                          args.output))
    show(args, found.document(), f'{found}\nnext: {command}')
    return 0


class Found(NamedTuple):
    """
    A diagnosis with what is written of it.

    Attributes
    ----------
    outcome : Outcome
    rig : Rig
        Gave the tolerances.
    units : dict of str to str
        Of the channels.
    document : dict
        ``diagnosis.json``.
    files : dict of str to str
        Further files: a rig, calibration or model with what was found.
    changes : tuple of str
        Parameters of a simulator to change.
    """

    outcome: Any
    rig: Any
    units: dict[str, str]
    document: dict[str, Any]
    files: dict[str, str]
    changes: tuple[str, ...] = ()


def compare(recording: Any, heldout: Any, against: Any, *, rig: Any = None,
            accelerometer: str | None = None, about: str = 'the calibration',
            wrench_sign: int | None = None) -> Found:
    """
    Compare a recording with a model, whatever that is.

    Parameters
    ----------
    recording, heldout : Recording
        To fit on, and to judge on (or None).
    against : Rig, Calibration, pair of Recording, ThirdParty or None
        A rig is simulated under the commands, or without commands taken along the measured
        motion, as the tool of a calibration is; a pair was recorded by a simulator under the
        commands of ``recording`` and ``heldout``; a simulator is run. None: the nominal rig.
    rig : Rig, optional
        Gives the tolerances (default: that of a rigid tool).
    about : str
        Name of the calibration, for messages.
    wrench_sign : int, optional
        Of the recording, if it was stated.
    """
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.sim.rig.file import load_rig

    if isinstance(against, tuple) and not hasattr(against, 'servo'):
        return _with_simulated(recording, heldout, against, rig or load_rig(RIGID))
    if isinstance(against, Calibration):
        recording, heldout = (_as_calibrated(one, against, about, wrench_sign)
                              for one in (recording, heldout))
        return _along_motion(recording, heldout, rig or load_rig(RIGID), against, accelerometer)
    if against is None or hasattr(against, 'servo'):
        against = against or load_rig()
        along = _with_commands if recording.target else _along_motion
        return along(recording, heldout, against, None, accelerometer)
    return _with_simulator(recording, heldout, against, rig or load_rig(RIGID))


def _with_commands(recording: Any, heldout: Any, rig: Any, calibration: None,
                   accelerometer: str | None) -> Found:
    """Simulate the rig under the commands."""
    from forcecal_ros.diagnose.by_commands import diagnose
    from forcecal_ros.diagnose.by_tracked import diagnose_tracked, is_tracked
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.result import to_document
    from forcecal_ros.sim.rig.file import dump_rig

    by = diagnose_tracked if is_tracked(rig) else diagnose
    outcome = by(recording, heldout, rig, accelerometer)
    files = {'rig_patched.yaml': dump_rig(outcome.rig)} if outcome.datasets else {}
    return Found(outcome, rig, units(), to_document(
        outcome.diagnosis, units(), next(iter(files), None)), files)


def _along_motion(recording: Any, heldout: Any, rig: Any, calibration: Any,
                  accelerometer: str | None) -> Found:
    """Compare the wrench with the measured motion."""
    from forcecal_ros.diagnose.by_motion import delay_std, diagnose_motion, inertia_std
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.patched import patched_calibration
    from forcecal_ros.diagnose.say.result import to_document
    from forcecal_ros.io.calibration_file import dump
    from forcecal_ros.sim.rigid_tool import rigid_tool_of_calibration, rigid_tool_of_rig

    rigid_tool = (rigid_tool_of_calibration(calibration, rig) if calibration
                  else rigid_tool_of_rig(rig))
    outcome = diagnose_motion(recording, heldout, rigid_tool, calibration, accelerometer)
    of_channels, files = units(rigid_tool.accelerometer_unit), {}
    document = to_document(outcome.diagnosis, of_channels, None)
    document['explained_by'] = 'measured motion'
    if calibration and outcome.datasets:
        document['calibration'] = 'calibration_patched.yaml'
        files[document['calibration']] = dump(patched_calibration(
            calibration, outcome.rig, delay_std(outcome), inertia_std(outcome)))
    return Found(outcome, rig, of_channels, document, files)


def _with_simulated(recording: Any, heldout: Any, simulated: tuple[Any, ...], rig: Any) -> Found:
    """Compare the wrench with what a simulator recorded."""
    from forcecal_ros.diagnose.by_simulated import diagnose_simulated, Pair
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.result import to_document

    found = diagnose_simulated(
        Pair(recording, simulated[0]),
        None if heldout is None or simulated[1] is None else Pair(heldout, simulated[1]), rig)
    document = to_document(found.outcome.diagnosis, units('m/s^2'), None)
    document |= {'explained_by': 'simulated recording', **found.document()}
    return Found(found.outcome, rig, units('m/s^2'), document, {})


def _with_simulator(recording: Any, heldout: Any, simulator: Any, rig: Any) -> Found:
    """Run a third-party simulator with the recorded commands."""
    from forcecal_ros.diagnose.by_simulator import diagnose_rerun
    from forcecal_ros.diagnose.inputs.channels import units
    from forcecal_ros.diagnose.say.result import to_document

    found = diagnose_rerun(recording, heldout, simulator, rig)
    document = to_document(found.outcome.diagnosis, units('m/s^2'), None)
    document |= {'explained_by': simulator.name, **found.document()}
    text = simulator.patched(found.numbers) if found.changed else None
    files = {} if text is None else {'model_patched.xml': text}
    document['model'] = next(iter(files), None)
    return Found(found.outcome, rig, units('m/s^2'), document, files,
                 tuple(f'change {one}' for one in found.changed))


def _as_calibrated(recording: Any, calibration: Any, about: str, wrench_sign: int | None) -> Any:
    """Bring poses to ft_sensor, base to level and readings to their axes, as calibrated."""
    from forcecal_ros.cli.estimate import in_sign_of
    from forcecal_ros.core.axes import in_axes_of_pose, levelled
    from forcecal_ros.observe.frames import taken_as_calibrated

    if recording is None:
        return None
    taken = in_sign_of(calibration, wrench_sign, taken_as_calibrated(
        recording, calibration, about))
    return in_axes_of_pose(levelled(taken, calibration.gravity_direction),
                           calibration.sensor_rotation)


def answer(args: argparse.Namespace) -> Answer:
    """Diagnose one recording."""
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import waits_for_compiler

    with stages(args) as stage:
        rig = load_rig(args.rig) if args.rig else None
        against, rerun = rig, bool(args.simulator or args.mujoco)
        if rerun:
            against = _simulator_of(args)
        elif args.calibration:
            against = load(args.calibration)
        stage(f'reading {args.bag}')
        recording, heldout = (bag and read(args, bag, joints=rerun)
                              for bag in (args.bag, args.heldout))
        if args.simulated:
            against = tuple(
                bag and read(args, bag, '--simulated-sensor-from-pose', '--simulated-topic',
                             args.simulated_wrench_sign)
                for bag in (args.simulated, args.heldout_simulated))
        stage(f'running {against.name} with other numbers' if rerun else
              'comparing the wrench with the simulated' if args.simulated else
              'replaying the commands and weighing effects'
              if recording.target and not args.calibration else
              'comparing the wrench with the measured motion')
        if not (rerun or args.simulated or args.calibration) and recording.target:
            warn_if_compiling(waits_for_compiler(), 'the simulator')
        found = compare(recording, heldout, against, rig=rig, accelerometer=args.accelerometer,
                        about=args.calibration or '', wrench_sign=args.wrench_sign)
        return _write(args, [one for one in (recording, heldout) if one is not None], found)


def _named(args: argparse.Namespace) -> str:
    """Return the models that the user named, or nothing."""
    return ' and '.join(filter(None, (
        args.simulator, args.mujoco, args.simulated, args.heldout_simulated, args.calibration,
        args.rig)))


def _name_it(args: argparse.Namespace) -> Any:
    """Say what to do where a recording is unlike the rig that nobody named."""
    from forcecal_ros.report.page import Step

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


def _write(args: argparse.Namespace, recordings: list[Any], found: Found) -> Answer:
    """Write what was found, a report of it, and further files."""
    import json

    from forcecal_ros.diagnose.say.advice import advice
    from forcecal_ros.report.diagnosis import (
        headline,
        next_step,
        render,
        view_of,
        view_without_signals,
    )
    from forcecal_ros.report.page import origin

    outcome, document, files = found.outcome, found.document, found.files
    diagnosis, folder, named = outcome.diagnosis, args.output, _named(args)
    assumed = () if named else (ASSUMED,)
    document['notes'] = [*assumed, *document['notes']]
    document['source'] = _source(args, recordings[0])
    view = (view_of(outcome, advice(diagnosis, found.rig), found.units) if outcome.datasets
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
    text = '\n'.join((verdict, *((headline(diagnosis),) if diagnosis.effects else ()),
                      f'next: {step.words} {step.command}'.rstrip(), f'written to {folder}',
                      *found.changes))
    return Answer(document, text, verdict,
                  (*assumed, *recordings[0].notes, *diagnosis.notes),
                  _status(args, diagnosis.verdict))


def _status(args: argparse.Namespace, verdict: str) -> int:
    """Return 1 for data that cannot be used, and what ``--fail-on`` asks for."""
    if verdict == 'invalid_data':
        return 1
    return FOUND if args.fail_on and verdict != 'no_gap' else 0
