"""A robot against somebody else's simulation of it: what can be told of it in three ways.

    pip install mujoco    # and drake for --drake, --drake-mujoco
    python benchmark/any_simulator.py --out any_simulator.jsonl
        [--rerun | --mujoco | --fit-rig | --drake | --drake-mujoco]
        [--jobs N] [--clean N] [--seeds N] [--first N] [--effects NAME ...]

An arm in MuJoCo stands for the robot: integrated four times as finely as its simulation (by Euler,
too: MuJoCo's RK4 is 0.29 N from it on this arm at 0.5 ms, which is a gap of its own), with every
number off by 0.5 to 2 %, with one effect or none, a sensor that nobody zeroed, and the noise of a
UR's wrench (0.15 N, 6 mN m), of poses (0.1 mm, 0.2 mrad), joints (0.03 mrad) and, where there is
one, an Imu (0.05 m/s^2). What is in the joints moves the arm otherwise and is no departure of the
wrench from the motion: there, no effect is the right answer of two bags, and the difference of the
motions tells it. With --rerun the simulation is run again with other numbers, and what is in the
joints has a name. With --mujoco it is run as a model in MuJoCo, and the robot is integrated by
implicitfast at 0.1 ms; the table is MuJoCo's own contact, pressed on for a third of the time. With
--fit-rig there is no simulation: a rig is fitted to a recording of the robot without an effect,
and others of the same robot and day are compared with that. With --drake (the extra drake) the
robot moves in Drake instead, a millisecond later, its joints have no dry friction but a viscous
one of 1 N m s/rad that the simulation lacks, and its gears turn the tool by 0.05 mrad, ten times
in a turn; it is compared with a simulation in MuJoCo by two recordings, or with --drake-mujoco as
a model.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from forcecal_ros.core.extras import installing
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.diagnose.sources.pair import PairSource, shift_times
from forcecal_ros.diagnose.sources.rig import rig_source
from forcecal_ros.diagnose.sources.simulator import SimulatorSource
from forcecal_ros.rig_fit.fit import fit_rig
from forcecal_ros.sim.mujoco import load_mujoco
from forcecal_ros.sim.rig.file import dump_rig, load_rig
from forcecal_ros.sim.third_party import third_party
from mujoco_arm import (
    Arm,
    ArmSimulator,
    commands,
    forward,
    mjcf_of,
    model_of,
    pressing,
    run,
    TIP,
    varied,
)
import numpy as np
from resumable import resumed

SECONDS = 30.0
NOISE = np.array([0.15] * 3 + [0.006] * 3)
FINER = {'step': 0.0001, 'integrator': 'implicitfast'}
"""How the robot of a model in MuJoCo is integrated: 0.013 N RMS from Euler at 0.25 ms."""

PLACE, TURN, ENCODER, FELT = 1e-4, 2e-4, 3e-5, 0.05
"""Noise of a pose [m], [rad], of a joint [rad], of an Imu [m/s^2]."""

DEEP = 0.005
"""By which the motion would go below a table [m]."""

SOFT = 0.05
"""Time constant of a table in MuJoCo [s]: 2 mm under 100 N, of a few kilograms behind a tip."""


def payload(arm):
    return replace(arm, mass=1.05 * arm.mass)


def tilt(arm):
    return replace(arm, tilt=(np.radians(1.0), 0.0))


def friction(arm):
    f = list(arm.friction)
    f[2] += 2.0
    return replace(arm, friction=tuple(f))


def stiffness(arm):
    k = list(arm.kp)
    k[1] *= 0.8
    return replace(arm, kp=tuple(k))


def cable(arm):
    hook = np.array([0.4, 0.3, 1.4])
    return replace(arm, pull=lambda x: 10.0 * (hook - x))


def softness(arm):
    return replace(arm, stiffness=0.7 * arm.stiffness)


def backlash(arm):
    return replace(arm, play=(0.0, 0.0, 1e-3, 0.0, 0.0, 0.0))


def same_arm(arm):
    return arm


def late(t, w):
    return np.stack([np.interp(t - 0.008, t, x) for x in w.T], axis=1)


def crosstalk(t, w):
    return w + 0.03 * np.outer(w[:, 0], np.eye(6)[1])


def gain(t, w):
    return w * (1.0 + 0.03 * np.eye(6)[0])


def drift(t, w):
    return w + np.outer(t, 0.02 * np.eye(6)[2])


ARMS = {'payload': payload, 'tilt': tilt, 'cable': cable, 'joint friction': friction,
        'joint gain': stiffness, 'joint backlash': backlash, 'contact softness': softness}
"""Name -> what it makes of an arm."""

SENSORS = {'delay': late, 'crosstalk': crosstalk, 'gain': gain, 'drift': drift}
"""Name -> what it makes of a wrench."""

IN_DRAKE = ('drake', 'drake-mujoco')

NOT_IN_DRAKE = ('joint friction', 'joint backlash', 'contact softness', 'none, table')

RIPPLE = 5e-5
"""Of the gears of the robot in Drake [rad], ten times in a turn."""

BIAS = np.array([0.2, 0.0, 0.0])
"""Of the Imu [m/s^2]."""

ON_TABLE = ('contact softness', 'none, table')

NONE = ('none', 'none, table', 'none, Imu')

TRUTH = {'payload': 'tool_mass', 'tilt': 'base_tilt', 'cable': 'cable_force',
         'joint friction': '', 'joint gain': '', 'joint backlash': '',
         'contact softness': 'contact_stiffness',
         'delay': 'wrench_delay', 'crosstalk': 'wrench_crosstalk', 'gain': 'wrench_gain',
         'drift': 'wrench_bias_drift', 'Imu bias': 'accel_bias'}
"""Name -> how the library calls it; '' where it has no name for it."""

RERUN = {'payload': 'payload', 'tilt': 'tilt.x', 'joint friction': 'frictionloss[2]',
         'joint gain': 'kp[1]', 'contact softness': 'table'}
"""Name -> the number of the simulator that tells it, where it can be run again."""

MUJOCO = {'payload': 'body_mass[gripper]', 'tilt': 'tilt.x',
          'joint friction': 'dof_frictionloss[joint2]', 'joint gain': 'kp[joint1]',
          'joint backlash': 'backlash[joint2]', 'contact softness': 'geom_solref[table]'}
"""The same of a model in MuJoCo."""

OF_WAY = {'rerun': RERUN, 'mujoco': MUJOCO, 'drake-mujoco': MUJOCO}


def zero(rng):
    """Return what a sensor reads that nobody zeroed."""
    return rng.uniform(-1.0, 1.0, 6) * [10.0, 10.0, 10.0, 0.5, 0.5, 0.5]


def measured(recording, effect, rng, of_sensor=None):
    """Give a recording what a sensor adds."""
    wrench, pose, joints = recording.wrench, recording.pose, recording.joints
    values = wrench.values + (zero(rng) if of_sensor is None else of_sensor)
    if effect in SENSORS:
        values = SENSORS[effect](wrench.t, values)
    values = values + rng.normal(size=values.shape) * NOISE
    turned = rotation_from_vector(rng.normal(size=(len(pose), 3)) * TURN)
    pose = replace(pose, position=pose.position + rng.normal(size=pose.position.shape) * PLACE,
                   R_base_sensor=pose.R_base_sensor @ turned)
    encoders = joints.values + rng.normal(size=joints.values.shape) * ENCODER
    felt = recording.accelerometer
    if felt is not None:
        rows = felt.values + rng.normal(size=felt.values.shape) * FELT
        felt = replace(felt, values=rows + BIAS if effect == 'Imu bias' else rows)
    return replace(recording, wrench=replace(wrench, values=values), pose=pose,
                   joints=replace(joints, values=encoders), accelerometer=felt)


def simulated_arm(effect, joints, soft=None):
    """Return the arm of the simulation: with a table or an Imu where the effect wants them."""
    table = None
    if effect in ON_TABLE:
        lowest = float(forward(model_of(Arm()), joints)[0][:, 2].min())
        table = lowest + DEEP - (0.0 if soft is None else TIP)
    return Arm(table=table, soft=None if table is None else soft,
               imu=effect in ('Imu bias', 'none, Imu'))


def commanded(effect, seed, way):
    """Return the commands of a case: with a table a third of them press on it, if it can show."""
    if way in ('mujoco', 'compared') and effect in ON_TABLE:
        return np.concatenate([commands(seed, 2.0 * SECONDS / 3.0), pressing(SECONDS / 3.0)])
    return commands(seed, SECONDS)


def answer(case):
    """Diagnose one case."""
    effect, seed, began = case['effect'], case['seed'], time.process_time()
    if case['way'] == 'fit-rig':
        found = _fitted(effect, seed, Path(case['folder']))
    else:
        rng = np.random.default_rng([seed, *effect.encode()])
        way = case['way']
        joints = commanded(effect, seed, way)
        arm = simulated_arm(effect, joints, SOFT if way == 'mujoco' else None)
        if way in IN_DRAKE:
            arm = replace(arm, friction=(0.0,) * 6)
        finer = FINER if way == 'mujoco' else {'step': 0.00025}
        robot = ARMS.get(effect, same_arm)(varied(replace(arm, **finer), rng))
        real = measured(_moved(way, robot, joints), effect, rng)
        found = WAYS[way](real, joints, arm)
    return {**case, **found, 'seconds': time.process_time() - began}


def _moved(way, robot, joints):
    """Move a robot, in the engine that stands for it."""
    if way not in IN_DRAKE:
        return run(robot, joints, every=0.004)
    from drake_robot import run_in_drake  # an extra of this way alone
    out = run_in_drake(robot, joints)
    turn = rotation_from_vector(RIPPLE * np.sin(10.0 * out.joints.values[:, 3:]))
    return replace(out, pose=replace(out.pose, R_base_sensor=out.pose.R_base_sensor @ turn))


def _fitted(effect, seed, folder):
    rng = np.random.default_rng([seed, 1])
    imu = simulated_arm(effect, commands(seed, SECONDS)).imu
    robot, of_sensor = varied(Arm(step=0.00025, imu=imu), rng), zero(rng)

    def recorded(arm, effect, motion):
        return measured(run(arm, commands(motion, SECONDS), every=0.004), effect,
                        np.random.default_rng([motion, *effect.encode()]), of_sensor)

    file = folder / f'robot{seed}{"_imu" if imu else ""}.yaml'
    if not file.exists():
        fit = fit_rig([recorded(robot, 'none', 5000 + seed)], None, load_rig('rigid_tool.yaml'))
        file.write_text(dump_rig(fit.rig))
    rig = load_rig(file)
    real = recorded(ARMS.get(effect, same_arm)(robot), effect, 6000 + seed)
    found = rig_source(rig).diagnose(real).diagnosis
    left = rig.robot.unexplained
    return {**_said(found), 'left': [1e3 * left.position, 1e3 * left.orientation]}


def _compared(real, joints, arm):
    simulated = shift_times(run(arm, joints), 1234.5)
    found = PairSource(load_rig('rigid_tool.yaml'), simulated).diagnose(real)
    ready: Any = found.ready  # nothing, if it was refused
    apart = {name: [1e3 * x for x in getattr(ready[0].tracking, name)[:4]]
             for name in ('translation', 'rotation') if ready}
    return {**_said(found.diagnosis), **apart}


def _rerun(real, joints, arm):
    return _run_again(real, third_party('arm', ArmSimulator(arm)))


def _by_mujoco(real, joints, arm):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.xml'
        path.write_text(mjcf_of(arm))
        robot = load_mujoco(str(path), imu='ft' if arm.imu else None)
        return _run_again(real, third_party('arm.xml', robot))


def _run_again(real, simulator):
    found = SimulatorSource(simulator, load_rig('rigid_tool.yaml')).diagnose(real)
    return {**_said(found.diagnosis),
            **{name: found.details[name] for name in ('runs', 'recomputed')}}


WAYS = {'rerun': _rerun, 'mujoco': _by_mujoco, 'compared': _compared,
        'drake': _compared, 'drake-mujoco': _by_mujoco}


def _said(d):
    return {'verdict': d.verdict, 'reason': d.reason,
            'effects': {e.name: {'p': round(e.probability, 3), **{
                k: [p.value, p.std] for k, p in e.parameters.items() if p.value}}
                for e in d.effects},
            'candidates': [(name, round(p, 3)) for name, p in d.candidates],
            'closed': d.gap.closed if d.gap else None, 'notes': d.notes,
            'where': [[p.stage, p.channel, p.phase] for p in d.localisation[:3]]}


def same(case, result):
    return all(case.get(k) == result.get(k) for k in ('effect', 'seed', 'way'))


def table(results, way):
    """Print what was told of each effect."""
    print('| effect | first | offered | false | verdict | size | explained | recomputed | CPU s |')
    print('|---|---|---|---|---|---|---|---|---|')
    names = {**dict.fromkeys(NONE, ''), **TRUTH, **OF_WAY.get(way, {})}
    for name, truth in names.items():
        rows = [r for r in results if r['effect'] == name and r['way'] == way]
        if rows:
            _row(name, truth, rows)


def _row(name, truth, rows):
    n, told = len(rows), [r for r in rows if truth in r['effects']]
    first = sum(next(iter(r['effects']), '') == truth for r in rows)
    offered = sum(not truth or truth in dict(r['candidates']) for r in rows)
    false = sum(bool(set(r['effects']) - {truth, 'unknown'}) for r in rows)
    sizes = ', '.join(_size(r['effects'][truth]) for r in told)
    closed, again = (', '.join(f'{100 * r[key]:.0f}' for r in told if r.get(key) is not None)
                     for key in ('closed', 'recomputed'))
    verdicts = ', '.join(sorted({r['verdict'] for r in rows}))
    print(f'| {name} | {first} of {n} | {offered} of {n} | {false} of {n} | {verdicts} | {sizes} '
          f'| {closed} | {again} | {np.mean([r["seconds"] for r in rows]):.0f} |')


def _size(effect):
    parts = {k: v for k, v in effect.items() if k != 'p'}
    name = max(parts, key=lambda k: abs(parts[k][0]) / (parts[k][1] or np.inf), default='')
    return f'{name} {parts[name][0]:.3g} +- {parts[name][1]:.1g}' if name else ''


def main():
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, required=True)
    parser.add_argument('--rerun', action='store_true',
                        help='run the simulation again with other numbers')
    parser.add_argument('--mujoco', action='store_true',
                        help='run it again as a model in MuJoCo, the robot integrated otherwise')
    parser.add_argument('--fit-rig', action='store_true',
                        help='compare with a rig that is fitted to another recording')
    parser.add_argument('--drake', action='store_true',
                        help='compare a robot in Drake by two recordings')
    parser.add_argument('--drake-mujoco', action='store_true',
                        help='compare a robot in Drake with a model in MuJoCo')
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--clean', type=int, default=4, help='recordings of a free arm without '
                        'an effect, beside one on a table and one with an Imu')
    parser.add_argument('--seeds', type=int, default=2, help='recordings of each effect')
    parser.add_argument('--first', type=int, default=0, help='the first seed')
    known = (*NONE, *TRUTH)
    parser.add_argument('--effects', nargs='*', choices=known, default=known)
    args = parser.parse_args()
    way = ('rerun' if args.rerun else 'mujoco' if args.mujoco
           else 'fit-rig' if args.fit_rig else 'drake' if args.drake
           else 'drake-mujoco' if args.drake_mujoco else 'compared')
    if way in IN_DRAKE and find_spec('pydrake') is None:
        print(f'skipped: pydrake is not installed ({installing("drake")})')
        return
    each = {'none': args.clean, **dict.fromkeys(NONE[1:], 1), **dict.fromkeys(TRUTH, args.seeds)}
    left_out = {'fit-rig': ('none, table', 'contact softness'),
                **dict.fromkeys(IN_DRAKE, NOT_IN_DRAKE)}.get(way, ())
    wanted = [{'effect': name, 'seed': args.first + i, 'way': way} for name in args.effects
              if name not in left_out for i in range(each[name])]
    if way == 'fit-rig':
        folder = args.out.with_suffix('')
        folder.mkdir(exist_ok=True)
        wanted = [{**one, 'folder': str(folder)} for one in wanted]
    table(resumed(answer, wanted, args.out, args.jobs, same), way)


if __name__ == '__main__':
    main()
