"""A data set of any length as one small matrix of sums: all that least squares needs of it."""

from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.blocks import Prepared
import numpy as np
from scipy import signal


@dataclass(frozen=True)
class Moments:
    """
    Sums over the samples of a data set, noise of the accelerometer removed.

    Attributes
    ----------
    count : int
        Samples.
    singular_values : ndarray, shape (n,)
        Of the centred raw measurements, over sqrt(count), [Traversaro2014] Eq. 10.
    mean : ndarray, shape (n,)
        Of the raw measurements, Eq. 9.
    scatter : ndarray, shape (n, n)
        Covariance of the raw measurements, their white noise subtracted.
    directions : ndarray, shape (q, m)
        As many pseudo-samples of the regressors as they have excited directions; their outer
        products add up to the sum over all samples.
    raw : ndarray, shape (q, n)
        Raw measurements projected on the same pseudo-samples.
    ones : ndarray, shape (q,)
        The constant 1 projected on the same pseudo-samples.
    combine : ndarray, shape (m, q)
        Regressors of a sample times this are its weights in the pseudo-samples.
    spread : ndarray, shape (3, 3)
        Covariance of measured gravity, noise subtracted [(m/s^2)^2].
    """

    count: int
    singular_values: Array
    mean: Array
    scatter: Array
    directions: Array
    raw: Array
    ones: Array
    combine: Array
    spread: Array

    def without(self, part: Array, raw: Array, regressors: Array) -> 'Moments':
        """
        Take a known part off the raw measurements.

        Parameters
        ----------
        part, raw : ndarray, shape (b, n)
            The part, and raw measurements with it, as means of equally long blocks.
        regressors : ndarray, shape (b, m)
            Of the same blocks.
        """
        without = raw - part
        change = np.cov(without.T, bias=True) - np.cov(raw.T, bias=True)
        each = self.count / len(part)
        return replace(self, mean=self.mean - part.mean(axis=0), scatter=self.scatter + change,
                       raw=self.raw - each * (regressors @ self.combine).T @ part)

    @property
    def constant_weight(self) -> float:
        """Samples' worth of information on a constant beside the regressors."""
        return float(self.count - self.ones @ self.ones)


def accumulate(recording: Prepared, kept: tuple[tuple[float, float], ...], window: int,
               order: int, raw_noise: Array, gravity_noise: Array, magnitude: float | None
               ) -> Moments:
    """
    Filter the kept stretches and fold all samples into their moments.

    At rest the accelerometer gives a direction only: its readings are scaled to the magnitude of
    gravity, before the filter, which is linear and so keeps what holds for a sample. The rest
    of its noise is an error in the regressor: its share of the second moments, scaled by the
    filter's gain, is removed before anything is regressed on them.

    Parameters
    ----------
    kept : tuple of (float, float)
        Stretches to use [s].
    window, order : int
        Of the filter.
    raw_noise : ndarray, shape (n, n)
        Covariance of a raw sample's white noise.
    gravity_noise : ndarray, shape (3, 3)
        The same of the accelerometer [(m/s^2)^2].
    magnitude : float or None
        Of gravity [m/s^2]; None in motion.

    Raises
    ------
    DataError
        No sample lies in the stretches, or gravity has no scatter beyond its noise.
    """
    n, gain, gram = len(raw_noise), 0.0, np.zeros(())
    runs = [slice(*np.searchsorted(recording.t, ends)) for ends in kept]
    runs = [run for run in runs if run.stop > run.start]
    if not runs:
        raise DataError('no sample is in the time intervals that are used')
    reference = np.zeros(recording.regressors.shape[1] + n)
    reference[-n:] = recording.raw[runs[0].start]
    for run in runs:
        rows = np.hstack([recording.regressors[run], recording.raw[run]]) - reference
        if magnitude is not None:
            # noise across gravity makes its mean shorter
            size = magnitude + np.trace(gravity_noise) / (3 * magnitude)
            rows[:, :3] *= size / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
        rows, more = smooth(rows, window, order)
        ones = rows.sum(axis=0)
        gram = gram + np.block([[np.full((1, 1), len(rows)), ones[None]],
                                [ones[:, None], rows.T @ rows]])
        gain += more
    if magnitude is not None:
        gravity_noise = _tangential(gram, gravity_noise, magnitude)
    return _moments(gram, reference, gain, raw_noise, gravity_noise)


def _tangential(gram: Array, gravity_noise: Array, magnitude: float) -> Array:
    """Mean covariance of noise across gravity, which is what scaling leaves of it."""
    along = gram[1:4, 1:4] / (gram[0, 0] * magnitude ** 2)
    return np.asarray(np.trace(gravity_noise) / 3 * (np.eye(3) - along))


def _moments(gram: Array, reference: Array, gain: float, raw_noise: Array,
             gravity_noise: Array) -> Moments:
    n = len(raw_noise)
    reference = reference[-n:]
    m = len(gram) - 1 - n
    count = gram[0, 0]
    covariance = (gram[1:, 1:] - np.outer(gram[0, 1:], gram[0, 1:]) / count) / count
    spread = covariance[:3, :3] - gain / count * gravity_noise
    scatter = covariance[m:, m:]
    second = gram[1:m + 1, 1:m + 1].copy()
    second[:3, :3] -= gain * gravity_noise
    values, vectors = np.linalg.eigh(second)
    strong = values > 1e-10 * values[-1]
    root, vectors = np.sqrt(values[strong]), vectors[:, strong]
    combine = vectors / root
    return Moments(
        count=round(count),
        singular_values=np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[::-1], 0.0)),
        mean=reference + gram[0, m + 1:] / count,
        scatter=scatter - gain / count * raw_noise,
        directions=(vectors * root).T,
        raw=combine.T @ (gram[1:m + 1, m + 1:] + np.outer(gram[1:m + 1, 0], reference)),
        ones=combine.T @ gram[1:m + 1, 0],
        combine=combine,
        spread=spread)


PAPER_WINDOW = 3.01
"""Length of the paper's window [s]: 301 samples at 100 Hz."""

PAPER_ORDER = 3
"""Order of the paper's polynomial."""


class Smoothed(NamedTuple):
    """Filtered samples, shape (n, k), and the sum of their noise gains (1 each, unfiltered)."""

    values: Array
    noise_gain: float


def window_samples(window: float, order: int, rate: float) -> int:
    """
    Scale the paper's window to a rate: an odd number of samples, [Traversaro2014] IV.

    Parameters
    ----------
    window : float
        [s]; 0 for no filter.
    order : int
        Of the polynomial.
    rate : float
        [Hz]

    Returns
    -------
    int
        1 for no filter.

    Raises
    ------
    ConfigError
        The window holds too few samples for the polynomial.
    """
    if not window:
        return 1
    samples = 2 * round((window * rate - 1) / 2) + 1
    if samples <= order:
        # lower rates are doubted [Hz]: 5 kHz come out so where ms are taken for s
        slow_hz = 5.0
        raise ConfigError(
            f'filter: a window of {window:g} s has {samples} samples at {rate:g} Hz, but order '
            f'{order} requires more than {order}; increase it'
            + (', or correct the unit of time (ms, us)' if rate < slow_hz else ''))
    return samples


def projection(window: int, order: int) -> Array:
    """
    Least-squares polynomial over a window: row i maps the samples to the fit at sample i.

    The middle row holds the filter's coefficients, the others serve the first and last half
    window of a stream; the diagonal holds the gain on white noise power.

    Returns
    -------
    ndarray, shape (window, window)
    """
    x = np.linspace(-1.0, 1.0, window) if window > 1 else np.zeros(1)
    q, _ = np.linalg.qr(np.polynomial.legendre.legvander(x, min(order, window - 1)))
    return np.asarray(q @ q.T)


def smooth(run: Array, window: int, order: int) -> Smoothed:
    """
    Filter one gapless run of samples, with polynomial ends; as many come out as go in.

    Parameters
    ----------
    run : ndarray, shape (n, k)
    window : int
        Odd number of samples; 1 passes everything as it is.
    """
    n = len(run)
    if window == 1:
        return Smoothed(run, float(n))
    hat = projection(min(n, window), order)
    if n <= window:
        return Smoothed(hat @ run, float(np.trace(hat)))
    half = window // 2
    out = np.empty(run.shape)
    out[half:n - half] = signal.oaconvolve(np.ascontiguousarray(run.T), hat[half:half + 1],
                                           mode='valid', axes=1).T
    out[:half], out[n - half:] = hat[:half] @ run[:window], hat[half + 1:] @ run[-window:]
    return Smoothed(out, float(2 * np.trace(hat[:half, :half])
                               + (n - 2 * half) * hat[half, half]))


def gathered(run: Array, window: int, order: int) -> Array:
    """
    Apply the transpose of the filter to one gapless run: sum x smooth(y) is sum gathered(x) y.

    Parameters
    ----------
    run : ndarray, shape (n, k)
    window : int
        Odd number of samples, more than one.
    """
    n = len(run)
    if n < window + 1:
        return np.asarray(projection(n, order) @ run)
    hat, half = projection(window, order), window // 2
    out = signal.oaconvolve(run[half:n - half], hat[half][:, None], mode='full', axes=0)
    out[:window] += hat[:half].T @ run[:half]
    out[-window:] += hat[half + 1:].T @ run[-half:]
    return np.asarray(out)
