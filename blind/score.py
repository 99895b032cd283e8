"""Labels and answers to figures, each with its Wilson interval, and the misses one by one."""

from collections import Counter
from collections.abc import Iterable, Mapping
import math
from typing import Any, NamedTuple

import numpy as np

FOUND = ('identified', 'ambiguous', 'partial', 'unknown')
"""Verdicts that say there is a gap."""
VISIBLE = 50.0
"""Whitened energy from which an effect is to be detected."""
ALIASES = (
    {'tool_mass', 'tool_stiffness', 'wrench_gain', 'contact_stiffness'},
    {'wrench_delay', 'wrench_lowpass'},
    {'accel_delay', 'accel_resonance'},
    {'base_tilt', 'cable_force', 'tool_com'},
    {'accel_bias', 'accel_highpass', 'accel_misalignment'},
    {'tool_stiffness', 'tool_stiffening'},
)
"""Effects that hardly differ in what they do to a recording."""


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


def same_class(one: str, other: str) -> bool:
    """Tell whether two effects are one, or aliases."""
    return one == other or any({one, other} <= names for names in ALIASES)


class Answered:
    """One case with its label and its answer, and the questions that figures ask of it."""

    def __init__(self, identity: str, label: Mapping[str, Any], result: Mapping[str, Any]):
        document = result['document']
        self.identity, self.label, self.result = identity, label, result
        self.kind: str = label['kind']
        self.parts = label['parts']
        self.names: list[str] = [part['name'] for part in self.parts]
        self.verdict: str = document['verdict']
        self.reason = document.get('reason') or document.get('error') or ''
        self.where = document.get('where') or []
        self.effects: list[str] = [one['name'] for one in document.get('effects', [])]
        self.gap = document.get('gap') or {}
        self.probability = {one['name']: one['probability']
                            for key in ('effects', 'candidates')
                            for one in document.get(key, [])}
        self.candidates: list[str] = [one['name'] for one in sorted(
            document.get('candidates', []), key=lambda one: -one['probability'])]

    @property
    def visible(self) -> bool:
        """Whether the effects of the case are all to be detected."""
        return bool(self.parts) and all(part['energy'] >= VISIBLE for part in self.parts)

    @property
    def detected(self) -> bool:
        """Whether the answer is that there is a gap."""
        return self.verdict in FOUND

    @property
    def ranked(self) -> list[str]:
        """What the answer names, most probable first."""
        named = self.candidates or self.effects
        if self.verdict == 'unknown' and 'unknown' not in named:
            return ['unknown', *named]
        return sorted(dict.fromkeys([*named, *self.effects]),
                      key=lambda name: -self.probability.get(name, 0.0))

    @property
    def first(self) -> str:
        """What the answer names first; the verdict where it names nothing."""
        if not self.detected:
            return self.verdict
        if self.says_unknown:
            return 'unknown'
        return (self.effects or self.ranked or [self.verdict])[0]

    @property
    def says_unknown(self) -> bool:
        """Whether the answer is that the cause is none of the library."""
        return self.verdict == 'unknown' or self.detected and self.ranked[:1] == ['unknown']

    def right(self) -> bool:
        """Tell whether the verdict is what it should be."""
        if self.kind == 'lazy':  # losses and the like show without motion
            return self.verdict == 'not_excited' or bool(self.names) and (
                self.effects == self.names)
        if self.kind == 'none' or not self.visible and self.verdict == 'no_gap':
            return self.verdict == 'no_gap'
        if self.kind == 'outside':
            return self.says_unknown
        if self.says_unknown:
            return False
        if self.kind == 'pair':
            return set(self.effects) == set(self.names)
        return self.effects == self.names or (
            self.verdict == 'ambiguous' and self.names[0] in self.candidates)


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
        _rate('channel and phase right', '>= 90 %', (_cell_right(c) for c in mean), 0.90)]


def _cell_right(c: Answered) -> bool:
    """Tell whether the place named first has at least half the excess of the strongest one."""
    cells = c.label['cells']
    strongest = max(max(row.values()) for row in cells.values())
    cell = c.where[0]
    here = [row.get(cell['phase'], 0.0) for name, row in cells.items()
            if name == cell['channel'] or name.split('.')[0] == cell['channel'].split('.')[0]
            == 'pose']
    return bool(here) and max(here) >= 0.5 * strongest


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
