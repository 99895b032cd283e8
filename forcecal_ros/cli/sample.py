"""``forcecal sample``: recordings to try the other commands on."""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.cli import common
from forcecal_ros.core.files import make_folder, write_results, write_text
from forcecal_ros.core.geometry import Array, rotation_from_vector, STANDARD_GRAVITY
from forcecal_ros.core.streams import JointStream, PoseStream, Recording
from forcecal_ros.effects.rig import Rig
from forcecal_ros.motion.profiles import quintic
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.third_party import ThirdParty
import numpy as np

MASS, COM = 2.9, np.array([0.012, -0.008, 0.205])
"""Of the limb alone [kg], in the sensor's frame [m]."""


class Load(NamedTuple):
    """An added mass [kg], where it is in the sensor's frame [m], and what it is used for."""

    mass: float
    position: tuple[float, float, float]
    use: str = 'train'


LOADS = {
    'nothing_added': Load(0.0, (0.0, 0.0, 0.0)),
    'front': Load(0.51, (0.34, 0.10, 0.39)),
    'left': Load(0.51, (0.02, -0.14, 0.42)),
    'right': Load(0.51, (0.24, -0.12, 0.45)),
    'far': Load(0.51, (0.39, 0.04, 0.39), 'validate'),
}
"""As many as a matrix takes, their centres of mass not on one line, and one to check it with."""


def gauges() -> tuple[Array, Array]:
    """Return what six gauges around a hub show of a wrench [counts per N, N m], and at none."""
    angle = np.deg2rad(60.0) * np.arange(6)
    columns = (40.0 * np.cos(angle), 40.0 * np.sin(angle), np.full(6, 35.0),
               800.0 * np.cos(2.0 * angle), 800.0 * np.sin(2.0 * angle),
               600.0 * (-1.0) ** np.arange(6))
    return np.stack(columns, axis=1), np.array([1250.0, -840.0, 310.0, 2210.0, -1730.0, 420.0])


def record(load: Load, rng: np.random.Generator) -> Array:
    """
    Tilt the limb with a load on it, and write down what its sensors say.

    Returns
    -------
    ndarray, shape (n, 10)
        Stamps [s], raw channels, specific force [m/s^2].
    """
    # [Hz], [s]: a minute, as [Traversaro2014] took for each added mass
    rate, duration = 100.0, 60.0
    t = np.arange(round(duration * rate)) / rate
    # amplitude [deg] and period [s] about y and about x: so slow that weight alone counts
    pitch, roll = (np.deg2rad(amplitude) * np.sin(2.0 * np.pi * (t / period + rng.uniform()))
                   for amplitude, period in ((40.0, 30.0), (30.0, 23.0)))
    # the limb hangs along z of the sensor
    gravity = STANDARD_GRAVITY * np.stack([
        -np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], axis=1)
    moment = MASS * COM + load.mass * np.array(load.position)
    wrench = np.hstack([(MASS + load.mass) * gravity, np.cross(moment, gravity)])
    matrix, offset = gauges()
    # noise [N], [N m], [m/s^2]: a worn limb's
    noise = np.repeat([0.3, 0.02], 3) * rng.standard_normal(wrench.shape)
    accel = -gravity + 0.05 * rng.standard_normal(gravity.shape)
    return np.column_stack([t, (wrench + noise) @ matrix.T + offset, accel])


SECONDS, PERIOD = 20.0, 0.008
"""Length of the motion, and between commands: 125 Hz, as for many controllers [s]."""

HEAVIER = {'body_mass[gripper]': 1.05}
"""What is wrong with the second robot: factors of its model's numbers."""


def commands(names: tuple[str, ...], seed: int) -> JointStream:
    """Return commands of six joints that begin and end at rest and turn the wrist widely."""
    rng = np.random.default_rng([seed, 1])
    t: Array = PERIOD * np.arange(round(SECONDS / PERIOD) + 1, dtype=np.float64)
    moving = SECONDS - 2.0  # a second at rest at either end
    u = np.clip(t - 1.0, 0.0, moving)
    rise = quintic(np.minimum(u, moving - u) / 2.0)[0]  # to its full size in 2 s
    q: Array = np.tile((0.3, -1.3, 1.7, -1.9, -1.5, 0.4), (len(t), 1))  # at rest [rad]
    # sizes: by which each joint swings at the slowest [rad]: the wrist most, it turns gravity
    for joint, most in enumerate((0.3, 0.15, 0.2, 0.6, 0.8, 1.0)):
        # slowest and fastest: of the sines that a joint's motion is made of [Hz]: what an arm of
        # that size can follow
        for f in rng.uniform(0.08, 0.9, 3):
            size = most * rng.uniform(0.3, 0.6) * min(1.0, 0.3 / f)
            q[:, joint] += rise * size * np.sin(2.0 * np.pi * (f * u + rng.uniform()))
    return JointStream(t, q, '', names)


def recorded(arm: ThirdParty, factors: Mapping[str, float], seed: int, *,
             motion: int | None = None) -> Recording:
    """
    Record a robot whose numbers are off, each by a part of its sigma, and some by a factor.

    Parameters
    ----------
    arm : ThirdParty
        Of six joints.
    factors : mapping of str to float
        Of parameters, times their nominal value.
    seed, motion : int
        Of noise and numbers, and of the commands: by default of all.

    Returns
    -------
    Recording
        Commands of joints, wrench and pose, with a sensor's noise and zero.
    """
    rng = np.random.default_rng([seed, 2])
    names = tuple(p.name[3:-1] for p in arm.parameters if p.name.startswith('kp['))
    joints = commands(names, seed if motion is None else motion)
    # by which every other number is off, in its sigma
    off = rng.choice([-0.5, 0.5], len(arm.parameters))
    values = [max(p.low, p.nominal * factors[p.name] if p.name in factors
                  else p.nominal + x * p.sigma) for p, x in zip(arm.parameters, off)]
    made = arm.run(Inputs(0.0, SECONDS, joints=joints), values)
    wrench, pose = made.wrench, made.pose
    assert wrench is not None
    assert pose is not None
    # arm noise: of force [N], torque [N m], position [m], orientation [rad], 1 sigma: as of a
    # UR's
    force, torque, place, turn = (
        s * rng.normal(size=(len(wrench), 3)) for s in (0.15, 0.006, 1e-4, 2e-4))
    zero = (3.0, -1.0, 2.0, 0.1, 0.0, -0.2)  # of the sensor [N], [N m]
    return replace(
        made, joint_commands=joints,
        wrench=replace(wrench, values=wrench.values + np.hstack([force, torque]) + zero),
        pose=replace(pose, position=pose.position + place,
                     R_base_sensor=pose.R_base_sensor @ rotation_from_vector(turn)))


LATE = {'wrench_delay': {'delay': 0.004}}
"""In what the robot of the second recording differs from the rig file."""

BEGUN = 1_700_000_000 * 10 ** 9
"""Stamp at which recordings begin [ns], of a day like any other."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(subparsers, 'sample', json=False, quiet=False,
                               example='forcecal sample rig -o sample')
    parser.add_argument('kind', choices=tuple(KINDS),
                        help='rig: two recordings of the simulated rig, one without any fault '
                             'and one whose wrench is 4 ms late; rigid_arm: two of an arm, '
                             'one without any fault and one whose gripper weighs 5 %% more than '
                             'in its MuJoCo model, and that model; insitu: tables of a limb with '
                             'added masses, and the spec.yaml that describes them; shaken: the '
                             'simulated rig shaken along x, for fit-rig --for impedance')
    common.add_output(parser, '-o', '--output', kind='results', metavar='DIR', required=True,
                      help='folder for the files')
    parser.add_argument('--seed', type=common.whole, default=0, help='seed of the sensor noise')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    written, *commands = KINDS[args.kind](Path(args.output), args.seed)
    common.say(f'written to {args.output}: {written}')
    for command in commands:
        common.say(f'try: forcecal {command}')
    return 0


def _rig(folder: Path, seed: int) -> tuple[str, ...]:
    """Write recordings of the rig; return what was written, and commands to try on it."""
    from forcecal_ros.diagnose.plan import motion_for
    from forcecal_ros.effects import with_effects
    from forcecal_ros.io.bags import write_recording
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import simulate

    rig = load_rig()
    common.warn_if_compiling('simulator')
    make_folder(folder)
    moved = motion_for(rig, contact=True, brief=True)
    for i, (name, effects) in enumerate((('sound', {}), ('late', LATE))):
        recording = simulate(with_effects(rig, effects) if effects else rig, moved.target,
                             seed=seed + i)
        write_recording(folder / name, replace(
            recording, phases=moved.phases, start_ns=BEGUN))
    return (f'sound, late ({moved.target.t[-1]:.0f} s each)',
            f'calibrate {folder}/sound -o calibration.yaml',
            f'diagnose {folder}/late -o diagnosis')


def _rigid_arm(folder: Path, seed: int) -> tuple[str, ...]:
    """Write recordings of an arm and its model; return as :func:`_rig` does."""
    from importlib.resources import files

    from forcecal_ros.io.bags import write_recording
    from forcecal_ros.sim.mujoco import load_mujoco
    from forcecal_ros.sim.third_party import third_party

    source = files('forcecal_ros') / 'config' / 'examples' / 'rigid_arm.xml'
    model = folder / source.name
    arm = third_party(str(model), load_mujoco(str(source)))
    make_folder(folder)
    write_text(model, source.read_text())
    for i, (name, factors) in enumerate((
            ('sound', dict.fromkeys(HEAVIER, 1.0)), ('heavier', HEAVIER))):
        recording = recorded(arm, factors, seed + i, motion=seed)
        write_recording(folder / name, replace(recording, start_ns=BEGUN))
    return (f'{source.name}, sound, heavier',
            f'diagnose {folder}/heavier --simulated {folder}/sound -o two_bags',
            f'diagnose {folder}/heavier --mujoco {model} -o diagnosis')


def _insitu(folder: Path, seed: int) -> tuple[str, ...]:
    """Write tables of a limb and what they are; return as :func:`_rig` does."""
    from io import StringIO

    import yaml

    columns = ('t', *(f'raw{k}' for k in range(6)), 'ax', 'ay', 'az')
    files, rng = {}, np.random.default_rng(seed)
    for name, load in LOADS.items():
        table = StringIO()
        np.savetxt(table, record(load, rng), fmt='%.6g', delimiter=',', header=','.join(columns),
                   comments='')
        files[f'{name}.csv'] = table.getvalue()
    document = {
        'format': 'forcecal-insitu/1', 'time': {'column': 't', 'unit': 's'},
        'accelerometer': {'columns': ['ax', 'ay', 'az']},
        'sensors': {'limb': {'columns': list(columns[1:7]), 'unit': 'counts',
                             'frame': 'limb_ft'}},
        'data_sets': [{'file': f'{name}.csv', 'use': load.use, 'added_mass': load.mass,
                       **({'position': list(load.position)} if load.mass else {})}
                      for name, load in LOADS.items()]}
    files['spec.yaml'] = yaml.safe_dump(document, sort_keys=False)
    write_results(folder, files)
    return ', '.join(files), f'insitu {folder}/spec.yaml -o limb'


def simulate_along_x(rig: Rig, distances: Array, **options: Any) -> Recording:
    """
    Simulate a rig that is commanded along x of ft_sensor from where it stands.

    Parameters
    ----------
    distances : ndarray, shape (n,)
        One a period [m].
    options : dict
        Of :func:`forcecal_ros.sim.rig.simulator.simulate`.
    """
    from forcecal_ros.sim.rig.simulator import simulate

    R, t = rig.home.R_base_sensor, np.arange(len(distances), dtype=float) * rig.robot.period
    return simulate(rig, PoseStream(
        t, rig.home.position + np.outer(distances, R[:, 0]),
        np.broadcast_to(R, (len(t), 3, 3))), **options)


def _shaken(folder: Path, seed: int) -> tuple[str, ...]:
    """Write a recording of the rig shaken along x; return as :func:`_rig` does."""
    from forcecal_ros.impedance.plant_fit import excitation_commands
    from forcecal_ros.io.bags import write_recording
    from forcecal_ros.sim.rig.file import load_rig

    rig = load_rig()
    common.warn_if_compiling('simulator')
    seconds = 30.0  # enough for the model to choose its order by
    commanded = excitation_commands(seconds, rig.robot.period, seed=seed)
    recording = simulate_along_x(rig, commanded, seed=seed)
    make_folder(folder)
    write_recording(folder / 'shaken', replace(recording, contact_truth=None, start_ns=BEGUN))
    return (f'shaken ({seconds:.0f} s)',
            f'fit-rig {folder}/shaken --for impedance -o plant.yaml')


KINDS = {'rig': _rig, 'rigid_arm': _rigid_arm, 'insitu': _insitu, 'shaken': _shaken}
