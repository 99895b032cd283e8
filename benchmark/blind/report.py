"""Figures of an opening as Markdown and pictures."""

from collections.abc import Mapping
from itertools import pairwise
import math
from pathlib import Path
from typing import Any

from blind.score import calibration_error, Figures, Rate, Value
import numpy as np


def render(figures: Figures, plan: Mapping[str, Any], run: Mapping[str, Any],
           opened: Mapping[str, Any]) -> str:
    """Return an opening as Markdown."""
    tool = run['tool']
    none = 'a fifth' if plan['none'] is None else plan['none']
    lines = [
        f'## Opening of {opened["opened"]}: {plan["count"]} cases, {plan["seeds"]} seeds', '',
        (f'{none} of the cases without effect, recordings of about {plan["seconds"]:.0f} s. Tool '
         f'{tool["commit"][:12]}{" with local changes" if tool["changed"] else ""}, SHA-256 of '
         f'its files (thresholds included) {tool["thresholds"][:16]}, recorded {run["started"]}, '
         'before the first case. '
         f'Master `{opened["master"]}` (SHA-256 published before: {plan["master_sha256"][:16]}); '
         + ', '.join(f'`{name}` {value}' for name, value in plan['outside_sha256'].items())
         + '.'), '',
        (f'Verdicts right: {figures.right} of {figures.total}. Right is: no gap where no effect '
         'is or none is visible (energy < 50), `not_excited` where too little moves, unknown '
         'where the library lacks it, else exactly the effects there are (one of an ambiguous '
         'set for single ones).'), '',
        '| figure | target | here | 95 % interval | cases | |', '|---|---|---|---|---|---|',
        *(_row(row) for row in figures.rows), '', '### Misses', '']
    lines += [f'- `{miss.identity}` {miss.kind}, {miss.truth}: {miss.answer}. {miss.why}.'
              for miss in sorted(figures.misses, key=lambda miss: (miss.kind, -miss.energy))]
    return '\n'.join(lines) + '\n'


def _row(row: Rate | Value) -> str:
    met = {None: '', True: 'met', False: 'missed'}[row.good] if row.target else ''
    if isinstance(row, Rate):
        low, high = row.interval
        share = f'{100 * row.hits / row.total:.1f} %' if row.total else 'none'
        return (f'| {row.what} | {row.target} | {share} | {100 * low:.1f} to {100 * high:.1f} % '
                f'| {row.hits} of {row.total} | {met} |')
    value = 'none' if math.isnan(row.value) else f'{row.value:.3g}'
    return f'| {row.what} | {row.target} | {value} | | {row.total} | {met} |'


def draw(figures: Figures, folder: Path) -> None:
    """Write ``detection.png``, ``confusion.png`` and ``reliability.png``."""
    from matplotlib.figure import Figure
    for name, (paint, size) in PICTURES.items():
        figure = Figure(figsize=size, layout='constrained')
        paint(figure.add_subplot(), figures)
        figure.savefig(folder / f'{name}.png', dpi=110)


def _detection(axes: Any, figures: Figures) -> None:
    energy = np.array([max(one, 0.1) for one, _ in figures.detection])
    found = np.array([ok for _, ok in figures.detection], float)
    edges = 10.0 ** np.arange(-1, 11)
    for low, high in pairwise(edges):
        inside = (energy >= low) & (energy < high)
        if inside.any():
            axes.plot(np.sqrt(low * high), found[inside].mean(), 'ko')
            axes.annotate(str(inside.sum()), (np.sqrt(low * high), found[inside].mean()),
                          xytext=(4, -10), textcoords='offset points')
    axes.plot(energy, found, '|', color='0.6')
    axes.axvline(50, ls=':', color='0.4')
    axes.set(xscale='log', xlabel='whitened energy of the effect, held out',
             ylabel='share called a gap', ylim=(-0.05, 1.05))


def _confusion(axes: Any, figures: Figures) -> None:
    truths = sorted({one for one, _ in figures.confusion})
    answers = sorted({one for _, one in figures.confusion} | set(truths))
    counts = np.array([[figures.confusion[truth, answer] for answer in answers]
                       for truth in truths])
    if not counts.size:
        return
    axes.imshow(counts, cmap='Greys', aspect='auto')
    for (i, j), count in np.ndenumerate(counts):
        if count:
            axes.text(j, i, count, ha='center', va='center',
                      color='white' if count > counts.max() / 2 else 'black')
    axes.set_xticks(range(len(answers)), answers, rotation=90)
    axes.set_yticks(range(len(truths)), truths)
    axes.set(xlabel='named first', ylabel='true')


def _reliability(axes: Any, figures: Figures) -> None:
    stated = figures.reliability
    axes.plot([0, 1], [0, 1], ':', color='0.5')
    for i in range(10):
        inside = [(p, ok) for p, ok in stated if i / 10 < p <= (i + 1) / 10]
        if inside:
            axes.plot(np.mean([p for p, _ in inside]), np.mean([ok for _, ok in inside]), 'ko',
                      ms=4 + 2 * math.sqrt(len(inside)))
    axes.set(xlabel='stated probability', ylabel='share that is so', xlim=(0, 1.02),
             ylim=(-0.02, 1.05),
             title=f'expected calibration error {calibration_error(stated):.3f}')


PICTURES = {'detection': (_detection, (6, 3.5)), 'confusion': (_confusion, (9, 8)),
            'reliability': (_reliability, (4.5, 4))}
"""Name -> how it is painted, size [inch]."""
