"""A robot against somebody else's simulation of it: what two bags of the same commands tell.

    pip install mujoco
    python benchmark/any_simulator.py --out any_simulator.jsonl [--rerun | --fit-rig] [--jobs N]
        [--clean N] [--seeds N]

An arm in MuJoCo stands for the robot: integrated four times as finely as its simulation (by Euler,
too: MuJoCo's RK4 is 0.1 to 0.3 N from it on this arm at any step, which is a gap of its own), with
every number off by 0.5 to 2 %, with one effect or none, a sensor that nobody zeroed,
and the noise of a UR's wrench (0.15 N, 6 mN m) and of poses (0.1 mm, 0.2 mrad). What is in the
joints moves the arm otherwise and is no departure of the wrench from the motion: there, no effect
is the right answer of two bags, and the difference of the motions tells it. With --rerun the
simulation is run again with other numbers, and what is in the joints has a name. With --fit-rig
there is no simulation: a rig is fitted to a recording of the robot without an effect, and others
of the same robot and day are compared with that.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from dataclasses import replace
from pathlib import Path
import sys
import time

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from forcecal_ros.diagnose.by_commands import diagnose
from forcecal_ros.diagnose.by_simulated import diagnose_simulated, Pair
from forcecal_ros.diagnose.by_simulator import diagnose_rerun
from forcecal_ros.diagnose.by_tracked import diagnose_tracked, is_tracked
from forcecal_ros.diagnose.inputs.alignment import shifted
from forcecal_ros.geometry import rotation_from_vector
from forcecal_ros.rig_fit.fit import fit_rig
from forcecal_ros.simulators.rig.file import dump_rig, load_rig
from forcecal_ros.simulators.third_party import third_party
from mujoco_arm import Arm, ArmSimulator, commands, run, varied
import numpy as np
from resumable import resumed

SECONDS = 30.0
NOISE = np.array([0.15] * 3 + [0.006] * 3)
PLACE, TURN = 1e-4, 2e-4


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


def late(t, w):
    return np.stack([np.interp(t - 0.008, t, x) for x in w.T], axis=1)


def crosstalk(t, w):
    return w + 0.03 * np.outer(w[:, 0], np.eye(6)[1])


def gain(t, w):
    return w * (1.0 + 0.03 * np.eye(6)[0])


def drift(t, w):
    return w + np.outer(t, 0.02 * np.eye(6)[2])


RERUN = {'payload': 'payload', 'tilt': 'tilt.x', 'joint friction': 'frictionloss[2]',
         'joint gain': 'kp[1]'}
"""Name -> the number of the simulator that tells it, where it can be run again."""

ARMS = {'payload': (payload, 'tool_mass'), 'tilt': (tilt, 'base_tilt'),
        'cable': (cable, 'cable_force'), 'joint friction': (friction, ''),
        'joint gain': (stiffness, '')}
"""Name -> what it makes of an arm, and how the library calls it; '' where the wrench is right."""

SENSORS = {'delay': (late, 'wrench_delay'), 'crosstalk': (crosstalk, 'wrench_crosstalk'),
           'gain': (gain, 'wrench_gain'), 'drift': (drift, 'wrench_bias_drift')}


def zero(rng):
    """Return what a sensor reads that nobody zeroed."""
    return rng.uniform(-1.0, 1.0, 6) * [10.0, 10.0, 10.0, 0.5, 0.5, 0.5]


def measured(recording, effect, rng, of_sensor=None):
    """Give a recording what a sensor adds."""
    wrench, pose = recording.wrench, recording.pose
    values = wrench.values + (zero(rng) if of_sensor is None else of_sensor)
    if effect in SENSORS:
        values = SENSORS[effect][0](wrench.t, values)
    values = values + rng.normal(size=values.shape) * NOISE
    turned = rotation_from_vector(rng.normal(size=(len(pose), 3)) * TURN)
    pose = replace(pose, position=pose.position + rng.normal(size=pose.position.shape) * PLACE,
                   R_base_sensor=pose.R_base_sensor @ turned)
    return replace(recording, wrench=replace(wrench, values=values), pose=pose)


def answer(case):
    """Diagnose one case."""
    effect, seed = case['effect'], case['seed']
    if case.get('fit'):
        return {**case, **_fitted(effect, seed, Path(case['fit']))}
    rng = np.random.default_rng([seed, *effect.encode()])
    joints = commands(seed, SECONDS)
    robot = varied(Arm(step=0.00025), rng)
    if effect in ARMS:
        robot = ARMS[effect][0](robot)
    real = measured(run(robot, joints, every=0.004), effect, rng)
    return {**case, **(_rerun if case['rerun'] else _compared)(real, joints)}


def _fitted(effect, seed, folder):
    rng = np.random.default_rng([seed, 1])
    robot, of_sensor = varied(Arm(step=0.00025), rng), zero(rng)

    def recorded(arm, effect, motion):
        return measured(run(arm, commands(motion, SECONDS), every=0.004), effect,
                        np.random.default_rng([motion, *effect.encode()]), of_sensor)

    file = folder / f'robot{seed}.yaml'
    if not file.exists():
        fit = fit_rig([recorded(robot, 'none', 5000 + seed)], None, load_rig('rigid_tool.yaml'))
        file.write_text(dump_rig(fit.rig))
    rig = load_rig(file)
    real = recorded(ARMS[effect][0](robot) if effect in ARMS else robot, effect, 6000 + seed)
    return _said((diagnose_tracked if is_tracked(rig) else diagnose)(real, None, rig).diagnosis)


def _compared(real, joints):
    found = diagnose_simulated(Pair(real, shifted(run(Arm(), joints), 1234.5)), None,
                               load_rig('rigid_tool.yaml'))
    return {**_said(found.outcome.diagnosis),
            'translation': [1e3 * x for x in found.tracking[0].translation[:4]],
            'rotation': [1e3 * x for x in found.tracking[0].rotation[:4]]}


def _rerun(real, joints):
    began = time.process_time()
    found = diagnose_rerun(real, None, third_party('arm', ArmSimulator()),
                           load_rig('rigid_tool.yaml'))
    return {**_said(found.outcome.diagnosis), 'runs': found.runs,
            'recomputed': found.recomputed, 'seconds': time.process_time() - began}


def _said(d):
    return {'verdict': d.verdict, 'reason': d.reason,
            'effects': {e.name: {'p': round(e.probability, 3), **{
                k: [p.value, p.std] for k, p in e.parameters.items() if p.value}}
                for e in d.effects},
            'candidates': [(name, round(p, 3)) for name, p in d.candidates],
            'closed': d.gap.closed if d.gap else None}


def same(case, result):
    return all(case.get(k) == result.get(k) for k in ('effect', 'seed', 'rerun', 'fit'))


def table(results):
    print('| effect | first | effects named falsely | size | closed |')
    print('|---|---|---|---|---|')
    names = {name: truth for name, (_, truth) in {**ARMS, **SENSORS}.items()}
    if any(r['rerun'] for r in results):
        names |= RERUN
    for name, truth in {'none': '', **names}.items():
        rows = [r for r in results if r['effect'] == name]
        if not rows:
            continue
        first = sum(next(iter(r['effects']), '') == truth for r in rows)
        false = sum(bool(set(r['effects']) - {truth}) for r in rows)
        sizes = ', '.join(_size(r['effects'][truth]) for r in rows if truth in r['effects'])
        closed = [r['closed'] for r in rows if truth and r['closed'] is not None]
        print(f'| {name} | {first} of {len(rows)} | {false} of {len(rows)} | {sizes} | '
              f'{100 * np.mean(closed) if closed else 0:.0f} % |')


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
    parser.add_argument('--fit-rig', action='store_true',
                        help='compare with a rig that is fitted to another recording')
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--clean', type=int, default=20, help='recordings without an effect')
    parser.add_argument('--seeds', type=int, default=2, help='recordings of each effect')
    args = parser.parse_args()
    wanted = [{'effect': 'none', 'seed': 100 + i, 'rerun': args.rerun} for i in range(args.clean)]
    wanted += [{'effect': name, 'seed': i, 'rerun': args.rerun} for name in (*ARMS, *SENSORS)
               for i in range(args.seeds)]
    if args.fit_rig:
        folder = args.out.with_suffix('')
        folder.mkdir(exist_ok=True)
        wanted = [{**one, 'fit': str(folder)} for one in wanted]
    table(resumed(answer, wanted, args.out, args.jobs, same))


if __name__ == '__main__':
    main()
