"""Figures of the second edition as a document and as Markdown, and whether they are right."""

from collections.abc import Iterator, Sequence
import math
from typing import Any

from blind.score import Rate, Value
from blind.second.case import NONE
from blind.second.judged import Judged
from blind.second.others import SEEN, table
from blind.second.score import Bin, Figures, judged, score, surely
from blind.second.sealing import Part


def cases_of(part: Part) -> list[Judged]:
    """Return the answered cases of an opened part."""
    return judged(part.read('opened')['labels'], part.read('answers'))


def figures_of(parts: Sequence[Part]) -> Figures:
    """Return the figures of parts together, which are of one state of the tool."""
    return score([c for part in parts for c in cases_of(part)])


def plain(figures: Figures) -> dict[str, Any]:
    """Return figures as a document."""
    rows = [{'what': row.what, 'target': row.target, 'met': row.good,
             **({'hits': row.hits, 'of': row.total} if isinstance(row, Rate) else
                {'value': None if math.isnan(row.value) else round(row.value, 6),
                 'of': row.total})} for row in figures.rows]
    return {'rows': rows, 'right': figures.right, 'total': figures.total,
            'misses': list(figures.misses)}


def faults(part: Part) -> Iterator[str]:
    """Yield what does not follow from the answers."""
    figures = figures_of([part])
    if plain(figures) != part.read('scores'):
        yield 'scores.json does not follow from answers and labels'
    if render(part, figures) != (part.public / 'RESULTS.md').read_text():
        yield 'RESULTS.md does not follow from answers and labels'


def render(part: Part, figures: Figures) -> str:
    """Return a part as Markdown."""
    plan, run, opened = (part.read(one) for one in ('plan', 'run', 'opened'))
    bound, answers = part.read('commitments'), part.read('answers')
    counts = ', '.join(f'{count} {name}' for name, count in plan['counts'].items() if count)
    left = len(bound) - len(answers)
    lines = [
        '---', 'orphan: true', '---', '',
        f'# {part.public.name}: {len(bound)} cases ({counts}), {plan["half"]}', '',
        (f'Sealed {plan["begun"]}, run from {run["started"]}, opened {opened["opened"]}. Tool '
         f'{run["tool"]["commit"][:12]}{" with local changes" if run["tool"]["changed"] else ""}, '
         f'SHA-256 of its files {run["tool"]["files"][:16]}. Master `{opened["master"]}` (SHA-256 '
         f'published before: {plan["master_sha256"][:16]}); sealed half '
         f'{plan["sealed_sha256"][:16]}.'), '',
        f'{len(answers)} cases have an answer; not run, last in the order: {left}.', '',
        f'Nothing to be said against {figures.right} of {figures.total}.', '',
        '| figure | target | here | 95 % interval | cases | |', '|---|---|---|---|---|---|',
        *(_row(row) for row in figures.rows), '',
        *_bins('energy', figures.by_energy), *_bins('ratio', figures.by_ratio),
        *_baselines(part),
        '## Every case', '',
        '| case | kind | truth | energy | ratio | beside it | verdict | stated | | CPU s |',
        '|---' * 10 + '|', *(_case(c) for c in cases_of(part))]
    return '\n'.join(lines) + '\n'


def _row(row: Rate | Value) -> str:
    met = '' if row.good is None else ('met' if row.good else 'missed')
    if isinstance(row, Value):
        value = 'none' if math.isnan(row.value) else f'{row.value:.3g}'
        return f'| {row.what} | {row.target} | {value} | | {row.total} | {met} |'
    low, high = row.interval
    if met == 'met' and surely(row):
        met = 'surely met'
    share = f'{100 * row.hits / row.total:.0f} %' if row.total else 'none'
    return (f'| {row.what} | {row.target} | {share} | {100 * low:.0f} to {100 * high:.0f} % | '
            f'{row.hits} of {row.total} | {met} |')


def _bins(word: str, bins: Sequence[Bin]) -> list[str]:
    lines = [f'| {word} of library effects | cases | detected | right or alias first |',
             '|---|---|---|---|']
    lines += [f'| {one.low:g} to {one.high:g} | {one.total} | {one.detected} | {one.first} |'
              for one in bins if one.total]
    return [*lines, '']


def _baselines(part: Part) -> list[str]:
    """Return what simpler methods said of the same cases, where they were asked."""
    if not (part.public / 'baselines.json').exists():
        return []
    told, cases = part.read('baselines'), [c for c in cases_of(part) if c.generator == 'rig']
    if any('odds' in one['bic'] for one in told.values()):  # asked of every generator
        return table(told, cases_of(part))
    without = [c for c in cases if c.kind == NONE]
    known = [c for c in cases if c.effect and not c.label['ambiguous']]
    lines = ['| on the rig | a gap where no effect is | right effect or an alias first |',
             '|---|---|---|']
    loud = sum(told[c.identity]['rmse']['gap'] for c in without)
    lines.append(f'| ranking by RMSE | {loud} of {len(without)} | names none |')
    for method, word in (('bic', 'white BIC'), ('everything', 'a fit of everything'),
                         ('bounded', 'bounded least squares')):
        if any(method not in told[c.identity] for c in cases):
            continue  # a part that was opened before it was asked
        names = {c.identity: told[c.identity][method]['names'] for c in cases}
        loud = sum(bool(names[c.identity]) for c in without)
        right = sum(any(map(c.is_right, names[c.identity][:1])) for c in known)
        lines.append(f'| {word} | {loud} of {len(without)} | {right} of {len(known)} |')
    sees = [told[c.identity]['oracle'] for c in known if 'oracle' in told[c.identity]]
    if sees:
        seen = sum(one['strength'] > SEEN * one['error'] for one in sees)
        lines.append('| the oracle, which is told the effect and fits its strength | | beyond '
                     f'{SEEN:g} standard errors: {seen} of {len(sees)} |')
    right = sum(c.is_right(c.first) for c in known)
    named = sum(bool(c.false_names) for c in without)
    return [*lines, f'| the tool | {named} of {len(without)} name one | {right} of {len(known)} |',
            '']


def _case(c: Judged) -> str:
    label = c.label
    beside = [f'{name} {energy:.2g}' for name, energy in label['background'].items()]
    if label['own']:
        beside.append(f'its own {label["own"]:.2g}')
    stated = ', '.join(f'{name} {p:.2f}' for name, p in c.stated.items())
    ratio = f'{label["ratio"]:.2g}' if c.beside and label['effect'] else ''
    odd = ' half-way' * (label['onset'] is not None) + ' ambiguous' * label['ambiguous']
    energy = f'{label["energy"]:.3g}' if label['energy'] else ''
    return (f'| {c.generator} {c.identity} | {c.kind}{odd} | {label["effect"]} | {energy} | '
            f'{ratio} | {", ".join(beside)} | {c.verdict} | {stated} | '
            f'{"" if c.right() else "**missed**"} | {c.answer["cpu_seconds"]:.0f} |')
