"""
How likely an effect is the cause: one calibration for all effects.

A logistic regression on what the search found, fitted by ``benchmark/calibrate_probabilities.py``
on development cases and stored with its cross-validation in ``calibration.json``.
"""

from collections.abc import Mapping
from functools import cache
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

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
    beside : float
        Other effects of the explanation, each counted as far as its gain goes in this one.
    """

    gain: float
    missing: float
    beside: float = 0.0

    def row(self) -> tuple[float, float]:
        """
        Return the regressors.

        The logarithm of what an effect brings over what is missing; and the effects beside it, as
        several together fit whatever is unexplained.
        """
        return math.log10((1.0 + max(self.gain, 0.0)) / (1.0 + self.missing)), -self.beside

    @property
    def temperature(self) -> float:
        """Return the log-evidence by which odds change by e, errors of form allowed for."""
        stored = _stored()
        return float(stored['temperature'] + stored['form'] * max(self.gain, 0.0)
                     + stored['taken_up'] * self.missing)


def features_of(gains: Mapping[str, float], missing: float) -> dict[str, Features]:
    """
    Return what the probability of each effect of an explanation follows from.

    Parameters
    ----------
    gains : mapping of str to float
        Log-evidence with each effect above that without it.
    missing : float
        Log-evidence that a model without any flaw would have more.
    """
    size = {name: max(gain, 1e-9) for name, gain in gains.items()}
    return {name: Features(gains[name], missing,
                           sum(min(1.0, other / own) for other in size.values()) - 1.0)
            for name, own in size.items()}


@cache
def _stored() -> dict[str, Any]:
    return dict(json.loads(FILE.read_text()))


def probability(features: Features) -> float:
    """Return the probability that an effect is the cause."""
    stored = _stored()
    x = stored['intercept'] + sum(w * v for w, v in zip(stored['weights'], features.row()))
    most = stored['largest']
    return float(min(most, max(1.0 - most, 1.0 / (1.0 + math.exp(-x)))))
