"""Residuals of a fit, and where they deviate most from noise: an instant, a stretch, all along."""

from collections.abc import Iterator
from typing import NamedTuple

from forcecal_ros.core.estimation import CHANCE
from forcecal_ros.core.geometry import Array
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

_DEGREES = 100
"""Noise is known from some hundred values, so that large deviations are commoner than Gauss's."""

_STRETCHES = (1, 5, 25, 125, 400)
"""Lengths of the stretches whose means are tested, in values: one to 8 s of 20 ms blocks."""

_WHOLE = 0.6
"""Share of a stretch's values that have to count for its mean to be tested."""


class Residuals(NamedTuple):
    """
    Residuals of a fit, and their noise.

    Attributes
    ----------
    times : ndarray, shape (n,)
        [s]
    values : ndarray, shape (n, k)
        Unit of the signal.
    sigma : ndarray, shape (n, k)
        Noise of each value.
    inflation : ndarray, shape (k,)
        Variance of the mean of n values, times n, over that of one.
    use : ndarray of bool, shape (n,)
        Which of them count.
    model_error : ndarray, shape (n, k)
        How far each may be off by an error that its neighbours share, as stamps do that are off:
        it does not average out. Unit of the signal; None: by none.
    """

    times: Array
    values: Array
    sigma: Array
    inflation: Array
    use: NDArray[np.bool_]
    model_error: Array | None = None


class Deviation(NamedTuple):
    """
    The stretch of residuals that deviates most from zero.

    Attributes
    ----------
    sigmas : float
        Of its mean, in standard errors.
    size : float
        Its mean [unit of the signal].
    time : float
        Its middle [s].
    tests : int
        How many stretches of how many channels were looked at.
    """

    sigmas: float
    size: float
    channel: int
    time: float
    tests: int = 1

    @property
    def is_chance(self) -> bool:
        """Whether noise alone deviates that far somewhere."""
        return self.sigmas < -float(stdtrit(_DEGREES, CHANCE / (2 * self.tests)))


def largest_deviation(residuals: Residuals, shortest: int = 1) -> Deviation:
    """
    Find the stretch whose mean deviates most from zero in standard errors, of any length.

    Parameters
    ----------
    shortest : int
        Stretches of fewer values say nothing.

    Returns
    -------
    Deviation
        Of 0 standard errors where nothing counts.
    """
    found, tests = Deviation(0.0, 0.0, 0, 0.0), 0
    use = residuals.use & np.isfinite(residuals.values).all(axis=1)
    z = np.where(use[:, None], residuals.values / residuals.sigma, 0.0)
    sums = _running(z)
    shared = _running(np.zeros_like(z) if residuals.model_error is None else np.where(
        use[:, None], residuals.model_error / residuals.sigma, 0.0))
    counts = np.concatenate([[0], np.cumsum(use)])
    for length in _STRETCHES:
        if not shortest <= length <= len(z):
            continue
        n = counts[length:] - counts[:-length]
        whole = n >= _WHOLE * length
        if not whole.any():
            continue
        tests += int(whole.sum()) * z.shape[1]
        off = (shared[length:] - shared[:-length])[whole]
        sigmas = np.abs(sums[length:] - sums[:-length])[whole] / np.sqrt(
            n[whole, None] * residuals.inflation + off**2)
        i, channel = (int(j) for j in np.unravel_index(np.argmax(sigmas), sigmas.shape))
        if sigmas[i, channel] > found.sigmas:
            first = int(np.flatnonzero(whole)[i])
            stretch = slice(first, first + length)
            size = residuals.values[stretch, channel][use[stretch]].mean()
            found = Deviation(float(sigmas[i, channel]), float(size), channel,
                              float(residuals.times[stretch].mean()))
    return found._replace(tests=max(tests, 1))


def _running(values: Array) -> Array:
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])


_SHARE = 0.05
"""Scatter about one tool, as a share of the span of the forces, from which it is no sensor's:
data sheets promise 2 % at most of a range, and the real arm's residuals here are 0.7 %."""

_ARM = 0.05
"""Range of torque over range of force of wrist sensors, 0.03 to 0.08 [m]: torques of a tool whose
centre of mass is nearer scatter like those of one that is so far."""

_FEWEST = 8
"""Poses from which the residuals of all but one tell what the one should be."""


FARTHEST = 1e-3
"""The farthest of single samples is doubted where chance makes one so far more rarely: one sound
set in a thousand. Among twelve poses one in 100,000 asks for 1.7 times as large a pull."""


class Outlier(NamedTuple):
    """The pose that is farthest off: which, in which channel, by how much [N, N m]; and chance."""

    pose: int
    channel: int
    size: float
    probability: float


def scatters(residuals: Array, wrench: Array, com: Array) -> Iterator[tuple[int, float, float]]:
    """
    Find channels that scatter about one tool by more than a sensor does.

    Parameters
    ----------
    residuals, wrench : ndarray, shape (n, 6)
        Read minus fitted; read [N, N m].
    com : ndarray, shape (3,)
        Centre of mass [m].

    Yields
    ------
    channel, rms, share : int, float, float
        Share of the span of the forces, of torques times the arm of the tool.
    """
    span = float(np.ptp(wrench[:, :3], axis=0).max())
    arm = max(_ARM, float(np.linalg.norm(com)))
    for j, rms in enumerate(np.sqrt((residuals**2).mean(axis=0))):
        share = float(rms) / (span * (1.0 if j < 3 else arm))
        if share > _SHARE:
            yield j, float(rms), share


def farthest(residuals: Array) -> Outlier | None:
    """
    Find the reading that is farthest off (Grubbs, Technometrics 11, 1969).

    Parameters
    ----------
    residuals : ndarray, shape (n, 6)

    Returns
    -------
    Outlier or None
        None of too few poses.
    """
    n = len(residuals)
    if n < _FEWEST:
        return None
    std = residuals.std(axis=0, ddof=1)
    G = np.abs(residuals) / np.maximum(std, 1e-300)
    i, j = (int(k) for k in np.unravel_index(np.argmax(G), G.shape))
    square = n * (n - 2) * G[i, j]**2 / max((n - 1)**2 - n * G[i, j]**2, 1e-300)
    chance = 2 * residuals.size * stdtr(n - 2, -np.sqrt(square))
    return Outlier(i, j, float(residuals[i, j]), float(min(1.0, chance)))
