"""How much of each discrepancy an effect of the library could take up.

What the rows of aliases in background_kinds.py rest on:

    python benchmark/background_aliases.py --draws 5

On one held-out recording of a base: the share of the discrepancy's net energy that lies in the
span of an effect's columns (each parameter alone, each start of what shapes it), median over
draws. From 0.9 on the effect is an alias; what has many parameters takes up much by their number.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from collections.abc import Iterator
from itertools import product
from pathlib import Path
import sys

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'benchmark')]

import background_cases as cases
from background_energy import additions, Ground
from background_kinds import KINDS
from background_sizes import LATE
from forcecal_ros.core.geometry import Array
from forcecal_ros.effects import EFFECTS

SMALL = 0.2
"""Step of a parameter, in its typical size."""

SHOWN = 0.5
"""Share from which an effect is listed."""


def spans(name: str, ground: Ground, nuisances: Array) -> Iterator[Array]:
    """Yield the whitened columns of an effect at each start of what shapes it, orthonormal."""
    effect = EFFECTS[name]
    shapes = [q for q in effect.parameters if q.shapes and not q.name.startswith('point_')]
    for values in product(*(q.starts for q in shapes)):
        form = dict(zip((q.name for q in shapes), values))
        steps = {q.name: q.nominal + SMALL * (q.typical - q.nominal)
                 for q in effect.parameters if not q.shapes}
        rows = np.array([free(nuisances, ground.whitened(ground.departure({name: form | {k: v}})))
                         for k, v in steps.items()])
        s, turned = np.linalg.eigh(rows @ rows.T)
        kept = s > 1e-9 * s[-1]
        yield (turned[:, kept] / np.sqrt(s[kept])).T @ rows


def free(nuisances: Array, d: Array) -> Array:
    """Take off what the nuisances, however large, could take up."""
    return np.asarray(d - nuisances.T @ (nuisances @ d))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--base', choices=('rig', 'rigid'), default='rig')
    parser.add_argument('--draws', type=int, default=5)
    arguments = parser.parse_args()
    case = {'base': arguments.base, 'half': 'development'}
    ground = cases.ground_of(arguments.base, 1)
    names = [n for n in cases.possible(case) if n not in LATE]
    # an effect of a nuisance's name is what that nuisance would take up
    kept = {n: ground.nuisances(EFFECTS[n].nuisance) for n in names}
    basis = {n: list(spans(n, ground, kept[n])) for n in names}
    print('| kind | declared | takes up |\n|---|---|---|')
    for kind, entry in KINDS.items():
        found: dict[str, list[float]] = {n: [] for n in names}
        for draw in range(arguments.draws):
            law = entry.draw(np.random.default_rng(draw))
            raw = ground.whitened(additions(ground.rig, law, ground.motion))
            for n in names:
                d = free(kept[n], raw)
                found[n].append(max(float(np.sum((b @ d) ** 2)) for b in basis[n]) / (d @ d))
        medians = sorted(((float(np.median(v)), n) for n, v in found.items()), reverse=True)
        listed = ', '.join(f'{n} {share:.2f}' for share, n in medians if share > SHOWN)
        print(f'| {kind} | {", ".join(entry.alias)} | {listed} |', flush=True)


if __name__ == '__main__':
    main()
