"""``forcecal plan``: a sequence for the sequencer, for a diagnosis or for a calibration."""

import argparse
import shlex
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.core.errors import ConfigError, UsageError

if TYPE_CHECKING:
    from forcecal_ros.effects.rig import Rig
    from forcecal_ros.motion.optimal_design import Robot
    from forcecal_ros.motion.plan import Timing


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'plan', inputs=('rig', 'recording', 'calibration', 'after'),
        example='forcecal plan --rig rig.yaml --effects wrench_delay tool_mass -o plan.yaml\n'
                '  forcecal plan --for calibration --calibration calibration.yaml -o plan.yaml\n'
                '  ros2 run forcecal_ros sequencer --ros-args --params-file plan.yaml')
    parser.add_argument('--for', dest='purpose', choices=('diagnosis', 'calibration'),
                        default='diagnosis', help='what the recording is for')
    parser.add_argument('--rig', metavar='RIG.yaml',
                        help='rig to plan for: a file, or rig.yaml and rigid_tool.yaml of this '
                             'package (default: rig.yaml)')
    parser.add_argument('--recording', metavar='BAG',
                        help='recording of the robot: the plan starts at its first pose and '
                             'stays in the box of its sensor and tip positions')
    common.add_streams(parser)
    parser.add_argument('--home', metavar=common.POSE7, nargs=7,
                        type=common.real, help='start pose of ft_sensor in base [m, quaternion] '
                                        '(default: that of the recording, or of the rig)')
    parser.add_argument('--set', metavar='NAME=VALUE', action='append', default=[], type=_setting,
                        help='a parameter of the sequencer, e.g. limits.speed=0.1 or '
                             'limits.workspace_min=0.2,-0.5,0.1; of limits, pace or timing; may '
                             'be repeated')
    parser.add_argument('--effects', metavar='NAME', nargs='+',
                        type=common.word('an effect', 'effects', 'EFFECTS'),
                        help='diagnosis: effects that the recording must show (default: all)')
    parser.add_argument('--after', metavar='DIR',
                        help='diagnosis: results of forcecal diagnose, whose candidates the '
                             'recording must separate; includes contact if a candidate needs it')
    parser.add_argument('--contact', action='store_true',
                        help="diagnosis: also touch the rig's wall, which shows effects of "
                             'contact')
    parser.add_argument('--calibration', metavar='CALIBRATION.yaml',
                        help='calibration: file that gives mass and noise of tool and sensors '
                             '(default: those of the rig)')
    # biases drift within an hour by more than any plan would promise
    parser.add_argument('--duration', metavar='S',
                        type=common.number('a time up to 3600 s', lambda x: 0 < x <= 3600.0),
                        help='calibration: longest duration of the sequence (default: 16 s)')
    # a move back from farther has no clear direction
    parser.add_argument('--tilt', metavar='DEG',
                        type=common.number('an angle up to 170 deg', lambda x: 0 < x <= 170.0),
                        help='calibration: largest rotation of a pose from home (default: '
                             '100 deg)')
    common.add_output(parser, '-o', '--output', kind='file', metavar='PLAN.yaml',
                      help='parameters for the sequencer to write, - for standard output')


def _setting(text: str) -> tuple[str, Any]:
    """Read NAME=VALUE by the sequencer's parameters."""
    from forcecal_ros.core.parameters import parameters_of
    from forcecal_ros.motion.limits import Limits
    from forcecal_ros.motion.plan import Timing
    from forcecal_ros.motion.profiles import Pace

    table = {p.name: p for name, section in (
        ('limits', Limits()), ('pace', Pace()), ('timing', Timing()))
        for p in parameters_of(name, section)}
    name, _, value = text.partition('=')
    if name not in table:
        raise argparse.ArgumentTypeError(
            f'{name} is not a parameter of limits, pace or timing{common.or_nearest(name, table)}')
    parameter = table[name]
    listed = isinstance(parameter.default, list)
    try:
        numbers = [float(one) for one in value.split(',')]
        if len(numbers) != (len(parameter.default) if listed else 1):
            raise ValueError
        if listed:
            return name, numbers
        return name, parameter.row.take(type(parameter.default), numbers[0], name)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    except ValueError:
        expected = f'{len(parameter.default)} comma-separated numbers' if listed else 'a number'
        raise argparse.ArgumentTypeError(f'{text}: expected {expected} after =') from None


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    _check(args)
    return _calibration(args) if args.purpose == 'calibration' else _diagnosis(args)


def _check(args: argparse.Namespace) -> None:
    """Refuse options of the other purpose."""
    other = (('effects', 'after', 'contact') if args.purpose == 'calibration'
             else ('calibration', 'duration', 'tilt'))
    for name in other:
        if getattr(args, name):
            raise UsageError(f'--{name} is not used by --for {args.purpose}; leave it out')
    if args.after and args.effects:
        raise UsageError('--after and --effects exclude each other; give one')
    for name in {name for name, _ in args.set}:
        values = [value for one, value in args.set if one == name]
        if any(value != values[0] for value in values):
            raise UsageError(f'--set {name}: {values[0]} and {values[1]} are given; give one')


def _setup(args: argparse.Namespace) -> tuple['Rig', 'Robot', 'Timing']:
    """Take home and limits from the rig, the recording and the options, the later the stronger."""
    from dataclasses import replace

    from forcecal_ros.core.geometry import quaternion_from_matrix
    from forcecal_ros.core.parameters import section_of
    from forcecal_ros.effects.rig import Home
    from forcecal_ros.motion.limits import Limits
    from forcecal_ros.motion.optimal_design import Robot
    from forcecal_ros.motion.plan import Timing
    from forcecal_ros.motion.profiles import Pace, Pose, reach_of, read_poses
    from forcecal_ros.sim.rig.file import load_rig
    import numpy as np

    rig, given = load_rig(args.rig), dict(args.set)
    values: dict[str, Any] = {'limits.tip': list(rig.tool.tip), **given}
    home = Pose(np.array(rig.home.position), rig.home.R_base_sensor)
    if args.recording:
        home, lower, upper = reach_of(common.read(args, args.recording),
                                      np.array(values['limits.tip']))
        values = {'limits.workspace_min': lower.tolist(),
                  'limits.workspace_max': upper.tolist(), **values}
    with common.from_arguments():
        if args.home:
            home = read_poses(['--home'], args.home)['--home']
        limits = section_of(Limits, values, 'limits')
    x, y, z, w = quaternion_from_matrix(home.R_base_sensor).tolist()
    place = Home(tuple(home.position.tolist()), (x, y, z, w))
    robot = Robot(home, limits, section_of(Pace, values, 'pace'),
                  np.radians(args.tilt or 100.0))
    return replace(rig, home=place), robot, section_of(Timing, values, 'timing')


def _diagnosis(args: argparse.Namespace) -> int:
    from forcecal_ros.diagnose.plan import plan_document, plan_for, plan_parameters, plan_text
    from forcecal_ros.effects import EFFECTS

    if theirs := [key for key, _ in args.set if not key.startswith('limits.')]:
        raise UsageError(f'--set {theirs[0]}: --for diagnosis chooses this; set only limits.*')
    rig, robot, _ = _setup(args)
    effects = _candidates(args.after) if args.after else args.effects or ()
    contact = args.contact or any(EFFECTS[name].excited_by == ('contact',) for name in effects)
    common.warn_if_compiling('simulator')
    with common.stages(args) as stage:
        stage('simulating the sequence with every effect')
        planned = plan_for(rig, contact=contact, effects=effects, limits=robot.limits)
    t = planned.motion.target.t
    return _written(args, plan_document(planned), plan_text(planned), float(t[-1] - t[0]),
                    plan_parameters(planned))


def _candidates(folder: str) -> tuple[str, ...]:
    """Return the effects between which a diagnosis did not decide."""
    from forcecal_ros.diagnose.result import load_diagnosis
    from forcecal_ros.effects import EFFECTS

    found, _ = load_diagnosis(folder)
    names = tuple(name for name, _ in found.candidates if name in EFFECTS)
    if not names:
        raise UsageError(f'--after {folder}: its verdict {found.verdict} has no candidates in '
                         'the library; leave --after out to plan for all effects')
    return names


def _calibration(args: argparse.Namespace) -> int:
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.motion.optimal_design import (
        as_text,
        design_calibration,
        sensors_of,
        to_document,
        to_parameters,
    )
    from forcecal_ros.sim.rig.file import expected_sensors

    rig, robot, timing = _setup(args)
    sensors = sensors_of(load(args.calibration)) if args.calibration else expected_sensors(rig)
    with common.stages(args) as stage:
        stage('exchanging poses')
        design = design_calibration(robot, sensors, args.duration or 16.0, timing)
    return _written(args, to_document(design), as_text(design), design.duration,
                    to_parameters(design))


def _written(args: argparse.Namespace, document: dict[str, Any], text: str, duration: float,
             parameters: str) -> int:
    from forcecal_ros.core.files import write_text

    if args.output:
        write_text(args.output, parameters)
    lines = [text, f'the sequence takes about {duration:.0f} s']
    if args.output:
        lines.append(f'written to {args.output}\nnext: ros2 run forcecal_ros sequencer '
                     '--ros-args --params-file my_cell.yaml '
                     f'--params-file {shlex.quote(args.output)}')
    return common.show(args, document, '\n'.join(lines))
