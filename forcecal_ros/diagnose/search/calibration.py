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
    explained : float
        Part of the misfit's held-out energy that the explanation removes, once that is known.
    """

    gain: float
    missing: float
    explained: float = 1.0

    def row(self) -> tuple[float, float]:
        """
        Return the regressors.

        The logarithms of what an effect brings over what is missing; and of the energy that is
        explained over what is left, which counts only as far as that is too little.
        """
        share = min(max(self.explained, 1e-3), 1.0 - 1e-3)
        return (math.log10((1.0 + max(self.gain, 0.0)) / (1.0 + self.missing)),
                min(0.0, math.log10(share / (1.0 - share) / _stored()['enough'])))

    @property
    def temperature(self) -> float:
        """Return the log-evidence by which odds change by e, errors of form allowed for."""
        stored = _stored()
        return float(stored['temperature'] + stored['form'] * max(self.gain, 0.0)
                     + stored['taken_up'] * self.missing)


@cache
def _stored() -> dict[str, Any]:
    return dict(json.loads(FILE.read_text()))


def probability(features: Features) -> float:
    """Return the probability that an effect is the cause."""
    stored = _stored()
    x = stored['intercept'] + sum(w * v for w, v in zip(stored['weights'], features.row()))
    most = stored['largest']
    return float(min(most, max(1.0 - most, 1.0 / (1.0 + math.exp(-x)))))
