"""One case with its label and its answer, and whether that is right."""

from collections.abc import Mapping
from typing import Any

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
        return self.verdict == 'unknown' or (self.detected and self.ranked[:1] == ['unknown'])

    def right(self) -> bool:
        """Tell whether the verdict is what it should be."""
        if self.kind == 'lazy':  # losses and the like show without motion
            return self.verdict == 'not_excited' or (bool(self.names) and (
                self.effects == self.names))
        if self.kind == 'none' or (not self.visible and self.verdict == 'no_gap'):
            return self.verdict == 'no_gap'
        if self.kind == 'outside':
            return self.says_unknown
        if self.says_unknown:
            return False
        if self.kind == 'pair':
            return set(self.effects) == set(self.names)
        return self.effects == self.names or (
            self.verdict == 'ambiguous' and self.names[0] in self.candidates)

    def cell_right(self) -> bool:
        """Tell whether the place named first has at least half the excess of the strongest."""
        cells = self.label['cells']
        strongest = max(max(row.values()) for row in cells.values())
        cell = self.where[0]
        here = [row.get(cell['phase'], 0.0) for name, row in cells.items()
                if name == cell['channel'] or name.split('.')[0] == cell['channel'].split('.')[0]
                == 'pose']
        return bool(here) and max(here) >= 0.5 * strongest
