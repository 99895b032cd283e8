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
from typing import NamedTuple

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


class Calibration(NamedTuple):
    """
    The one calibration of all effects.

    Attributes
    ----------
    intercept : float
    weights : tuple of float
        Of the regressors that :meth:`Features.row` returns.
    temperature : tuple of float
        Log-evidence by which the odds of two effects change by e, as errors of form are allowed
        for: at least; more for each that the likelier one brings; more for each that is missing.
    largest : float
        Probability, at most.
    """

    intercept: float
    weights: tuple[float, ...]
    temperature: tuple[float, ...]
    largest: float

    def probability(self, features: Features) -> float:
        """Return the probability that an effect is the cause."""
        x = self.intercept + sum(w * v for w, v in zip(self.weights, features.row()))
        return float(min(self.largest, max(1.0 - self.largest, 1.0 / (1.0 + math.exp(-x)))))

    def odds(self, features: Features, others: Mapping[str, float]) -> dict[str, float]:
        """Return the odds of others against an effect, by their log-evidence against it."""
        least, brought, missing = self.temperature
        temperature = least + brought * max(features.gain, 0.0) + missing * features.missing
        return {name: math.exp(min(0.0, value) / temperature) for name, value in others.items()}


@cache
def stored() -> Calibration:
    """Return the calibration that diagnoses use."""
    found = json.loads(FILE.read_text())
    return Calibration(found['intercept'], tuple(found['weights']), tuple(found['temperature']),
                       found['largest'])
