"""How far gravity moves in the sensor frame, and what its magnitude says of the accelerometer."""

from collections.abc import Sequence
from dataclasses import dataclass

from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_residuals
from forcecal_ros.insitu.blocks import Blocks, Mask
from forcecal_ros.insitu.moments import Moments
import numpy as np
from scipy.special import chdtrc

WEAK = 0.07
"""Spread of gravity along a direction, over its magnitude, below which it is weak: 4 deg."""

BLIND = 0.01
"""Spread of gravity along a direction, over its magnitude, below which nothing is estimated."""

WRONG_UNIT = 0.2
"""Share by which measured and stated gravity may differ, unless the unit is wrong."""

TRUSTED = 0.02
"""Largest standard error at which an accelerometer offset found from |g| is used [m/s^2]."""

SIGNIFICANT = 1e-3
"""Probability by chance below which such an offset is taken to be there."""


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
        return bool(self.spreads[2] < WEAK * self.gravity)

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
    Spread of measured gravity within the data sets, the accelerometer's noise taken off.

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
    if found.spreads[2] < BLIND * gravity:
        raise UnobservableError(
            f'gravity moves by {found.spreads[0]:.3g}, {found.spreads[1]:.3g}, '
            f'{found.spreads[2]:.2g} m/s^2 along its principal directions in the sensor frame, '
            f'too little along {found.weakest} (at least {BLIND * gravity:.2g} is needed); tilt '
            'the body about a second axis, and further')
    return found


@dataclass(frozen=True)
class Norm:
    """
    What the magnitude of measured gravity says of the accelerometer.

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
        """Whether the offset is there and known well enough to be taken off."""
        return self.p < SIGNIFICANT and bool(self.std.max() < TRUSTED) and bool(
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
        raise DataError(f'the accelerometer shows {typical:.4g} m/s^2 at rest, gravity is '
                        f'{gravity:g}; state its unit in the SPEC (m/s^2 or g)')
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
