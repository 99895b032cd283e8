"""
The sensor's offset, and the three dimensions of raw measurements, [Traversaro2014] Lemma 1.

In the subspace, y = E g + y_o with the twelve unknowns E (3 x 3) and y_o (3): a linear regression
on the measured gravity, not the fit of a quadric to the cloud.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from forcecal_ros.core.errors import below, DataError, UnobservableError
from forcecal_ros.core.estimation import CHANCE
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_residuals
from forcecal_ros.insitu.blocks import Blocks, Mask
from forcecal_ros.insitu.moments import Moments
import numpy as np
from scipy.special import chdtrc


def principal_basis(scatter: Array) -> Array:
    """
    Directions of the space that raw measurements span. [Traversaro2014] Eq. 10.

    Parameters
    ----------
    scatter : ndarray, shape (n, n)
        Covariance of the raw measurements.

    Returns
    -------
    ndarray, shape (n, 3)
        Orthonormal, strongest first.
    """
    return np.linalg.eigh(scatter)[1][:, :-4:-1]


def offset_of(moments: Moments) -> Array:
    """
    Offset of one data set. [Traversaro2014] Eq. 9-17.

    A regression of all channels on gravity, projected on the space of :func:`principal_basis`
    about the mean, gives what a regression of the projected channels gives.

    Returns
    -------
    ndarray, shape (n,)
    """
    total = moments.count * moments.mean
    intercept = (total - moments.ones @ moments.raw) / moments.constant_weight
    if moments.directions.shape[1] > 3:
        return np.asarray(intercept)
    basis = principal_basis(moments.scatter)
    return np.asarray(moments.mean + basis @ (basis.T @ (intercept - moments.mean)))


def shared_offset(data_sets: Sequence[Moments]) -> Array:
    """
    One offset of several data sets, each weighted by what it knows of a constant.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    UnobservableError
        Gravity does not move enough in any data set.
    """
    weights = np.array([moments.constant_weight for moments in data_sets])
    if not (weights > 0).all():
        raise UnobservableError('gravity does not vary by more than its noise; tilt the body '
                                'further')
    return np.average([offset_of(moments) for moments in data_sets], axis=0, weights=weights)


def offset_moves(data_sets: Sequence[tuple[Blocks, Mask]]) -> Array:
    """
    Compare each data set's own offset with the median of all.

    Unlike the residuals under one shared offset, those of own affine maps do not hold the move.

    Parameters
    ----------
    data_sets : sequence of (Blocks, ndarray of bool)

    Returns
    -------
    ndarray, shape (k,)
        Largest move of a channel over its span; zero where misfits explain it.
    """
    fits = [affine(blocks.regressors[use, :3], blocks.raw[use]) for blocks, use in data_sets]
    offsets = np.array([offset for offset, *_ in fits])
    span = np.max([size for _, _, size in fits], axis=0)
    moves = np.abs(offsets - np.median(offsets, axis=0))
    levers = [_lever(blocks.regressors[use, :3]) for blocks, use in data_sets]
    # moves of fewer misfits of a data set's own affine map than this are not separated from them
    misfits = 4.0
    sure = moves > misfits * np.array([lever * rms for lever, (_, rms, _) in zip(levers, fits)])
    return np.asarray((np.where(sure, moves, 0.0) / np.maximum(span, 1e-12)).max(axis=1))


def explained(data_sets: Sequence[tuple[Blocks, Mask]]) -> Array:
    """Share of each channel's variance that own affine maps of gravity explain, shape (n,)."""
    used = [(blocks.regressors[use, :3], blocks.raw[use]) for blocks, use in data_sets]
    residual = np.sum([len(raw) * affine(gravity, raw)[1] ** 2 for gravity, raw in used], axis=0)
    whole = np.sum([len(raw) * raw.var(axis=0, ddof=1) for _, raw in used], axis=0)
    return np.asarray(1 - residual / np.maximum(whole, 1e-24))


def affine(gravity: Array, raw: Array) -> tuple[Array, Array, Array]:
    """Offset, RMS of the misfit, and span of each channel's own affine map of gravity."""
    x = np.column_stack([np.ones(len(gravity)), gravity])
    theta = np.linalg.lstsq(x, raw, rcond=None)[0]
    rms = np.linalg.norm(raw - x @ theta, axis=0) / np.sqrt(max(len(x) - x.shape[1], 1))
    return theta[0], rms, np.ptp(x @ theta, axis=0)


def _lever(gravity: Array) -> float:
    """How far a misfit of RMS 1 may move the offset."""
    x = np.column_stack([np.ones(len(gravity)), gravity])
    return float(np.sqrt(len(x) * np.linalg.pinv(x.T @ x)[0, 0]))


WRONG_UNIT = 0.2
"""Share by which measured and stated gravity may differ, unless the unit is wrong."""


@dataclass(frozen=True)
class Excitation:
    """
    How far gravity moves in the sensor frame.

    Attributes
    ----------
    spreads : ndarray, shape (3,)
        Standard deviations along its principal directions, largest first [m/s^2].
    directions : ndarray, shape (3, 3)
        Those directions, one a row.
    gravity : float
        Magnitude of gravity [m/s^2].
    """

    spreads: Array
    directions: Array
    gravity: float

    @property
    def weak(self) -> bool:
        """Whether the offset along the last direction is hardly more than extrapolated."""
        # spread of gravity along a direction, over its magnitude, below which it is weak: 4 deg
        weak = 0.07
        return bool(self.spreads[2] < weak * self.gravity)

    @property
    def weakest(self) -> str:
        """The last direction in words: an axis, or a vector."""
        v = self.directions[2]
        axis = int(np.abs(v).argmax())
        if abs(v[axis]) > 0.9:
            return 'xyz'[axis]
        return '(' + ', '.join(f'{value:.2f}' for value in v) + ')'


def excitation(data_sets: Sequence[Moments], gravity: float) -> Excitation:
    """
    Spread of measured gravity within the data sets, the accelerometer's noise subtracted.

    Parameters
    ----------
    gravity : float
        [m/s^2]

    Raises
    ------
    UnobservableError
        Gravity does not move in three dimensions.
    """
    counts = [moments.count for moments in data_sets]
    spread = np.average([moments.spread for moments in data_sets], axis=0, weights=counts)
    values, vectors = np.linalg.eigh(spread)
    found = Excitation(np.sqrt(np.maximum(values[::-1], 0.0)), vectors[:, ::-1].T, gravity)
    # spread of gravity along a direction, over its magnitude, below which nothing is estimated
    blind = 0.01
    if found.spreads[2] < blind * gravity:
        raise UnobservableError(
            f'gravity varies by {found.spreads[0]:.3g}, {found.spreads[1]:.3g}, '
            f'{below(found.spreads[2], blind * gravity)} m/s^2 along its principal directions in '
            f'the sensor frame, too little along {found.weakest} (at least {blind * gravity:.3g} '
            'is required); tilt the body about a second axis, and further')
    return found


@dataclass(frozen=True)
class Norm:
    """
    What the magnitude of measured gravity shows of the accelerometer.

    Attributes
    ----------
    offset : ndarray, shape (3,)
        That makes the magnitude the same in all directions, sensor frame [m/s^2].
    std : ndarray, shape (3,)
    magnitude : float
        That is then the same in all directions [m/s^2].
    p : float
        Chance of such an offset from noise alone.
    """

    offset: Array
    std: Array
    magnitude: float
    p: float

    @property
    def usable(self) -> bool:
        """Whether the offset is there and known well enough to be removed."""
        # largest standard error at which an accelerometer offset found from |g| is used [m/s^2]
        trusted = 0.02
        return self.p < CHANCE and bool(self.std.max() < trusted) and bool(
            np.linalg.norm(self.offset) < WRONG_UNIT * self.magnitude)


def norm(data_sets: Sequence[tuple[Blocks, Mask]], gravity: float) -> Norm:
    """
    Fit a sphere to measured gravity: |g|^2 = 2 b g + const for an accelerometer offset b.

    Parameters
    ----------
    gravity : float
        Stated magnitude [m/s^2].

    Raises
    ------
    DataError
        The magnitude has nothing to do with the stated one.
    """
    g = np.vstack([blocks.regressors[use, :3] for blocks, use in data_sets])
    square = np.concatenate([blocks.square[use] for blocks, use in data_sets])
    typical = float(np.sqrt(np.median(square)))
    if abs(typical / gravity - 1) > WRONG_UNIT:
        raise DataError(f'the accelerometer reads {typical:.4g} m/s^2 at rest, expected '
                        f'{gravity:g} (gravity); correct its unit in the SPEC (m/s^2 or g)')
    x = np.column_stack([2 * g, np.ones(len(g))])
    theta, _, rank, _ = np.linalg.lstsq(x, square, rcond=1e-6)
    if rank < 4:
        return Norm(np.zeros(3), np.full(3, np.inf), typical, 1.0)
    residual = square - x @ theta
    variance = _long_run(residual) * len(g) / max(len(g) - 4, 1)
    covariance = np.linalg.inv(x.T @ x)[:3, :3] * max(variance, 1e-20)
    b = theta[:3]
    wald = float(b @ np.linalg.solve(covariance, b))
    return Norm(b, np.sqrt(np.diag(covariance)), float(np.sqrt(max(theta[3] + b @ b, 0.0))),
                float(chdtrc(3, wald)))


def _long_run(residual: Array) -> float:
    """Long-run variance of a scalar residual, at least its variance."""
    noise = noise_of_residuals(residual[:, None], max(1, int(2 * len(residual) ** (1 / 3))))
    return float(max(noise.covariance[0, 0], noise.long_run[0, 0]))
