"""Figures of one or more parts of the second edition; PROTOCOL.md defines them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
import math
from typing import Any, NamedTuple

from blind.score import calibration_error, Rate, Value, wilson
from blind.second.case import LIBRARY, NONE, OUTSIDE
from blind.second.judged import Judged, LEAST
from blind.second.rules import FIFTH, rules_of
import numpy as np

SLOWEST = 120.0
"""Processor time that a case may take [s]."""
ENERGIES = (0.0, 100.0, 1e3, 1e4, 1e5, 1e6, math.inf)
RATIOS = (0.3, 1.0, 3.0, 10.0, 30.0, math.inf)
FALSE = 'any case: a false name with p > 0.5'
SINCE_FIFTH = {
    FALSE: ('<= 5 %', 0.0, 0.05),
    'right effect or an alias first, ratio 3 to 10': ('>= 70 %', 0.70, 1.0),
    'log score (mean log of what the truth was given)': ('>= -0.8', -0.8, 0.0)}
"""Figure -> target, least and most, where they are others than in the parts before."""


class Bin(NamedTuple):
    """Cases between two energies or ratios: how many, detected, with the right name first."""

    low: float
    high: float
    total: int
    detected: int
    first: int


class Figures(NamedTuple):
    """All that parts give."""

    rows: tuple[Rate | Value, ...]
    by_energy: tuple[Bin, ...]
    by_ratio: tuple[Bin, ...]
    misses: tuple[str, ...]
    right: int
    total: int


def score(cases: Sequence[Judged], half: str = '') -> Figures:
    """Score cases, by the targets of a half; that of the cases where none is given."""
    known = [c for c in cases if c.kind == LIBRARY and not c.label['ambiguous']]
    misses = [c for c in cases if not c.right()]
    rows = [*_finding(cases), *_naming(known), *_stating(cases), *_shrinking(known),
            *_others(cases, known)]
    if cases and rules_of(half or cases[0].label['half']) is FIFTH:
        rows = [_aimed(row) for row in (*rows, *_since_fifth(cases, known))]
    return Figures(tuple(rows), _bins(known, 'energy', ENERGIES), _bins(
        [c for c in known if c.beside], 'ratio', RATIOS), tuple(c.identity for c in misses),
        len(cases) - len(misses), len(cases))


def _since_fifth(cases: Sequence[Judged], known: Sequence[Judged]) -> list[Rate]:
    return [_rate(FALSE, '', (bool(c.false_names) for c in cases)),
            _rate('arm in Drake, ratio >= 3: right or alias first', '', (
                c.is_right(c.first) for c in known
                if c.generator == 'drake' and c.label['ratio'] >= 3.0))]


def _aimed(row: Rate | Value) -> Rate | Value:
    """Return a row with the target that it has since part 5."""
    if row.what not in SINCE_FIFTH:
        return row
    target, least, most = SINCE_FIFTH[row.what]
    share = row.value if isinstance(row, Value) else row.hits / max(1, row.total)
    return row._replace(target=target, good=least <= share <= most if row.total else None)


def _rate(what: str, target: str, told: Iterable[bool], least: float = 0.0, most: float = 1.0
          ) -> Rate:
    told = list(told)
    share = sum(told) / len(told) if told else None
    good = None if share is None or not target else least <= share <= most
    return Rate(what, target, sum(told), len(told), good)


def _value(what: str, target: str, values: Iterable[Any], of: Callable[[Any], Any],
           most: float = math.inf) -> Value:
    values = list(values)
    value = float(of(values)) if values else math.nan
    return Value(what, target, value, len(values),
                 None if not values or not target else value <= most)


def _finding(cases: Sequence[Judged]) -> list[Rate]:
    none = [c for c in cases if c.kind == NONE]
    return [
        _rate('false alarm: an effect named where there is background only', '<= 5 %',
              (bool(c.false_names) for c in none if c.beside), most=0.05),
        _rate('false alarm: a gap where there is nothing at all', '',
              (c.detected for c in none if not c.beside)),
        _rate('outside the library: unknown, or a stated remainder larger than what is named',
              '>= 85 %', (c.remainder_told for c in cases if c.kind == OUTSIDE), 0.85),
        _rate('outside the library: detected', '',
              (c.detected for c in cases if c.kind == OUTSIDE)),
        _rate('unknown first where the library has it', '',
              (c.first == 'unknown' for c in cases if c.kind == LIBRARY))]


def _between(cases: Sequence[Judged], low: float, high: float, beside: bool = True
             ) -> list[Judged]:
    key = 'ratio' if beside else 'energy'
    return [c for c in cases if c.beside == beside and low <= c.label[key] < high]


def _naming(known: Sequence[Judged]) -> list[Rate]:
    def first(cases: Iterable[Judged]) -> list[bool]:
        return [c.is_right(c.first) for c in cases]

    real = [c for c in known if c.generator == 'real' and c.label['ratio'] >= 10.0]
    return [
        _rate('right effect or an alias first, ratio >= 10', '>= 90 %',
              first(_between(known, 10.0, math.inf)), 0.90),
        _rate('right effect or an alias first, ratio 3 to 10', '>= 75 %',
              first(_between(known, 3.0, 10.0)), 0.75),
        _rate('right effect or an alias first, ratio 0.3 to 3', '',
              first(_between(known, 0.0, 3.0))),
        _rate('among the candidates, ratio 0.3 to 3', '>= 75 %',
              (c.among for c in _between(known, 0.0, 3.0)), 0.75),
        _rate('right or alias first, no background, energy 100 to 5000', '>= 93 %',
              first(_between(known, 100.0, 5e3 * 1.1, beside=False)), 0.93),
        _rate('false additional effects with p > 0.5', '<= 8 %',
              (bool(c.false_names) for c in known), most=0.08),
        _rate('real motion, ratio >= 10: right or alias first', '>= 80 %', first(real), 0.80),
        _rate('real motion, ratio >= 10: wrong with p > 0.9', '0', (
            any(c.stated[name] > 0.9 for name in c.false_names) for c in real), most=0.0)]


def _stating(cases: Sequence[Judged]) -> list[Value]:
    pairs = [pair for c in cases for pair in c.pairs()]
    shares = {kind: sum(c.kind == kind for c in cases) / len(cases)
              for kind in (NONE, OUTSIDE, LIBRARY)}
    effects = len({c.effect for c in cases if c.effect}) or 1
    frequent = [shares[c.kind] / (effects if c.kind == LIBRARY else 1) for c in cases]
    never = [1.0 if c.kind == NONE else LEAST for c in cases]
    return [
        _value('expected calibration error, all cases', '<= 0.05', pairs, calibration_error, 0.05),
        _value('log score (mean log of what the truth was given)', '',
               (c.of_truth for c in cases), _logarithm),
        _value('log score of frequencies that one knew beforehand', '', frequent, _logarithm),
        _value('log score of always none', '', never, _logarithm),
        _value('Brier score', '', ((1 - c.of_truth)**2 for c in cases), np.mean)]


def _logarithm(given: Sequence[float]) -> float:
    return float(np.mean(np.log(np.maximum(LEAST, given))))


def _shrinking(known: Sequence[Judged]) -> list[Rate | Value]:
    stated = [c for c in known if c.alone and 'closed_ci95' in c.gap]

    def width(c: Judged) -> float:
        low, high = c.gap['closed_ci95']
        return float(100 * (high - low))

    return [
        _rate('interval of the shrink covers the truth', '90 to 99 %', (
            c.gap['closed_ci95'][0] <= c.shrink <= c.gap['closed_ci95'][1] for c in stated),
            0.90, 0.99),
        _value('median width of that interval, ratio >= 3 [points]', '<= 15',
               (width(c) for c in stated if not c.beside or c.label['ratio'] >= 3.0), np.median,
               15.0),
        _value('median of stated less true shrink [points]', '',
               (100 * (c.gap['closed'] - c.shrink) for c in stated), np.median)]


def _others(cases: Sequence[Judged], known: Sequence[Judged]) -> list[Rate | Value]:
    deviations = [d for c in known if (d := c.deviation()) is not None]
    begun = [c for c in known if c.label['onset'] is not None]
    times = [c.answer['cpu_seconds'] for c in cases]
    return [
        _rate('parameter within 2 stated sigma', '90 to 98 %', (abs(d) <= 2 for d in deviations),
              0.90, 0.98),
        _rate('begins half-way: right or alias first', '', (c.is_right(c.first) for c in begun)),
        _value('error of a stated begin, median [s]', '', (
            abs(x) for c in begun if (x := c.onset_error()) is not None), np.median),
        _rate('crash, or a number that is none', '0', (
            c.verdict == 'crashed' or not all(math.isfinite(p) for p in c.stated.values())
            for c in cases), most=0.0),
        _rate('more than 120 s of processor time', '0', (one > SLOWEST for one in times),
              most=0.0),
        _value('processor time, median [s]', '', times, np.median)]


def _bins(cases: Sequence[Judged], key: str, edges: Sequence[float]) -> tuple[Bin, ...]:
    found = []
    for low, high in pairwise(edges):
        inside = [c for c in cases if low <= c.label[key] < high]
        found.append(Bin(low, high, len(inside), sum(c.detected for c in inside),
                         sum(c.is_right(c.first) for c in inside)))
    return tuple(found)


def surely(row: Rate) -> bool:
    """Tell whether the whole of Wilson's interval meets a target that is met."""
    low, high = wilson(row.hits, row.total)
    bounds = [float(one) / 100 for one in row.target.replace('%', '').split()
              if one.replace('.', '').isdigit()]
    if row.target.startswith('<=') or row.target == '0':
        return high <= bounds[0]
    return low >= bounds[0] and (len(bounds) < 2 or high <= bounds[1])


def judged(labels: Mapping[str, Mapping[str, Any]], answers: Mapping[str, Mapping[str, Any]]
           ) -> list[Judged]:
    """Return the cases that have an answer."""
    return [Judged(one, labels[one], answer) for one, answer in answers.items()]
