"""Which simulator of his own the user names: a module's function, or a model in MuJoCo."""

import argparse
from typing import Any

from forcecal_ros.core.errors import UsageError


def add_simulators(parser: Any) -> None:
    """Declare how one is named."""
    parser.add_argument('--simulator', metavar='MODULE:FACTORY',
                        help='your own simulator, which is run with the recorded commands: a '
                             'function without arguments that returns an object with '
                             'parameters() and simulate(inputs, parameters); its code is '
                             'executed')
    parser.add_argument('--mujoco', metavar='MODEL.xml',
                        help='your robot as an MJCF, which MuJoCo runs with the recorded commands '
                             'of its joints')
    parser.add_argument('--imu', metavar='NAME',
                        help="with --mujoco: site of the model's accelerometer, on the tool "
                             '(default: it is not compared)')
    parser.add_argument('--priors', metavar='FILE.yaml',
                        help="how well the simulator's parameters are known, lines of NAME: SIGMA "
                             "(1 sigma, in the parameter's unit)")
    parser.add_argument('--ft-site', metavar='NAME',
                        help="with --mujoco: site of the model's force-torque sensor (default: "
                             'that of its only force sensor)')


def check_simulators(args: argparse.Namespace) -> None:
    """Refuse two simulators, and a site of none."""
    if args.mujoco and args.simulator:
        raise UsageError('--mujoco and --simulator exclude each other: one model at a time')
    for option, given in (('--ft-site', args.ft_site), ('--imu', args.imu)):
        if given and not args.mujoco:
            raise UsageError(f'{option} wants --mujoco: it names a site of that model')
    if args.priors and not (args.mujoco or args.simulator):
        raise UsageError('--priors wants --mujoco or --simulator, whose parameters they are of')


def simulator_of(args: argparse.Namespace) -> Any:
    """Load the one that was named."""
    from forcecal_ros.sim.mujoco import load_mujoco
    from forcecal_ros.sim.third_party import load_simulator, third_party, with_priors

    if args.mujoco:
        found = third_party(args.mujoco, load_mujoco(args.mujoco, args.ft_site, args.imu))
    else:
        found = load_simulator(args.simulator)
    return with_priors(found, args.priors) if args.priors else found
