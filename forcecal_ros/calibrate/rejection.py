"""
Static poses that do not fit one tool: which to measure again, and what changed in between.

"If the error is larger than a threshold defined previously, something in the setup, programs or
system are not in the right order": the observed error of a pose is how far it lies from what all
others predict. That is the outlier test of a mean shift: with readings whitened, residuals r and
their projection M = I - H, a shift of pose k is estimated by M_kk^+ r_k, and r_k^T M_kk^+ r_k is
chi-square where there is none.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from forcecal_ros.calibrate.static_readings import Statics
from forcecal_ros.calibrate.tool import design_of, slide_noise, ToolFit
from forcecal_ros.core.geometry import Array, skew
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
    """

    shift: Array
    mass: float
    probability: float


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
                     float(chdtrc(int(known.sum()), statistic)))


def rejected(errors: Sequence[PoseError], probability: float) -> int | None:
    """
    Return the pose to measure again, if any.

    It is the least probable one, where chance makes any of so many poses as improbable less often
    than ``probability``.
    """
    chances = [1.0 if np.isnan(one.probability) else one.probability for one in errors]
    if not chances or min(chances) * len(chances) >= probability:
        return None
    return int(np.argmin(chances))


_BETTER = 10.0
"""A change is named where it leaves so many times less, per degree of freedom."""

_LEAST = 2
"""Poses on either side of a change, at least."""

_TOUCHED = 0.34
"""Largest share of poses that may be touched: the others have to tell the tool."""


_DEGREES = 6
"""Degrees of freedom that a change has to leave: of fewer some leave nothing by chance."""

_FITS = 2.0
"""Poses that leave less, per degree of freedom, are as sound as others: no more need to go."""


class _Change(NamedTuple):
    """A hypothesis: columns it adds to the tool's, and what is said of it."""

    columns: Array
    said: str


def what_changed(statics: Statics, times: Array) -> str:
    """
    Name the one change that makes static poses fit one tool.

    Parameters
    ----------
    statics : Statics
        With covariance.
    times : ndarray, shape (n,)
        Of the poses [s].

    Returns
    -------
    str
        Empty where none does.
    """
    assert statics.covariance is not None
    n = len(times)
    weight = 1.0 / np.sqrt(np.diagonal(statics.covariance, axis1=1, axis2=2))[:, :, None]
    load = _load(statics.gravity)
    plain = design_of(statics)[0][:6 * n].reshape(n, 6, -1)
    before = _reduced_chi_square(plain, statics.wrench, weight)
    found = [(_reduced_chi_square(
        np.concatenate([plain, one.columns], axis=2), statics.wrench, weight), one)
        for one in (*_changes(load, times), *_touched(plain, statics.wrench, weight))]
    best = min(found, key=lambda pair: pair[0], default=None)
    return '' if best is None or best[0] * _BETTER > before else best[1].said


def _load(gravity: Array) -> Array:
    """Columns of mass and mass times place, (n, 6, 4)."""
    columns = np.zeros((len(gravity), 6, 4))
    columns[:, :3, 0], columns[:, 3:, 1:] = gravity, -skew(gravity)
    return columns


def _reduced_chi_square(columns: Array, wrench: Array, weight: Array) -> float:
    """Chi-square per degree of freedom; inf where too few are left."""
    rows = (columns * weight).reshape(wrench.size, -1)
    right = (wrench[:, :, None] * weight).ravel()
    theta, _, rank, _ = np.linalg.lstsq(rows, right, rcond=1e-9)
    degrees = wrench.size - int(rank)
    return float(((right - rows @ theta)**2).sum()) / degrees if degrees >= _DEGREES else np.inf


def _changes(load: Array, times: Array) -> Iterator[_Change]:
    n = len(times)
    for k in range(_LEAST, n - _LEAST + 1):
        after = (np.arange(n) >= k)[:, None, None]
        when = f'between pose {k} and pose {k + 1} ({times[k - 1]:.1f} to {times[k]:.1f} s)'
        yield _Change(np.eye(6) * after, 'they fit one tool with a bias that jumps '
                      f'{when}: a sensor tared or a driver started anew; use either part alone')
        yield _Change(load * after, f'they fit a load that changes {when}: something gripped, '
                      'let go, opened or slipped; use either part alone')
    run = (times - times.mean())[:, None, None] / np.ptp(times)
    yield _Change(np.concatenate([np.eye(6) * run, np.eye(6) * run**2], axis=2),
                  'they fit one tool with a bias that drifts: let the sensor warm up, and '
                  'record again')


def _touched(plain: Array, wrench: Array, weight: Array) -> Iterator[_Change]:
    """Poses that are off by any wrench, added one by one as far as they help."""
    n, off = len(wrench), list[int]()
    for _ in range(int(_TOUCHED * n)):
        chi_square_without = {i: _reduced_chi_square(*(np.delete(part, [*off, i], axis=0)
                           for part in (plain, wrench, weight)))
                for i in range(n) if i not in off}
        off.append(min(chi_square_without, key=lambda i: chi_square_without[i]))
        columns = np.zeros((n, 6, 6 * len(off)))
        for j, i in enumerate(off):
            columns[i, :, 6 * j:6 * j + 6] = np.eye(6)
        named = ', '.join(str(i + 1) for i in sorted(off))
        yield _Change(columns, f'without pose{"s" * (len(off) > 1)} {named} they fit one tool: '
                      'a cable or a hand pulled there, or it was not yet still')
        if chi_square_without[off[-1]] < _FITS:
            return
