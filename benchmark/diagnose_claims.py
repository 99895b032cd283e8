"""Does a patched rig shrink the gap as claimed? Recomputed on simulations whose truth is known.

    python benchmark/diagnose_claims.py
    python benchmark/diagnose_claims.py --coverage 200

For effects alone and in pairs: diagnoses a pair of noisy recordings, writes the patched rig to a
file, simulates the held-out commands with it as ``forcecal simulate --noise-free`` does, and takes
what remains of the true rig's signals without noise, sample by sample, in all 16 channels.
``closed`` is against the recalibrated rig. (Of the noisy recording itself, what remains after a
good fit is less than the scatter of its noise's variance.)
"""

import argparse
from dataclasses import replace
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
from typing import Any

from forcecal_ros.cli.many import each
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.diagnose.dataset import STREAM_SLICES
from forcecal_ros.diagnose.model.linearised import linearised_model
from forcecal_ros.diagnose.sources.rig import prepare_commanded, RigSource
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.file import dump_rig, load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

sys.path.insert(0, str(Path(__file__).parent))

import diagnose_cases as cases
from resumable import resumed

ENERGIES = ((50.0, 200.0), (200.0, 1000.0), (1000.0, 5000.0))
"""Within which coverage is counted apart."""

ALONE = ('wrench_delay', 'wrench_bias_drift', 'wrench_gain', 'wrench_crosstalk',
         'wrench_hysteresis', 'accel_delay', 'accel_misalignment', 'tool_mass', 'tool_stiffness',
         'tool_friction', 'robot_delay', 'base_tilt', 'contact_stiffness')
PAIRS = (('wrench_crosstalk', 'tool_friction'), ('robot_resonance', 'wrench_bias_drift'),
         ('tool_stiffening', 'accel_gain'), ('wall_position', 'wrench_delay'))


def plan(energies: tuple[float, ...]) -> list[dict[str, Any]]:
    """List the cases."""
    named = [(name,) for name in ALONE] + list(PAIRS)
    return [{'names': names, 'seed': 200 + i, 'energy': e}
            for e in energies for i, names in enumerate(named)]


def drawn(count: int, seed: int) -> list[dict[str, Any]]:
    """Draw single effects and their energies."""
    rng, names = np.random.default_rng(seed), list(cases.SHAPES)
    order = [names[i] for _ in range(-(-count // len(names))) for i in rng.permutation(len(names))]
    return [{'names': [name], 'seed': 1000 * seed + i,
             'energy': round(float(np.exp(rng.uniform(np.log(50.0), np.log(5000.0)))), 1)}
            for i, name in enumerate(order[:count])]


def noise_of(rig: Rig) -> Array:
    """RMS of one sample of each channel but those of joints, shape (16,)."""
    wrench, pose = rig.wrench_sensor, rig.pose_sensor
    assert rig.optidrive is not None
    return np.repeat([wrench.force_noise, wrench.torque_noise, rig.accelerometer.noise,
                      rig.optidrive.noise, pose.position_noise, pose.orientation_noise],
                     [3, 3, 3, 1, 3, 3])


def mean_squares(one: Recording, other: Recording) -> Array:
    """Mean squares of the difference of two recordings, but for their joints, shape (16,)."""
    out = np.zeros(STREAM_SLICES['joints'].start)
    for name, columns in STREAM_SLICES.items():
        if name == 'joints':
            continue
        a, b = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(a.t, b.t, atol=1e-6)
        if isinstance(a, PoseStream):
            turned = np.swapaxes(b.R_base_sensor, 1, 2) @ a.R_base_sensor
            rest = np.hstack([a.position - b.position,
                              Rotation.from_matrix(turned).as_rotvec()])
        else:
            rest = a.values - b.values
        out[columns] = np.mean(rest ** 2, axis=0)
    return out


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Make a case, diagnose it, and compare what was claimed with what is."""
    nominal = load_rig()
    effects = {n: cases.sized(n, case['energy']).values for n in case['names']}
    first, second = cases.recordings(case['seed'], effects)
    assert second is not None and second.target is not None
    outcome = RigSource(nominal).diagnose(first, second).outcome
    gap = outcome.diagnosis.gap
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'rig_patched.yaml'
        path.write_text(dump_rig(outcome.rig))
        patched = load_rig(path)
    pair = [prepare_commanded(first, nominal), prepare_commanded(second, nominal)]
    pair[1] = replace(pair[1], train=pair[1].held, held=pair[1].train)
    recalibrated = linearised_model(nominal, tuple(pair)).current()
    truth = simulate(cases.real_rig(case['seed'], effects), second.target, noise=False, steps=16)
    noise = noise_of(cases.noisy(nominal, cases.NOISE))

    def overall(rig: Rig) -> float:
        again = simulate(rig, second.target, noise=False)
        return float(np.sqrt(np.mean(mean_squares(truth, again) / noise ** 2)))

    return case | {
        'verdict': outcome.diagnosis.verdict, 'named': [e.name for e in outcome.diagnosis.effects],
        'claimed': gap.closed if gap else 0.0, 'ci95': gap.closed_ci95 if gap else (0.0, 0.0),
        'true': 1.0 - overall(patched) / overall(recalibrated)}


def print_coverage(results: list[dict[str, Any]]) -> None:
    """Print how often the interval covers, by the energy of the effect."""
    print('| energy | cases | named | interval covers | 95 % of that | median width | median of '
          'claimed less recomputed |\n' + '|---' * 7 + '|')
    for low, high in (*ENERGIES, (ENERGIES[0][0], ENERGIES[-1][1])):
        own = [r for r in results if low <= r['energy'] < high]
        named = [r for r in own if r['named'] and r['named'] != ['unknown']]
        if not named:
            continue
        covers = sum(r['ci95'][0] <= r['true'] <= r['ci95'][1] for r in named)
        between = binomtest(covers, len(named)).proportion_ci(method='wilson')
        width = 100.0 * np.median([r['ci95'][1] - r['ci95'][0] for r in named])
        off = 100.0 * np.median([r['claimed'] - r['true'] for r in named])
        print(f'| {low:g} to {high:g} | {len(own)} | {len(named)} | {covers} of {len(named)} | '
              f'{100 * between.low:.0f} to {100 * between.high:.0f} % | {width:.0f} points | '
              f'{off:+.1f} points |')


def main() -> None:
    """Run all and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--energies', type=float, nargs='+', default=[1e4])
    parser.add_argument('--coverage', type=int, default=0, help='cases drawn to count coverage')
    parser.add_argument('--seed', type=int, default=7, help='of those')
    parser.add_argument('-o', '--out', type=Path, default=Path('diagnose_coverage.jsonl'))
    arguments = parser.parse_args()
    if arguments.coverage:
        wanted = drawn(arguments.coverage, arguments.seed)
        print_coverage(resumed(run, wanted, arguments.out, arguments.jobs,
                               lambda case, result: case.items() <= result.items()))
        return
    wanted = plan(tuple(arguments.energies))
    print('| truth | energy of each | verdict | named | claimed (95 %) | recomputed |\n'
          + '|---' * 6 + '|')
    worst = 0.0
    for outcome in each(run, wanted, jobs=arguments.jobs):
        r = outcome.value
        if r is None:
            print(wanted[outcome.index], outcome.error, file=sys.stderr)
            continue
        low, high = r['ci95']
        print(f"| {' + '.join(r['names'])} | {r['energy']:g} | {r['verdict']} | "
              f"{' + '.join(r['named'])} | {100 * r['claimed']:.1f} % ({100 * low:.1f} to "
              f"{100 * high:.1f}) | {100 * r['true']:.1f} % |", flush=True)
        worst = max(worst, abs(r['claimed'] - r['true']))
    print(f'worst difference: {100 * worst:.1f} points')


if __name__ == '__main__':
    main()
