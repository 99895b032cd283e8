"""Which effects are found where small things are wrong that no library of effects has.

    python benchmark/diagnose_background.py --cases 40 --base rig --half development

Every recording holds three to six discrepancies of background_kinds.py, each of whitened energy
30 to 1e6, and in five of six cases an effect, or two, of 0.3 to 100 times their energy each
(background_cases.py). Bases: ``rig``, the paper's, commands known; ``rigid``, a tool of 1.2 kg
with all streams at 500, 200 or 125 Hz, in four of ten cases without commands; ``kuka``, a real
arm's wrench. What is tuned on the one half of the kinds is judged on the other.

First: the first candidate is the effect, or one of its alias class; ``unknown`` counts as a
candidate, in the second figure it does not. Effects that a discrepancy resembles, as its row
states, are neither right nor false. Interrupted, it goes on where it stopped.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
import sys
import time
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'benchmark')]

from background_cases import BASES, make, plan
from background_kinds import HALVES, KINDS
import background_kuka
from resumable import resumed

__all__ = ['make', 'plan']

UNKNOWN = 'unknown'

BINS = ('>= 10', '3 .. 10', '< 3', 'background alone')
"""Of the effect's energy, in that of the background."""

PROBABILITIES = (0.0, 0.2, 0.5, 0.8, 0.95, 1.0)
"""Edges of the bins of stated probability."""

LEAST = 0.01
"""Probability below which the log score tells no difference."""

HEAD = ('| base | effect : background | cases | first | first but for unknown | among candidates '
        '| false with p > 0.5 | verdicts | log score | CPU s (most) |')

Result = dict[str, Any]


def answer(case: dict[str, Any], first: Any, second: Any, compared: Any) -> Any:
    """Diagnose by commands where they are known, else by the measured motion."""
    from forcecal_ros.diagnose.sources.rig import RigSource, ToolSource
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rigid_tool import rigid_tool_of_calibration, rigid_tool_of_rig

    if case['base'] == 'kuka':
        body = rigid_tool_of_calibration(compared, load_rig('rigid_tool.yaml'))
        return ToolSource(body, compared).diagnose(first, second).diagnosis
    if first.target is None:
        return ToolSource(rigid_tool_of_rig(compared)).diagnose(first, second).diagnosis
    return RigSource(compared).diagnose(first, second).diagnosis


def run(case: dict[str, Any]) -> Result:
    """Make a case and diagnose it; what breaks is an answer, too."""
    first, second, compared, truth = make(case)
    began, d, error = time.process_time(), None, ''
    try:
        d = answer(case, first, second, compared)
    except Exception as broken:
        error = f'{type(broken).__name__}: {broken}'
    return case | {
        'truth': truth.effects, 'energies': truth.energies, 'background': truth.background,
        'reached': truth.ratio,
        'verdict': d.verdict if d else 'crashed', 'error': error,
        'candidates': list(d.candidates) if d else [], 'reason': d.reason if d else '',
        'named': [(e.name, e.probability) for e in d.effects] if d else [],
        'closed': d.gap.closed if d and d.gap else None,
        'seconds': round(time.process_time() - began, 2)}


# judging

def right_names(result: Result) -> set[str]:
    """Return the true effects and those of their alias classes."""
    from diagnose_effects import ALIASES

    truth = set(result['effects'])
    return truth.union(*(a for a in ALIASES if a & truth))


def neutral_names(result: Result) -> set[str]:
    """Return what is neither right nor false to name."""
    alike = {name for k in result['background'] for name in KINDS[k].alias}
    return alike - right_names(result)


def stated(result: Result) -> dict[str, float]:
    """Return every name with its probability, most probable first; neutral ones left out."""
    found: dict[str, float] = {}
    for name, p in (*result['candidates'], *result['named']):
        if name not in neutral_names(result):
            found[name] = max(p, found.get(name, 0.0))
    return dict(sorted(found.items(), key=lambda pair: -pair[1]))


def first_right(result: Result, unknown: bool) -> bool:
    """Say whether the first candidate is right, ``unknown`` being one or not."""
    names = [n for n in stated(result) if unknown or n != UNKNOWN]
    return bool(names) and names[0] in right_names(result)


def among(result: Result) -> bool:
    """Say whether each effect, or one of its alias class, is a candidate."""
    from diagnose_effects import ALIASES

    names = set(stated(result))
    return all(names & {n}.union(*(a for a in ALIASES if n in a)) for n in result['effects'])


def false_effect(result: Result) -> bool:
    """Say whether an effect that is not there is given more than one half."""
    right = right_names(result) | {UNKNOWN}
    return any(p > 0.5 for name, p in stated(result).items() if name not in right)


def log_score(result: Result) -> float:
    """Return the logarithm of what the truth was given: an effect, or none."""
    given = stated(result)
    if result['effects']:
        p = max((given.get(n, 0.0) for n in right_names(result)), default=0.0)
    else:
        p = 1.0 - max((q for n, q in given.items() if n != UNKNOWN), default=0.0)
    return float(np.log(max(LEAST, p)))


def bin_of(result: Result) -> str:
    """Return the bin of a result."""
    if not result['effects']:
        return BINS[3]
    return BINS[0] if result['reached'] >= 10.0 else BINS[1] if result['reached'] >= 3.0 else \
        BINS[2]


def base_of(result: Result) -> str:
    """Return the base as the table calls it."""
    return result['base'] + ('' if result.get('commands', True) else ', no commands')


# tables

def _share(flags: Iterable[bool]) -> str:
    flags = list(flags)
    return f'{sum(flags)} of {len(flags)}' if flags else ''


def row(results: Sequence[Result]) -> str:
    """Return a row of the table, from the number of cases on."""
    effect = [r for r in results if r['effects']]
    verdicts = Counter(r['verdict'] for r in results)
    seconds = [r['seconds'] for r in results]
    cells = [
        str(len(results)), _share(first_right(r, True) for r in effect),
        _share(first_right(r, False) for r in effect), _share(among(r) for r in effect),
        _share(false_effect(r) for r in results),
        ', '.join(f'{n} {word}' for word, n in verdicts.most_common()),
        f'{np.mean([log_score(r) for r in results]):.2f}',
        f'{np.mean(seconds):.0f} ({max(seconds):.0f})']
    return ' | '.join(cells)


def table(results: Sequence[Result]) -> str:
    """Return the results by base and bin."""
    lines = [HEAD, '|---' * 10 + '|']
    bases = sorted({base_of(r) for r in results})
    for base in [*bases, 'all'] if len(bases) > 1 else bases:
        for one in BINS:
            chosen = [r for r in results if base in (base_of(r), 'all') and bin_of(r) == one]
            if chosen:
                lines.append(f'| {base} | {one} | {row(chosen)} |')
    return '\n'.join(lines)


def reliability(results: Sequence[Result]) -> str:
    """Return how often what was stated with a probability was right."""
    pairs = [(p, name in right_names(r)) for r in results for name, p in stated(r).items()
             if name != UNKNOWN]
    lines = ['| probability | stated | mean | right |', '|---|---|---|---|']
    for low, high in pairwise(PROBABILITIES):
        inside = [(p, ok) for p, ok in pairs if low < p <= high]
        if inside:
            p, ok = np.mean(inside, axis=0)
            lines.append(f'| {low:g} .. {high:g} | {len(inside)} | {p:.2f} | {ok:.2f} |')
    return '\n'.join(lines)


def listing(results: Sequence[Result]) -> str:
    """Return one line for each case."""
    lines = ['| case | effects | ratio | background | verdict | candidates | |', '|---' * 7 + '|']
    for r in results:
        kinds = ', '.join(f'{k} {v:.0f}' for k, v in r['background'].items())
        listed = ', '.join(f'{n} {p:.2f}' for n, p in r['candidates'])
        word = ('first' if first_right(r, True) else 'behind unknown' if first_right(r, False)
                else 'missed') if r['effects'] else ''
        lines.append(f"| {base_of(r)} {r['half'][0]}{r['seed']}.{r['number']} | "
                     f"{' + '.join(r['effects']) or 'none'} | {r['reached']:.2g} | {kinds} | "
                     f"{r['verdict']}{': ' * bool(r['error'])}{r['error']} | {listed} | "
                     f"{word}{', FALSE' * false_effect(r)} |")
    return '\n'.join(lines)


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--cases', type=int, default=40, help='of each base')
    parser.add_argument('--base', choices=BASES, nargs='+', default=list(BASES))
    parser.add_argument('--half', choices=HALVES, default=HALVES[0])
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--list', action='store_true', help='print each case, too')
    parser.add_argument('-o', '--out', type=Path, default=Path('diagnose_background.jsonl'))
    return parser.parse_args()


def _identity(case: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(case[key] for key in ('base', 'half', 'seed', 'number'))


def main() -> None:
    """Run what is not done yet and print the tables."""
    arguments = _parsed()
    bases = [b for b in arguments.base if b != 'kuka' or background_kuka.there()]
    if len(bases) < len(arguments.base):
        print(f'kuka is left out: {background_kuka.DATA} is not there; set FORCECAL_DATA')
    wanted = [c for b in bases
              for c in plan(arguments.cases, b, arguments.half, arguments.seed)]
    done = resumed(run, wanted, arguments.out, arguments.jobs,
                   lambda case, result: _identity(case) == _identity(result))
    known = {_identity(r): r for r in done}
    results = [known[_identity(c)] for c in wanted if _identity(c) in known]
    if not results:
        return
    if arguments.list:
        print(listing(results) + '\n')
    print(f'{table(results)}\n\n{reliability(results)}')


if __name__ == '__main__':
    main()
