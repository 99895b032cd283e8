"""
Where residuals deviate from noise, what moves in static poses, and which poses do not fit.

"If the error is larger than a threshold defined previously, something in the setup, programs or
system are not in the right order": the observed error of a pose is how far it lies from what all
others predict. That is the outlier test of a mean shift: with readings whitened, residuals r and
their projection M = I - H, a shift of pose k is estimated by M_kk^+ r_k, and r_k^T M_kk^+ r_k is
chi-square where there is none.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from forcecal_ros.calibrate.tool import design_of, slide_noise, Statics, ToolFit
from forcecal_ros.checks.signals import resolution
from forcecal_ros.core.estimation import CHANCE, robust_fit
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_windows
from forcecal_ros.core.noise.white import white_covariance
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, stdtr, stdtrit


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
    """

    times: Array
    values: Array
    sigma: Array
    inflation: Array
    use: NDArray[np.bool_]


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
        # noise is known from some hundred values, so that large deviations are commoner than
        # Gauss's
        degrees = 100
        return self.sigmas < -float(stdtrit(degrees, CHANCE / (2 * self.tests)))


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
    counts = np.concatenate([[0], np.cumsum(use)])
    # lengths of the stretches whose means are tested, in values: one to 8 s of 20 ms blocks
    stretches = (1, 5, 25, 125, 400)
    for length in stretches:
        if not shortest <= length <= len(z):
            continue
        n = counts[length:] - counts[:-length]
        # share of a stretch's values that have to count for its mean to be tested
        least = 0.6
        whole = n >= least * length
        if not whole.any():
            continue
        tests += int(whole.sum()) * z.shape[1]
        sigmas = np.abs(sums[length:] - sums[:-length])[whole] / np.sqrt(
            n[whole, None] * residuals.inflation)
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
    # range of torque over range of force of wrist sensors, 0.03 to 0.08 [m]: torques of a tool
    # whose centre of mass is nearer scatter like those of one that is so far
    least_arm = 0.05
    arm = max(least_arm, float(np.linalg.norm(com)))
    for j, rms in enumerate(np.sqrt((residuals**2).mean(axis=0))):
        share = float(rms) / (span * (1.0 if j < 3 else arm))
        # scatter about one tool, as a share of the span of the forces, from which it is no
        # sensor's: data sheets promise 2 % at most of a range, and the real arm's residuals here
        # are 0.7 %
        most = 0.05
        if share > most:
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
    # poses from which the residuals of all but one tell what the one should be
    fewest = 8
    if n < fewest:
        return None
    std = residuals.std(axis=0, ddof=1)
    G = np.abs(residuals) / np.maximum(std, 1e-300)
    i, j = (int(k) for k in np.unravel_index(np.argmax(G), G.shape))
    square = n * (n - 2) * G[i, j]**2 / max((n - 1)**2 - n * G[i, j]**2, 1e-300)
    chance = 2 * residuals.size * stdtr(n - 2, -np.sqrt(square))
    return Outlier(i, j, float(residuals[i, j]), float(min(1.0, chance)))


class PoseError(NamedTuple):
    """
    How far one pose lies from what the others predict.

    Attributes
    ----------
    shift : ndarray, shape (6,)
        Read less predicted; zero where the others predict nothing [N, N m].
    mass : float
        What it would do to the mass by this pose alone, e_m of [Gamez2005] Eq. 23 with the
        observed weight in place of that of a wrong orientation [kg].
    probability : float
        Of as large a shift by chance; NaN where nothing is predicted.
    chi_square : float
        Of the shift: it ranks poses whose probabilities are all too small for a number.
    """

    shift: Array
    mass: float
    probability: float
    chi_square: float = 0.0


def pose_errors(statics: Statics, tool: ToolFit) -> list[PoseError]:
    """Compare every static pose with the others; empty where their noise is not known."""
    if statics.covariance is None:
        return []
    lower = np.linalg.cholesky(statics.covariance + tool.mass**2 * slide_noise(statics))
    both = np.column_stack(design_of(statics)).reshape(len(lower), 6, -1)
    white = np.linalg.solve(lower, both).reshape(6 * len(lower), -1)
    basis = np.linalg.qr(white[:, :-1] / np.linalg.norm(white[:, :-1], axis=0))[0]
    residual = white[:, -1] - basis @ (basis.T @ white[:, -1])
    return [_error(*one) for one in zip(residual.reshape(-1, 6), basis.reshape(
        len(lower), 6, -1), lower, statics.gravity)]


def _error(residual: Array, basis: Array, lower: Array, gravity: Array) -> PoseError:
    # below this eigenvalue the other poses do not predict a direction: it is rounding
    values, vectors = np.linalg.eigh(np.eye(6) - basis @ basis.T)
    known = values > 1e-6
    if not known.any():
        return PoseError(np.zeros(6), 0.0, np.nan)
    along = vectors[:, known].T @ residual
    shift = lower @ vectors[:, known] @ (along / values[known])
    statistic = float((along**2 / values[known]).sum())
    return PoseError(shift, float(shift[:3] @ gravity / (gravity @ gravity)),
                     float(chdtrc(int(known.sum()), statistic)), statistic)


def rejected(errors: Sequence[PoseError], probability: float) -> int | None:
    """
    Return the pose to measure again, if any.

    It is the least probable one, where chance makes any of so many poses as improbable less often
    than ``probability``.
    """
    chances = [1.0 if np.isnan(one.probability) else one.probability for one in errors]
    if not chances or min(chances) * len(chances) >= probability:
        return None
    return min(range(len(errors)), key=lambda i: (chances[i], -errors[i].chi_square))


def touched(statics: Statics) -> list[int]:
    """Return the poses without which all others fit one tool, if there are a few."""
    assert statics.covariance is not None
    sigma = np.sqrt(np.diagonal(statics.covariance, axis1=1, axis2=2))
    n = len(sigma)
    columns = design_of(statics)[0][:6 * n].reshape(n, 6, -1) / sigma[:, :, None]
    fit = robust_fit(columns, statics.wrench / sigma, channels=6, freedom=2.0)
    # errors of their means by which poses are off one tool that the others fit, and the largest
    # share of poses that may be
    sigmas, most = 10.0, 0.34
    off = np.abs(fit.residual.reshape(n, 6)).max(axis=1) > sigmas
    return np.flatnonzero(off).tolist() if off.mean() <= most else []


DRIFT = 6.0
"""Drifts within a static pose of fewer standard errors are taken for chance."""


def drift(parts: Sequence[Array]) -> tuple[float, int, int]:
    """
    Find the strongest drift of a signal while the robot stands: of its samples in each window.

    Returns
    -------
    sigmas, window, channel : float, int, int
        Mean of the second half less that of the first, in standard errors by noise that may be
        coloured; 0 where the windows hold too few samples to tell.
    """
    size = max(1, int(np.median([len(part) for part in parts])) // 40) if parts else 1
    whole = [(i, _block_means(part, size)) for i, part in enumerate(parts)
             if len(part) // size >= 20]
    if not whole:
        return 0.0, 0, 0
    noise = noise_of_windows([_detrended(blocks) for _, blocks in whole]).at_least_white
    worst = (0.0, 0, 0)
    for i, blocks in whole:
        n = len(blocks) // 2 * 2
        step = np.abs(blocks[n // 2:n].mean(axis=0) - blocks[:n // 2].mean(axis=0))
        white = np.diag(white_covariance(blocks, 1))
        sigmas = step / np.sqrt(np.maximum(np.maximum(np.diag(noise), white) * 4 / n, 1e-300))
        sigmas[white == 0] = 0
        if sigmas.max() > worst[0]:
            worst = (float(sigmas.max()), i, int(np.argmax(sigmas)))
    return worst


class Restless(NamedTuple):
    """
    A window in which a signal moves more than in the others.

    Attributes
    ----------
    times : float
        Standard deviation there over the median of all windows.
    size : float
        That standard deviation.
    window, channel : int
    """

    times: float
    size: float
    window: int
    channel: int


def restless(parts: Sequence[Array]) -> Restless | None:
    """
    Find where a signal moves more than elsewhere while the robot stands.

    A jump within a window widens the noise that is seen there, and hides behind it.

    Returns
    -------
    Restless or None
        None where windows or their samples are too few.
    """
    # fewer windows have no usual one among them, fewer samples in one do not show how they move
    windows, samples = 3, 10
    if len(parts) < windows or min(map(len, parts)) < samples:
        return None
    spread = np.array([part.std(axis=0) for part in parts])
    step = np.array([resolution(column) for column in np.concatenate(parts).T])
    usual = np.maximum(np.median(spread, axis=0), step)
    times = np.where(usual > 0, spread / np.where(usual > 0, usual, 1.0), 0.0)
    window, channel = map(int, np.unravel_index(int(np.argmax(times)), times.shape))
    return Restless(float(times.max()), float(spread[window, channel]), window, channel)


def _block_means(values: Array, size: int) -> Array:
    n = len(values) // size
    return np.asarray(values[:n * size].reshape(n, size, -1).mean(axis=1))


def _detrended(blocks: Array) -> Array:
    """Take a line off, which is drift and no noise."""
    t = np.linspace(-1.0, 1.0, len(blocks))
    return np.asarray(blocks - blocks.mean(axis=0) - np.outer(t, t @ blocks / (t @ t)))
