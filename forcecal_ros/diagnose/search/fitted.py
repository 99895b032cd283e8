"""A hypothesis as fitted beside what is explained already, and as accepted."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.model.evidence import Score
from forcecal_ros.diagnose.model.scales import NO_DISCREPANCY, Scales
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr


class HypothesisFit(NamedTuple):
    """
    A fitted hypothesis.

    Attributes
    ----------
    theta : ndarray, shape (p,)
        Parameters of the effect; empty where it releases nuisances instead.
    std : ndarray, shape (p,)
    free : ndarray of int
        Which of them are estimated.
    nuisances : ndarray, shape (m,)
        Step of the nuisances that goes with it, in prior std.
    gain : float
        Held-out log-likelihood above that without the hypothesis.
    evidence : float
        Marginal likelihood of all data, likewise, parameters' priors included.
    size : float
        Largest RMS of what it changes, over channels and kinds of motion, in what a simulation
        that is right may be off by.
    excess : float
        Held-out whitened energy above the noise without it.
    n : int
        Held-out samples.
    refined : bool
        Whether the parameters were refined on simulations.
    discrepancy : tuple of float
        Scales of the discrepancy at which the hypothesis is likeliest.
    """

    name: str
    theta: Array
    std: Array
    free: NDArray[np.intp]
    nuisances: Array
    released: frozenset[str]
    gain: float
    evidence: float
    score: Score
    size: float
    excess: float
    n: int
    refined: bool
    discrepancy: Scales = NO_DISCREPANCY

    @property
    def p(self) -> float:
        """One-sided probability of such a score by chance."""
        return float(ndtr(-self.score.z))

    @property
    def degrees(self) -> int:
        """Parameters that are estimated, released nuisances among them."""
        return max(1, len(self.free) + len(self.released))

    @property
    def fraction(self) -> float:
        """Lower bound of the above-noise energy that it explains and no nuisance could, in all."""
        return self._bounded(self.score.removed)

    @property
    def fraction_along(self) -> float:
        """Return the same of what it explains where nuisances are fitted along."""
        return self._bounded(2.0 * self.gain)

    def _bounded(self, removed: float) -> float:
        low = removed - 4.0 * np.sqrt(self.score.energy)
        high = max(removed, self.excess - 2.0 * np.sqrt(2.0 * self.n))
        return float(low / max(high, 1e-9))


class Accepted(NamedTuple):
    """
    One accepted effect.

    Attributes
    ----------
    theta, std : ndarray, shape (p,)
        Empty where the effect is a released nuisance.
    free : ndarray of int
        Which of them are estimated.
    """

    name: str
    theta: Array
    std: Array
    free: NDArray[np.intp]
    released: frozenset[str]

    @property
    def degrees(self) -> int:
        """Parameters that are estimated, released nuisances among them."""
        return max(1, len(self.free) + len(self.released))

    @classmethod
    def of(cls, result: HypothesisFit) -> 'Accepted':
        """Accept a hypothesis as it was fitted."""
        return cls(result.name, result.theta, result.std, result.free, result.released)
