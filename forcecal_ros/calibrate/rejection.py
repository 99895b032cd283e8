"""
Static poses that do not fit one tool: which to measure again.

"If the error is larger than a threshold defined previously, something in the setup, programs or
system are not in the right order": the observed error of a pose is how far it lies from what all
others predict. That is the outlier test of a mean shift: with readings whitened, residuals r and
their projection M = I - H, a shift of pose k is estimated by M_kk^+ r_k, and r_k^T M_kk^+ r_k is
chi-square where there is none.
"""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.calibrate.static_readings import Statics
from forcecal_ros.calibrate.tool import design_of, slide_noise, ToolFit
from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.special import chdtrc

_ESTIMABLE = 1e-6
"""Eigenvalue of M_kk below which the other poses do not predict a direction: it is rounding."""


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
    design, reading = design_of(statics)
    blocks = statics.covariance + tool.mass**2 * slide_noise(statics)
    lower = np.linalg.cholesky(blocks)
    rows, right = design.copy(), reading.copy()
    for k, L in enumerate(lower):
        part = slice(6 * k, 6 * k + 6)
        rows[part], right[part] = np.linalg.solve(L, rows[part]), np.linalg.solve(L, right[part])
    basis = np.linalg.qr(rows / np.linalg.norm(rows, axis=0))[0]
    residual = right - basis @ (basis.T @ right)
    return [_error(residual[6 * k:6 * k + 6], basis[6 * k:6 * k + 6], L, g)
            for k, (L, g) in enumerate(zip(lower, statics.gravity))]


def _error(residual: Array, basis: Array, lower: Array, gravity: Array) -> PoseError:
    values, vectors = np.linalg.eigh(np.eye(6) - basis @ basis.T)
    known = values > _ESTIMABLE
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


TOUCHED_SIGMA, MAX_TOUCHED = 10.0, 0.34
"""Errors of their means by which poses are off one tool that the others fit, and the largest
share of poses that may be."""


def touched(statics: Statics) -> list[int]:
    """Return the poses without which all others fit one tool, if there are a few."""
    assert statics.covariance is not None
    sigma = np.sqrt(np.diagonal(statics.covariance, axis1=1, axis2=2))
    n = len(sigma)
    columns = design_of(statics)[0][:6 * n].reshape(n, 6, -1) / sigma[:, :, None]
    fit = robust_fit(columns, statics.wrench / sigma, channels=6, freedom=2.0)
    off = np.abs(fit.residual.reshape(n, 6)).max(axis=1) > TOUCHED_SIGMA
    return np.flatnonzero(off).tolist() if off.mean() <= MAX_TOUCHED else []
