"""Labels and answers to figures, each with its Wilson interval, and the misses one by one."""

from collections import Counter
from collections.abc import Iterable, Mapping
import math
from typing import Any, NamedTuple

from blind.answered import Answered, same_class
import numpy as np


class Rate(NamedTuple):
    """``hits`` of ``total``, with the target as it is written down."""

    what: str
    target: str
    hits: int
    total: int
    good: bool | None

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval."""
        return wilson(self.hits, self.total)


class Value(NamedTuple):
    """A number that is no share."""

    what: str
    target: str
    value: float
    total: int
    good: bool | None


class Miss(NamedTuple):
    """A case that was not answered rightly."""

    identity: str
    kind: str
    truth: str
    energy: float
    answer: str
    why: str


class Figures(NamedTuple):
    """All that an opening gives."""

    rows: tuple[Rate | Value, ...]
    misses: tuple[Miss, ...]
    right: int
    total: int
    detection: tuple[tuple[float, bool], ...]
    confusion: Counter[tuple[str, str]]
    reliability: tuple[tuple[float, bool], ...]


def wilson(count: int, total: int, z: float = 1.959964) -> tuple[float, float]:
    """Return Wilson's interval of a share; (0, 1) of nothing."""
    if not total:
        return 0.0, 1.0
    p = count / total
    middle = (p + z * z / (2 * total)) / (1 + z * z / total)
    half = z * math.sqrt(p * (1 - p) / total + z * z / (4 * total**2)) / (1 + z * z / total)
    return max(0.0, middle - half), min(1.0, middle + half)


def score(labels: Mapping[str, Mapping[str, Any]], results: Mapping[str, Mapping[str, Any]]
          ) -> Figures:
    """
    Score a run.

    Parameters
    ----------
    labels : mapping
        Id -> label, see :func:`blind.truth.describe`.
    results : mapping
        Id -> ``document`` (diagnosis.json), ``seconds``, ``cpu_seconds``, ``route``.

    Returns
    -------
    Figures
    """
    cases = [Answered(one, labels[one], results[one]) for one in labels]
    single = [c for c in cases if c.kind == 'single' and c.visible and c.detected]
    rows = (*_finding(cases), *_naming(single), *_unknown(cases), *_locating(single),
            *_shrinking(single), *_others(cases))
    misses = tuple(_miss(c) for c in cases if not c.right())
    swept = tuple((c.label['energy'], c.detected) for c in cases
                  if c.kind in ('single', 'outside'))
    confusion = Counter(
        (c.names[0], c.first) if c.kind == 'single' else
        ('unknown', 'unknown' if c.says_unknown else c.first)
        for c in cases if c.kind in ('single', 'outside') and c.visible)
    return Figures(rows, misses, len(cases) - len(misses), len(cases), swept, confusion,
                   tuple(_stated(cases)))


def _rate(what: str, target: str, told: Iterable[bool], least: float | None = None,
          most: float | None = None) -> Rate:
    told = list(told)
    share = sum(told) / len(told) if told else None
    good = None if share is None else (
        (least is None or share >= least) and (most is None or share <= most))
    return Rate(what, target, sum(told), len(told), good)


def _finding(cases: list[Answered]) -> list[Rate]:
    none = [c for c in cases if c.kind == 'none']
    visible = [c for c in cases if c.kind in ('single', 'pair') and c.visible]
    faint = [c for c in cases if c.kind == 'single' and not c.visible]
    pairs = [c for c in visible if c.kind == 'pair']
    return [
        _rate('false alarms without effect', '<= 4 %', (c.detected for c in none), most=0.04),
        _rate('detected, of energy >= 50', '>= 95 %', (c.detected for c in visible), 0.95),
        _rate('called a gap, of energy < 50', '', (c.detected for c in faint)),
        _rate('pairs found exactly', '>= 75 %',
              (set(c.effects) == set(c.names) for c in pairs), 0.75)]


def _naming(single: list[Answered]) -> list[Rate | Value]:
    chances = [c.probability.get(c.names[0], 0.0) for c in single]
    sizes = [len(c.candidates) for c in single]
    covered = [c.names[0] in c.candidates for c in single]
    return [
        _rate('with a remainder (`partial`), of the detected', '',
              (c.verdict == 'partial' for c in single)),
        _rate('right effect first, of the detected', '', (c.first == c.names[0] for c in single)),
        _rate('right effect or an alias first', '>= 90 %',
              (same_class(c.first, c.names[0]) for c in single), 0.90),
        _rate('in the first two (alias classes)', '>= 97 %',
              (any(same_class(name, c.names[0]) for name in c.ranked[:2]) for c in single), 0.97),
        _value('mean probability on the true effect', '>= 0.85', chances, np.mean, least=0.85),
        _rate('in the 95 % candidate set', '93-98 %', covered, 0.93),
        _value('median size of the candidate set', '1', sizes, np.median, most=1.0)]


def _value(what: str, target: str, values: list[Any], of: Any, least: float | None = None,
           most: float | None = None) -> Value:
    value = float(of(values)) if values else math.nan
    good = None if not values else (
        (least is None or value >= least) and (most is None or value <= most))
    return Value(what, target, value, len(values), good)


def _unknown(cases: list[Answered]) -> list[Rate]:
    outside = [c for c in cases if c.kind == 'outside' and c.visible]
    known = [c for c in cases if c.kind in ('none', 'single', 'pair')]
    return [
        _rate('outside the library, recognised as unknown', '>= 85 %',
              (c.says_unknown for c in outside), 0.85),
        _rate('outside the library, a name and a remainder (`partial`)', '',
              (c.verdict == 'partial' and not c.says_unknown for c in outside)),
        _rate('outside the library, detected', '', (c.detected for c in outside)),
        _rate('unknown falsely claimed', '<= 5 %', (c.says_unknown for c in known), most=0.05)]


def _locating(single: list[Answered]) -> list[Rate]:
    located = [c for c in single if c.where]
    mean = [c for c in located if not c.parts[0]['random']]
    return [
        _rate('stage right', '>= 95 %',
              (c.where[0]['stage'] == c.parts[0]['stage'] for c in located), 0.95),
        _rate('channel and phase right', '>= 90 %', (c.cell_right() for c in mean), 0.90)]


def _shrinking(single: list[Answered]) -> list[Value]:
    short = []
    for c in single:
        if not c.parts[0]['random'] and 'closed' in c.gap and c.label['energy_fit'] > 1:
            oracle = 1 - 1 / math.sqrt(c.label['energy_fit'])
            short.append(100 * max(0.0, oracle - c.gap['closed']))
    return [
        _value("points of shrink short of the oracle's, median", '<= 2', short, np.median,
               most=2.0),
        _value('the same, 95th percentile', '<= 10', short,
               lambda values: np.percentile(values, 95), most=10.0)]


def _stated(cases: list[Answered]) -> Iterable[tuple[float, bool]]:
    """Yield how sure each answer is of what it names first, and whether that is so."""
    for c in cases:
        if c.kind in ('single', 'outside') and c.visible and c.detected:
            truth = c.names[0] if c.kind == 'single' else 'unknown'
            top = c.ranked[0] if c.ranked else c.verdict
            yield min(1.0, c.probability.get(top, 1.0)), top == truth


def calibration_error(stated: Iterable[tuple[float, bool]], bins: int = 10) -> float:
    """Return the expected calibration error of (probability, true) in equal bins."""
    stated = list(stated)
    total = 0.0
    for i in range(bins):
        inside = [(p, ok) for p, ok in stated
                  if i / bins < p <= (i + 1) / bins or i == p == 0]
        if inside:
            total += abs(sum(p for p, _ in inside) - sum(ok for _, ok in inside))
    return total / len(stated) if stated else math.nan


def _others(cases: list[Answered]) -> list[Rate | Value]:
    stated = list(_stated(cases))
    lazy = [c for c in cases if c.kind == 'lazy' and not (c.names and c.effects == c.names)]
    return [
        _value('expected calibration error', '<= 0.05', stated, calibration_error, most=0.05),
        _rate('too little motion recognised', '', (c.verdict == 'not_excited' for c in lazy)),
        _rate('crashes', '0', (c.verdict == 'crashed' for c in cases), most=0.0),
        _value('CPU time of a pair, median [s]', '', [
            c.result['cpu_seconds'] for c in cases if c.result['route'] == 'arrays'], np.median)]


def _miss(c: Answered) -> Miss:
    truth = ', '.join(f'{part["name"]} {part["size"]:.3g} {part["unit"]} '
                      f'(energy {part["energy"]:.3g})' for part in c.parts) or 'no effect'
    named = ', '.join(f'{name} {c.probability.get(name, 0.0):.2f}' for name in c.ranked)
    return Miss(c.identity, c.kind, truth, c.label['energy'],
                f'{c.verdict}{": " + named if named else ""}', _why(c))


def _why(c: Answered) -> str:
    """Sort a miss by what went wrong."""
    if c.verdict == 'crashed':
        return f'crash: {c.reason}'
    if c.kind == 'none':
        return f'false alarm: {c.reason}'
    if c.kind == 'lazy':
        return 'too little motion not recognised'
    if not c.detected:
        return 'not detected'
    if c.kind == 'outside':
        return 'taken for an effect of the library'
    missing = [name for name in c.names if name not in c.effects]
    if not missing:
        return 'found, and more besides' if set(c.effects) != set(c.names) else (
            f'found, but the verdict is {c.verdict}: {c.reason}')
    if c.says_unknown:
        return 'called unknown'
    wrong = [name for name in c.effects if name not in c.names]
    if c.kind == 'pair' and not wrong:
        return f'{", ".join(missing)} not found'
    alias = any(same_class(one, other) for one in missing for other in wrong)
    return f'{", ".join(missing)} taken for {", ".join(wrong) or "nothing"}' + (
        ' (aliases)' if alias else '')
