"""
How likely an effect is the cause: one calibration for all effects.

A logistic regression on what the search found, fitted by ``benchmark/calibrate_probabilities.py``
on development cases and stored with its cross-validation in ``calibration.json``.
"""

from functools import cache
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

UNKNOWN = 'unknown'

FILE = Path(__file__).with_name('calibration.json')


class Features(NamedTuple):
    """
    What the probability of an accepted effect follows from.

    Attributes
    ----------
    gain : float
        Log-evidence with the effect above that without it.
    missing : float
        Log-evidence that a model without any flaw would have more.
    flawed : float
        The part of it that may be due to noise that is not quite what it is taken for.
    """

    gain: float
    missing: float
    flawed: float

    def row(self) -> float:
        """Return the regressor: the logarithm of what an effect brings over what is missing."""
        return math.log10((1.0 + max(self.gain, 0.0)) / (1.0 + self.missing))

    @property
    def temperature(self) -> float:
        """Return the log-evidence by which odds change by e, errors of form allowed for."""
        stored = _stored()
        return float(stored['temperature'] + stored['form'] * max(self.gain, 0.0)
                     + stored['taken_up'] * self.flawed)


@cache
def _stored() -> dict[str, Any]:
    return dict(json.loads(FILE.read_text()))


def probability(features: Features) -> float:
    """Return the probability that an effect is the cause."""
    stored = _stored()
    x = stored['intercept'] + stored['weight'] * features.row()
    most = stored['largest']
    return float(min(most, max(1.0 - most, 1.0 / (1.0 + math.exp(-x)))))
