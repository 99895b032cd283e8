"""``forcecal diagnose``: where, why and how far a recording departs from the simulator."""

import argparse
from collections.abc import Callable
import os
import shlex
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.cli.many import add_bags, Answer, MANY
from forcecal_ros.cli.many import run as run_each
from forcecal_ros.core.errors import UsageError
from forcecal_ros.core.files import write_results
from forcecal_ros.diagnose.verdict import TOLERANCE

NOMINAL, NOMINAL_RIG = 'nominal', 'the nominal rig (rig.yaml of this package)'

SIMULATORS = ('simulator', 'mujoco', 'simulated')
"""Options that name a simulator of the user's."""

COMPARED = (*SIMULATORS, 'calibration', 'rig')
"""Options that name what a recording is compared with."""

FILES = ('diagnosis.json', 'report.html', 'rig_patched.yaml', 'calibration_patched.yaml',
         'model_patched.xml')
"""All that a diagnosis may write."""

SEARCH = ('this is the time of the runs; the search adds seconds to minutes, depending on the '
          'length of the recording and the number of parameters')
"""What ``--check`` adds to the time of the runs."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'diagnose', inputs=('bag', 'heldout', 'prior', 'rig', 'calibration',
                                        'simulated', 'heldout_simulated', 'mujoco', 'priors'),
        example='forcecal diagnose my_bag --calibration calibration.yaml -o diagnosis\n'
                '  forcecal diagnose my_bag --mujoco arm.xml --check   # can it be compared?')
    add_bags(parser)
    parser.add_argument('--check', action='store_true',
                        help='only check whether --simulator or --mujoco can be compared with a '
                             'robot; nothing is written')
    parser.add_argument('--fail-on', choices=('gap',),
                        help='gap: exit with status 3 for every verdict except no_gap')
    recording = common.group(parser, 'recording')
    recording.add_argument('--heldout', metavar='BAG',
                           help='second recording, with another trajectory, for validation '
                                '(default: parts of every phase of the first)')
    recording.add_argument('--accelerometer', choices=('acc1', 'acc2'),
                           help='mounted accelerometer (default: detected from its voltage)')
    recording.add_argument('--prior', metavar='DIR',
                           help='results of an earlier diagnosis of the same robot against the '
                                'same model, from which this diagnosis continues')
    recording.add_argument('--tolerance', metavar='X', type=common.positive,
                           help="a residual below X times a channel's noise (RMS) is not a gap "
                                f'(default: {TOLERANCE:g}; 0.2 along measured motion and with a '
                                'simulator, which are less accurate)')
    recording.add_argument('--robot', metavar='NAME',
                           help='name of the robot, stored in diagnosis.json for forcecal fleet')
    model = common.group(parser, 'model')
    model.add_argument('--rig', metavar='RIG.yaml',
                       help='rig to compare with: a file, or nominal (rig.yaml of this package; '
                            'the default for a recording of the simulated rig)')
    model.add_argument('--calibration', metavar='C.yaml',
                       help='calibration of tool and sensors; the wrench is compared with that '
                            'of the measured motion')
    model.add_argument('--simulated', metavar='SIM_BAG',
                       help='recording of wrench and current_pose from your own simulator, under '
                            'the same commands; record target_frame in both to detect delays')
    model.add_argument('--heldout-simulated', metavar='SIM_BAG2',
                       help='recording from the simulator under the commands of --heldout')
    model.add_argument('--simulated-wrench-sign', type=int, choices=(1, -1),
                       help='-1: the wrench of SIM_BAG has the opposite sign, as from '
                            "MuJoCo's force sensor")
    common.add_streams(parser, 'simulated-')
    model.add_argument('--simulator', metavar='MODULE:FACTORY',
                       help='your own simulator, run with the recorded commands: FACTORY() '
                            'returns an object with parameters() and simulate(inputs, '
                            'parameters); its code is executed')
    model.add_argument('--mujoco', metavar='MODEL.xml',
                       help='MJCF model of your robot, run with the recorded joint commands')
    model.add_argument('--ft-site', metavar='NAME',
                       help="with --mujoco: site of the model's force-torque sensor (default: "
                            'that of its only force sensor)')
    model.add_argument('--imu', metavar='NAME',
                       help="with --mujoco: site of the model's accelerometer, on the tool "
                            '(default: it is not compared)')
    model.add_argument('--priors', metavar='FILE.yaml',
                       help="prior uncertainty of the simulator's parameters, lines of NAME: "
                            "SIGMA (1 sigma, in the parameter's unit)")
    common.add_output(parser, '-o', '--output', kind='results', metavar='DIR', default='diagnosis',
                      help='folder for diagnosis.json, report.html and rig_patched.yaml (or '
                           'calibration_patched.yaml, or model_patched.xml)',
                      more=f'{MANY} of such folders')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    _check_models(args)
    if args.check:
        return _check_simulator(args)
    return run_each(args, answer)


def _check_models(args: argparse.Namespace) -> None:
    """Refuse options that contradict each other, or lack another."""
    if args.heldout and os.path.realpath(args.heldout) in map(os.path.realpath, args.bag):
        raise UsageError(f'--heldout: {args.heldout} is the recording to be explained; give '
                         'another one, or leave --heldout out to use parts of every phase')
    for option, given in (('--ft-site', args.ft_site), ('--imu', args.imu)):
        if given and not args.mujoco:
            raise UsageError(f'{option} requires --mujoco: it names a site of that model')
    if args.priors and not (args.mujoco or args.simulator):
        raise UsageError('--priors requires --mujoco or --simulator: it lists their parameters')
    if args.check and (not (args.simulator or args.mujoco) or len(args.bag) > 1):
        raise UsageError('--check requires one BAG and a simulator: --simulator '
                         'MODULE:FACTORY or --mujoco MODEL.xml')
    named = [name for name in COMPARED if getattr(args, name)]
    if named and named[0] in SIMULATORS:
        if len(named) > 1:
            raise UsageError(f'give either --{named[0]} or --{named[1]}, not both')
        if len(args.bag) > 1:
            raise UsageError(f'--{named[0]} requires exactly one BAG; diagnose each separately')
    if args.simulated:
        common.topic_names(args, of='simulated-')
        if bool(args.heldout) != bool(args.heldout_simulated):
            missing = '--heldout' if args.heldout_simulated else '--heldout-simulated'
            raise UsageError('--heldout and --heldout-simulated require each other; '
                             f'also give {missing}')
        given = [path for path in (*args.bag, args.heldout, args.simulated,
                                   args.heldout_simulated) if path]
        if len(set(map(os.path.realpath, given))) < len(given):
            raise UsageError("--simulated: one bag is given twice; give the robot's and the "
                             "simulator's")
    elif of_bag := [name for name in ('heldout_simulated', 'simulated_topic',
                                      'simulated_wrench_sign', 'simulated_sensor_from_pose')
                    if getattr(args, name)]:
        raise UsageError(f'--{of_bag[0].replace("_", "-")} requires --simulated, a recording from '
                         'the simulator under the commands of BAG')


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
    from forcecal_ros.diagnose.sources.choice import RIGID
    from forcecal_ros.diagnose.sources.simulator import conformance
    from forcecal_ros.sim.rig.file import load_rig

    found = conformance(_simulator_of(args), common.read(args, args.bag[0], joints=True),
                        load_rig(RIGID))
    words = ('forcecal', 'diagnose', args.bag[0], *_likewise(args), '-o', args.output)
    return common.show(args, found.document(), f'{found}\n{SEARCH}\nnext: {shlex.join(words)}')


def _likewise(args: argparse.Namespace) -> tuple[str, ...]:
    """Return the words by which another recording is read likewise, against the same model."""
    words = [word for role, name in args.simulated_topic
             for word in ('--simulated-topic', f'{role}={name}')]
    for name in (*COMPARED, 'imu', 'ft_site', 'priors', 'accelerometer', 'tolerance',
                 'simulated_wrench_sign', 'simulated_sensor_from_pose'):
        if (value := getattr(args, name)) is not None:
            numbers = value if isinstance(value, list) else [value]
            words += [f'--{name.replace("_", "-")}', *map(str, numbers)]
    return (*words, *common.read_likewise(args))


def answer(args: argparse.Namespace) -> Answer:
    """Diagnose one recording."""
    from forcecal_ros.diagnose.engine import report_stage

    with common.stages(args) as stage:
        source, recordings = _source_of(args, stage)
        source.tolerance = args.tolerance
        if args.prior:
            source.earlier = _earlier(args.prior, source.explained_by)
        stage(source.task)
        before = report_stage.set(stage)
        try:
            return _written(args, recordings, source.diagnose(*recordings))
        finally:
            report_stage.reset(before)


def _earlier(folder: str, explained_by: str) -> Any:
    """Read what an earlier diagnosis found, against the same kind of model."""
    from forcecal_ros.diagnose.result import load_diagnosis

    found, document = load_diagnosis(folder)
    other = document.get('explained_by', '')
    if other != explained_by:
        raise UsageError(f'--prior {folder} was compared with {other or "a rig"}, this recording '
                         f'with {explained_by or "a rig"}; give a diagnosis against the same '
                         'model')
    if not found.earlier.evidence:
        raise UsageError(f'--prior {folder}: a diagnosis with the verdict {found.verdict} has no '
                         'candidates to continue from (effects that begin or end in a recording '
                         'do not count); leave '
                         '--prior out')
    return found.earlier


def _source_of(args: argparse.Namespace, stage: Callable[[str], None]
               ) -> tuple[Any, list[Any]]:
    """Return what the options compare with, and the recordings."""
    from forcecal_ros.diagnose.sources.choice import own_rig, source_of
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.sim.rig.file import load_rig

    def read(bags: tuple[str | None, ...], of: str = '') -> list[Any]:
        found = []
        for bag in filter(None, bags):
            stage(f'reading {bag}')
            found.append(common.read(args, bag, of, joints=bool(args.simulator or args.mujoco)))
        return found

    against = _simulator_of(args) if args.simulator or args.mujoco else None
    recordings = read((args.bag, args.heldout))
    if args.simulated:
        against = read((args.simulated, args.heldout_simulated), 'simulated-')
    rig = load_rig(args.rig) if args.rig else None
    if args.calibration:
        against = load(args.calibration)
    elif against is None:
        against = rig or own_rig(recordings)
        if recordings[0].target:
            common.warn_if_compiling('simulator')
    return source_of(against, recordings, rig, args.accelerometer, args.calibration)


def _named(args: argparse.Namespace) -> str:
    """Return the models that are compared with."""
    names = [getattr(args, name) for name in (*COMPARED[:3], 'heldout_simulated', *COMPARED[3:])]
    return ' and '.join(NOMINAL_RIG if one == NOMINAL else one for one in names if one
                        ) or NOMINAL_RIG


def _written(args: argparse.Namespace, recordings: list[Any], found: Any) -> Answer:
    """Write what was found, a report of it, and other files."""
    from datetime import datetime, timezone
    import json

    from forcecal_ros.calibrate.pipeline import provenance
    from forcecal_ros.diagnose.dataset import units
    from forcecal_ros.diagnose.plan import advice
    from forcecal_ros.report.diagnosis import headline, next_step, render, view_of
    from forcecal_ros.report.page import origin

    diagnosis, folder, document = found.diagnosis, args.output, found.document()
    document['source'] = {
        **provenance(recordings[0]), **({'robot': args.robot} if args.robot else {}),
        'created': datetime.now(timezone.utc).isoformat(timespec='seconds')}
    view = view_of(found.outcome, advice(diagnosis), units(found.unit))
    step = next_step(diagnosis, args.bag, folder, tuple(found.files), common.read_likewise(args),
                     _likewise(args))
    write_results(folder, {
        'diagnosis.json': json.dumps(document, indent=2, allow_nan=False) + '\n',
        'report.html': render(
            view, [*origin(recordings), f'compared with {_named(args)}'], step),
        **found.files}, FILES)
    verdict = f'{diagnosis.verdict}: {diagnosis.reason}'
    text = '\n'.join((verdict, *((headline(diagnosis),) if diagnosis.effects else ()),
                      f'next: {step.words} {step.command}'.rstrip(), f'written to {folder}'))
    return Answer(document, text, verdict, (*recordings[0].notes, *diagnosis.notes),
                  1 if diagnosis.verdict == 'invalid_data' else
                  3 if args.fail_on and diagnosis.verdict != 'no_gap' else 0)
