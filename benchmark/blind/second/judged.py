"""One case of the second edition with its answer, and the questions that figures ask of it."""

from collections.abc import Iterator, Mapping
import math
from typing import Any

from blind.answered import FOUND, same_class
from blind.second.case import LIBRARY, NONE, OUTSIDE
from blind.second.shrink import closed

UNKNOWN = 'unknown'
PARAMETERS = {'body_mass[': 'tool_mass', 'body_ipos[': 'tool_com', 'tilt.': 'base_tilt',
              'dof_frictionloss[': 'joint_friction', 'kp[': 'joint_gain', 'kv[': 'joint_damping'}
"""How a simulator's parameters begin, and the effects that they are."""
CLAIMED = 0.5
"""Probability above which an effect counts as named."""
LEAST = 0.01
"""Probability below which the log score tells no difference."""


def effect_of(name: str) -> str:
    """Return the effect that a stated name is."""
    return next((effect for start, effect in PARAMETERS.items() if name.startswith(start)), name)


class Judged:
    """One case with its label and its answer."""

    def __init__(self, identity: str, label: Mapping[str, Any], answer: Mapping[str, Any]):
        document = answer['document']
        self.identity, self.label, self.answer = identity, label, answer
        self.generator, self.kind = label['generator'], label['kind']
        self.effect: str = label['effect'] if self.kind == LIBRARY else ''
        self.verdict: str = document['verdict']
        self.reason: str = document.get('reason', '')
        self.gap: Mapping[str, Any] = document.get('gap') or {}
        self.effects: list[Mapping[str, Any]] = document.get('effects', [])
        everything: dict[str, float] = {}
        for one in (*document.get('candidates', []), *self.effects):
            if 'probability' in one:
                name = effect_of(one['name'])
                everything[name] = max(one['probability'], everything.get(name, 0.0))
        excused = {*label['excused'], *label['doubtful']} - {self.effect}
        if label['ambiguous']:
            excused.add(self.effect)
        self.stated = dict(sorted(((name, p) for name, p in everything.items()
                                   if name not in excused), key=lambda one: -one[1]))

    @property
    def beside(self) -> bool:
        """Whether there is more than the effect: a background, or what the generator leaves."""
        return bool(self.label['background']) or self.label['own'] > 0.0

    @property
    def detected(self) -> bool:
        """Whether the answer is that there is a gap."""
        return self.verdict in FOUND

    def is_right(self, name: str) -> bool:
        """Tell whether a name is the effect, or an alias."""
        return bool(self.effect) and (same_class(name, self.effect)
                                      or name in self.label.get('aliases', ()))

    @property
    def first(self) -> str:
        """What is most probable; the verdict where nothing is named."""
        return next(iter(self.stated), self.verdict)

    @property
    def among(self) -> bool:
        """Whether the effect or an alias is a candidate."""
        return any(self.is_right(name) for name in self.stated)

    @property
    def false_names(self) -> list[str]:
        """Effects with more than one half that are neither there nor excused."""
        return [name for name, p in self.stated.items()
                if p > CLAIMED and name != UNKNOWN and not self.is_right(name)]

    @property
    def highest(self) -> float:
        """Highest probability of an effect."""
        return max((p for name, p in self.stated.items() if name != UNKNOWN), default=0.0)

    @property
    def of_truth(self) -> float:
        """What the truth was given."""
        if self.effect:
            return max((p for name, p in self.stated.items() if self.is_right(name)), default=0.0)
        if self.kind == OUTSIDE:
            return self.stated.get(UNKNOWN, 0.0)
        return 1.0 - self.highest

    @property
    def remainder_told(self) -> bool:
        """Whether what is outside the library is not explained away."""
        told = self.verdict == 'partial' or self.stated.get(UNKNOWN, 0.0) >= CLAIMED
        return self.first == UNKNOWN or (told and self.gap.get('closed', 0.0) < CLAIMED)

    def pairs(self) -> Iterator[tuple[float, bool]]:
        """Yield each stated probability of 0.01 or more, and whether that is so."""
        for name, p in self.stated.items():
            if p >= LEAST:
                yield p, (self.kind != LIBRARY and (self.kind == OUTSIDE or self.beside)
                          if name == UNKNOWN else name == self.effect)
        yield 1.0 - self.highest, self.kind != LIBRARY

    @property
    def alone(self) -> bool:
        """Whether the true effect and nothing else is named."""
        return bool(self.effect) and [effect_of(one['name']) for one in self.effects] == [
            self.effect]

    @property
    def shrink(self) -> float:
        """The share of the misfit that the effect makes, in the tool's measure since part 2."""
        known = self.label.get('shrink')
        if isinstance(known, Mapping):  # since part 3 by the noise that the answer states
            return closed(known, self.gap['noise'])
        if known is not None:
            return float(known)
        beside = sum(self.label['background'].values()) + self.label['own']
        return 1.0 - math.sqrt(beside / (beside + self.label['energy']))

    def deviation(self) -> float | None:
        """Return the error of the largest number of the effect in stated sigma."""
        numbers: Mapping[str, float] = self.label['numbers']
        if not (self.alone and numbers):
            return None
        parameters = self.effects[0]['parameters']
        known = {key: value for key, value in numbers.items() if key in parameters}
        if not known or (self.effect == 'tool_com' and self.generator in ('arm', 'drake')):
            return None
        key = max(known, key=lambda one: abs(known[one]))
        found = parameters[key]
        return (found['value'] - known[key]) / found['std'] if found['std'] else None

    def onset_error(self) -> float | None:
        """Return by how much a stated begin is off [s]."""
        begun = [one['from'] for one in self.effects if 'from' in one]
        if self.label['onset'] is None or not begun:
            return None
        return float(min((x - self.label['onset'] for x in begun), key=abs))

    def right(self) -> bool:
        """Tell whether nothing is to be said against the answer."""
        if self.verdict == 'crashed':
            return False
        if self.kind == NONE:
            return not self.false_names and (self.beside or not self.detected)
        if self.kind == OUTSIDE:
            return self.remainder_told
        return self.label['ambiguous'] or (self.is_right(self.first) and not self.false_names)
