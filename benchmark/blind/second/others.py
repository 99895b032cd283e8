"""What simpler methods said of a part's cases, and how two parts compare, as Markdown."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

from blind.second.case import NONE, OUTSIDE
from blind.second.judged import Judged, LEAST
import numpy as np
from scipy.stats import fisher_exact

SEEN = 3.0
"""Standard errors from which the oracle sees an effect."""
METHODS = (('bic', 'white BIC'), ('everything', 'a fit of everything'),
           ('bounded', 'least squares within bounds'))


def table(told: Mapping[str, Mapping[str, Any]], cases: Sequence[Judged]) -> list[str]:
    """Return how simpler methods, and the tool, did on the cases that they were asked of."""
    asked = [c for c in cases if c.identity in told]
    without = [c for c in asked if c.kind == NONE]
    known = [c for c in asked if c.effect and not c.label['ambiguous']]
    loud = sum(told[c.identity]['rmse']['gap'] for c in without)
    lines = [(f'| {len(asked)} cases | an effect where none is | right effect or an alias first | '
              'log score |'), '|---|---|---|---|',
             f'| ranking by RMSE | a gap in {loud} of {len(without)} | names none | |']
    for method, word in METHODS:
        names = {c.identity: told[c.identity][method]['names'] for c in asked}
        named = sum(bool(set(names[c.identity]) - {*c.label['excused'], *c.label['doubtful']})
                    for c in without)
        right = sum(any(map(c.is_right, names[c.identity][:1])) for c in known)
        given = [_of_truth(c, told[c.identity][method]['odds']) for c in asked
                 if 'odds' in told[c.identity][method]]
        odds = f'{_logarithm(given):.2f}' if given else ''
        lines.append(f'| {word} | {named} of {len(without)} | {right} of {len(known)} | {odds} |')
    named = sum(bool(c.false_names) for c in without)
    right = sum(c.is_right(c.first) for c in known)
    lines.append(f'| the tool | {named} of {len(without)} | {right} of {len(known)} | '
                 f'{_logarithm([c.of_truth for c in asked]):.2f} |')
    found = [told[c.identity]['oracle'] for c in known]
    seen = sum(one['strength'] > SEEN * one['error'] for one in found)
    off = float(np.median([abs(one['strength'] - 1) for one in found])) if found else math.nan
    said = (f'beyond {SEEN:g} standard errors: {seen} of {len(found)}; '
            f'off by {100 * off:.0f} % at the median')
    word = 'the oracle, told the effect and its form, fits its strength'
    return [*lines, f'| {word} | | {said} | |', '']


def _of_truth(c: Judged, odds: Mapping[str, float]) -> float:
    if c.kind == OUTSIDE:
        return 0.0
    if c.kind == NONE:
        return odds.get('', 0.0)
    return max((p for name, p in odds.items() if name and c.is_right(name)), default=0.0)


def _logarithm(given: Sequence[float]) -> float:
    return float(np.mean(np.log(np.maximum(LEAST, given))))


def against(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return the rows of two parts' scores side by side, shares with Fisher's exact p."""
    before = {row['what']: row for row in one['rows']}
    lines = ['| figure | target | before | now | p |', '|---|---|---|---|---|']
    for now in other['rows']:
        was = before.get(now['what'])
        if was is None or 'hits' not in now:
            continue
        both = [[row['hits'], row['of'] - row['hits']] for row in (was, now)]
        p = f'{fisher_exact(both).pvalue:.2f}' if was['of'] and now['of'] else ''
        lines.append(f'| {now["what"]} | {now["target"]} | {was["hits"]} of {was["of"]} | '
                     f'{now["hits"]} of {now["of"]} | {p} |')
    lines.append(f'| nothing to be said against | | {one["right"]} of {one["total"]} | '
                 f'{other["right"]} of {other["total"]} | ' + '{:.2f} |'.format(fisher_exact(
                     [[x['right'], x['total'] - x['right']] for x in (one, other)]).pvalue))
    return lines
