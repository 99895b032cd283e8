"""
Effects that do the same to what was recorded: explanations within the margin of the posterior.

What separates them is no matter of evidence but of what else is recorded, which a table says.
"""

from collections.abc import Mapping
from typing import NamedTuple

from forcecal_ros.diagnose.search.posterior import Posterior

ODDS = 0.05
"""Odds of another effect in the place of an accepted one from which both are listed."""

SEPARATED_BY: Mapping[frozenset[str], str] = {
    frozenset(pair): words for *pair, words in (
        ('wrench_delay', 'wrench_lowpass', 'a faster recording, or a motion up to the corner'),
        ('accel_misalignment', 'wrench_crosstalk', 'the accelerometer at rest'),
        ('tool_com', 'wrench_crosstalk', 'contact at a known place'),
        ('tool_mass', 'wrench_gain', 'a known force'),
        ('base_tilt', 'cable_force', 'a level on the base'),
        ('accel_delay', 'accel_resonance', 'a sweep up to the resonance'),
        ('tool_stiffness', 'tool_damping', 'a sweep about the resonance of the tool'),
        ('contact_stiffness', 'wall_position', 'contacts of several depths'))}
"""Pair of effects, and what separates them."""


class Tie(NamedTuple):
    """What may have done the same as an accepted effect, its odds against that one, and why."""

    other: str
    odds: float
    note: str


def ties_of(found: Posterior) -> dict[str, Tie]:
    """Return the likeliest alias of each accepted effect, if one is about as likely."""
    out = {}
    for name, others in found.odds.items():
        other = max(others, key=lambda one: others[one], default='')
        if other and others[other] > ODDS:
            by = SEPARATED_BY.get(frozenset((name, other)), 'what forcecal plan writes')
            out[name] = Tie(other, others[other], f'{name} and {other} explain these recordings '
                            f'about as well; they are separated by {by}')
    return out
