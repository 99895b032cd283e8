"""How many ambiguous diagnoses one more recording decides, along the motion planned for them.

    python benchmark/next_recording.py --out next.jsonl [--arm] [--wanted 10] [--jobs 2]

A recording whose motion says little (below 0.3 Hz on the rig, joints that turn a third as far as
usual on the arm) is diagnosed. Where the verdict is ``ambiguous``, or nothing is named of
several candidates, ``forcecal plan --after`` plans a motion for these, the same robot records it,
and ``forcecal diagnose --prior`` continues. On the rig the recordings are compared with commands,
with --arm (mujoco_arm.py) with those of a simulation along the same joint commands. Cases are
drawn from seeds until --wanted are undecided. ``single``: one effect is named, and no other is
left among the candidates; ``right``: it is the true one.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
import json
from pathlib import Path
import sys
import tempfile

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from diagnose_cases import real_rig, sized, trajectory
from forcecal_ros.cli.main import main as forcecal
from forcecal_ros.core.geometry import quaternion_from_matrix, rotation_vector
from forcecal_ros.diagnose.plan import plan_for
from forcecal_ros.effects import EFFECTS
from forcecal_ros.io.bags import write_recording
from forcecal_ros.motion.limits import Limits
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

ON_RIG = ('wrench_delay', 'wrench_lowpass', 'accel_delay', 'accel_resonance', 'wrench_gain',
          'tool_com', 'wrench_crosstalk', 'base_tilt', 'cable_force', 'tool_stiffness',
          'wrench_hysteresis', 'robot_delay', 'tool_damping')
ENERGIES = (3e4, 1e5)
MOST = {'accel_resonance': 3e4}
"""Energy at which the library ends."""

ROOM = 0.15
"""Of the arm's flange around where it starts [m]."""

ON_ARM = ('delay', 'crosstalk', 'gain', 'tilt', 'cable', 'payload')


def on_rig(number, folder):
    """Return the truth and a function that records and diagnoses along a motion."""
    name = ON_RIG[number % len(ON_RIG)]
    energy = ENERGIES[number // len(ON_RIG) % len(ENERGIES)]
    robot = real_rig(number, {name: sized(name, min(energy, MOST.get(name, energy))).values})

    def recorded(word, target, phases, seed):
        one = simulate(robot, target, seed=seed, steps=16)
        write_recording(folder / word, replace(one, phases=phases, contact_truth=None))
        return ['--rig', 'nominal']

    def planned(candidates):
        motion = plan_for(load_rig(), contact=touches(candidates), effects=candidates).motion
        return motion.target, motion.phases

    return name, recorded, trajectory(0, 'slow'), planned


def on_arm(number, folder):
    """Do the same of an arm in MuJoCo, compared with a simulation of it."""
    from any_simulator import ARMS, measured, same_arm, TRUTH
    from mujoco_arm import Arm, commands, forward, HOME, model_of, PERIOD, run, varied

    name = ON_ARM[number % len(ON_ARM)]
    rng = np.random.default_rng([number, *name.encode()])
    robot = ARMS.get(name, same_arm)(varied(Arm(step=0.00025), rng))
    nominal = model_of(Arm())
    home = [one[0] for one in forward(nominal, HOME[np.newaxis])]

    def recorded(word, joints, phases, seed):
        real = measured(run(robot, joints, every=0.004), name, np.random.default_rng(seed))
        write_recording(folder / word, replace(real, phases=phases))
        write_recording(folder / f'{word}_simulated', run(Arm(), joints))
        return ['--simulated', folder / f'{word}_simulated']

    def planned(candidates):
        rig = load_rig('rigid_tool.yaml')
        x, y, z, w = quaternion_from_matrix(home[1]).tolist()
        rig = replace(rig, home=replace(rig.home, position=tuple(home[0].tolist()),
                                        orientation_xyzw=(x, y, z, w)))
        motion = plan_for(rig, contact=False, effects=candidates, limits=Limits(
            workspace_min=home[0] - ROOM, workspace_max=home[0] + ROOM)).motion
        target = motion.target
        at = np.arange(target.t[0], target.t[-1], PERIOD)
        nearest = np.searchsorted(target.t, at).clip(max=len(target.t) - 1)
        return followed(nominal, HOME, target.position[nearest],
                        target.R_base_sensor[nearest]), motion.phases

    slow = commands(number, 24.0)
    return TRUTH[name], recorded, (HOME + 0.3 * (slow - HOME), ()), planned


def followed(model, start, position, R):
    """Return joints that bring the sensor to poses, by Newton's steps from one to the next."""
    import mujoco

    data, site, q = mujoco.MjData(model), model.site('ft').id, start.copy()
    there, about = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    out = np.empty((len(position), len(start)))
    for i, (x, turn) in enumerate(zip(position, R)):
        for _ in range(3):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, there, about, site)
            now = data.site_xmat[site].reshape(3, 3)
            off = np.concatenate([x - data.site_xpos[site],
                                  rotation_vector(turn @ now.T)])
            J = np.vstack([there, about])
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), off)
        out[i] = q
    return out


def touches(candidates):
    return any(EFFECTS[name].excited_by == ('contact',) for name in candidates)


def said(folder, word, options):
    """Diagnose a recording; return the document."""
    out = folder / f'gap_{word}'
    status = forcecal(['diagnose', str(folder / word), *map(str, options), '-o', str(out),
                       '--quiet'])
    return json.loads((out / 'diagnosis.json').read_text()) if status == 0 else {
        'verdict': f'status {status}', 'effects': [], 'candidates': []}


def short(document):
    return {'verdict': document['verdict'],
            'effects': [e['name'] for e in document['effects'] if e['name'] != 'unknown'],
            'candidates': {c['name']: round(c['probability'], 3)
                           for c in document['candidates']}}


def tried(job):
    """Diagnose a case; where that is undecided record once more, and diagnose again."""
    number, arm = job
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        truth, recorded, motion, planned = (on_arm if arm else on_rig)(number, folder)
        first = said(folder, 'first', recorded('first', *motion, 2 * number))
        out = {'number': number, 'truth': truth, 'first': short(first)}
        left = [c for c in out['first']['candidates'] if c in EFFECTS]
        if first['verdict'] == 'ambiguous' or (not out['first']['effects'] and len(left) > 1):
            options = recorded('second', *planned(left), 2 * number + 1)
            out['alone'] = short(said(folder, 'second', options))
            out['second'] = short(said(folder, 'second', [
                *options, '--prior', folder / 'gap_first']))
    return out


def main():
    """Try cases until enough are undecided, and print what became of these."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, required=True, help='where each case is kept')
    parser.add_argument('--arm', action='store_true')
    parser.add_argument('--wanted', type=int, default=10, help='undecided cases (10)')
    parser.add_argument('--most', type=int, default=60, help='cases that are tried (60)')
    parser.add_argument('--jobs', type=int, default=2)
    args = parser.parse_args()
    done = [json.loads(line) for line in args.out.read_text().splitlines()] \
        if args.out.exists() else []
    with ProcessPoolExecutor(args.jobs) as pool:
        while sum('second' in one for one in done) < args.wanted and len(done) < args.most:
            numbers = range(len(done), min(args.most, len(done) + 2 * args.jobs))
            for one in pool.map(tried, [(n, args.arm) for n in numbers]):
                done.append(one)
                with args.out.open('a') as file:
                    file.write(json.dumps(one) + '\n')
    print('| truth | candidates of the first | the second alone | both | single | right |')
    print('|---|---|---|---|---|---|')
    asked = [one for one in done if 'second' in one][:args.wanted]
    for one in asked:
        effects = one['second']['effects']
        cells = [one['truth'], *(f'{v["verdict"]}: ' + ', '.join(
            f'{name} {p:.2f}' for name, p in v['candidates'].items())
            for v in (one['first'], one['alone'], one['second']))]
        print(f'| {" | ".join(cells)} | {"yes" if single(one) else "no"} '
              f'| {"yes" if effects == [one["truth"]] else "no"} |')
    right = sum(one['second']['effects'] == [one['truth']] for one in asked)
    print(f'\nof {len(done)} recordings {len(asked)} were undecided; after one more '
          f'{sum(map(single, asked))} are single, {right} right')


def single(one):
    """Say whether one effect is named, and no other is likelier than 0.1."""
    found = one['second']
    return len(found['effects']) == 1 and not [
        name for name, p in found['candidates'].items()
        if p > 0.1 and name not in (*found['effects'], 'unknown')]


if __name__ == '__main__':
    main()
