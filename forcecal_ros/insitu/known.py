"""Where nothing hangs but the added mass every wrench is known: plain regression of it on the raw.

    W_i = (M_j) g_i = C (r_i - o)

Nothing has to be estimated along, so a few poses are enough. Errors come from data sets that are
left out, one after the other: they hold what a sensor that is not linear does between places.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.matrix import estimate_load, Load, LoadEstimate, total_map
from forcecal_ros.insitu.motion import STATIC
from forcecal_ros.insitu.rank import RankReport
from forcecal_ros.insitu.reduce import DataSet, Reduced
from forcecal_ros.insitu.result import DataSetResult, NonLinearity, SensorResult
import numpy as np

RELATIVE = 1e-6
"""Singular values of all known wrenches below this share of the largest are rounding."""

NOTHING = np.zeros(4)
"""The body."""


@dataclass(frozen=True)
class _Rows:
    """Blocks of one data set: ``gravity`` (b, 3), ``raw`` (b, n), ``wrench`` (b, 6)."""

    gravity: Array
    raw: Array
    wrench: Array


@dataclass(frozen=True)
class _Map:
    """Wrench = matrix raw + constant."""

    matrix: Array
    constant: Array

    def __call__(self, raw: Array) -> Array:
        return np.asarray(raw @ self.matrix.T + self.constant)

    @property
    def offset(self) -> Array:
        """Raw channels without load: of all that give no wrench, the nearest to zero."""
        return -np.linalg.pinv(self.matrix) @ self.constant


def with_known_wrenches(result: SensorResult, data_sets: Sequence[DataSet],
                        reduced: Sequence[Reduced]) -> SensorResult:
    """
    Add the matrix and the tables to a result, each number with its standard error.

    Raises
    ------
    UnobservableError
        Known wrenches, or those without one data set, do not span forces and torques.
    """
    rows = [_rows(d.load, r) for d, r in zip(data_sets, reduced)]
    train = [k for k, d in enumerate(data_sets) if d.train]
    fitted = _fit([rows[k] for k in train])
    without = [_fit([rows[j] for j in train if j != k]) for k in train]
    held_out = [_held_out(one, rows[k], data_sets[k].load) for one, k in zip(without, train)]
    off = np.sqrt(np.mean(held_out, axis=0))
    unit, n = result.options.raw_unit, fitted.matrix.shape[1]
    std = _jackknife([one.matrix for one in without])
    offset_std = _jackknife([one.offset for one in without])
    bias = _jackknife([one.constant - fitted.constant + (one.matrix - fitted.matrix)
                       @ fitted.offset for one in without])
    return replace(
        result, offset=Estimate(fitted.offset, offset_std, unit),
        matrix=Estimate(fitted.matrix, std, f'N/{unit}, N m/{unit}'),
        wrench_bias=Estimate(np.zeros(6), bias, 'N, N m'),
        mass=Estimate(0.0, 0.0, 'kg'), com=Estimate(np.zeros(3), np.zeros(3), 'm'),
        rank=RankReport(6 * n + 6, 6 * n + 6, (), np.zeros(0)),
        nonlinearity=_nonlinearity([rows[k] for k in train], fitted),
        data_sets=tuple(_tables(result, rows, fitted, off)))


def _rows(load: Load | None, reduced: Reduced) -> _Rows:
    blocks, use = reduced.blocks, reduced.use
    gravity = blocks.regressors[use, :STATIC]
    wrench = gravity @ total_map(NOTHING, load, STATIC).T if load else np.zeros((len(gravity), 6))
    return _Rows(gravity, blocks.raw[use], wrench)


def _fit(rows: Sequence[_Rows]) -> _Map:
    wrench = np.vstack([one.wrench for one in rows])
    raw = np.vstack([one.raw for one in rows])
    spread = wrench - wrench.mean(axis=0)
    strength = np.linalg.svd(spread / np.maximum(np.abs(spread).max(axis=0), 1e-12),
                             compute_uv=False)
    rank = int((strength > RELATIVE * strength[0]).sum())
    if rank < 6 or len(wrench) <= raw.shape[1] + 1:
        raise UnobservableError(
            f'{len(wrench)} known wrenches of {len(rows)} data sets (one is left out for the '
            f'standard errors) have rank {rank} of 6; add a data set with the mass at another '
            f'place, off the line of the others, and at least {raw.shape[1] + 2} poses in all')
    centre = raw.mean(axis=0)
    matrix = np.linalg.lstsq(raw - centre, spread, rcond=1e-9)[0].T
    return _Map(matrix, wrench.mean(axis=0) - matrix @ centre)


def _jackknife(values: Sequence[Array]) -> Array:
    """Return the standard error from estimates without one data set each."""
    return np.asarray(np.sqrt((len(values) - 1) * np.var(values, axis=0)))


def _estimate(fitted: _Map, rows: _Rows) -> LoadEstimate:
    size = float(np.linalg.norm(rows.gravity, axis=1).mean())
    return estimate_load(fitted(rows.raw), rows.gravity, NOTHING, size, True)


def _held_out(fitted: _Map, rows: _Rows, load: Load | None) -> Array:
    """Squared errors of mass, three semi-axes and the position's moment of a set left out."""
    assert load is not None
    found = _estimate(fitted, rows)
    size = float(np.linalg.norm(rows.gravity, axis=1).mean())
    moment = found.mass * found.position - load.mass * np.array(load.position)
    return np.concatenate([[found.mass - load.mass], found.semi_axes - load.mass * size,
                           moment]) ** 2


def _tables(result: SensorResult, rows: Sequence[_Rows], fitted: _Map, off: Array
            ) -> Iterator[DataSetResult]:
    """Tables I to III; their standard errors are the errors of the data sets left out."""
    for data_set, one in zip(result.data_sets, rows):
        found = _estimate(fitted, one)
        nothing = data_set.load is not None and not data_set.load.mass
        place = np.sqrt(off[4:] ** 2 + (found.position * off[0]) ** 2) / abs(found.mass)
        yield replace(data_set, added_mass=Estimate(found.mass, off[0], 'kg'),
                      semi_axes=Estimate(found.semi_axes, off[1:4], 'N'),
                      position=None if nothing else Estimate(found.position, place, 'm'))


def _nonlinearity(rows: Sequence[_Rows], fitted: _Map) -> NonLinearity:
    """How far wrenches are off the map, as shares of their range; and what squares would do."""
    wrench = np.vstack([one.wrench for one in rows])
    off = wrench - fitted(np.vstack([one.raw for one in rows]))
    gains = np.array([_gain(rows, k) for k in range(len(rows))])
    better = gains.mean() > 2 * gains.std(ddof=1) / np.sqrt(len(gains))
    return NonLinearity(float((off.std(axis=0) / np.maximum(np.ptp(wrench, axis=0), 1e-12)).max()),
                        bool(better))


def _gain(rows: Sequence[_Rows], k: int) -> float:
    """By how much squares of the channels make the squared error of a set left out smaller."""
    others = [one for j, one in enumerate(rows) if j != k]
    raw = np.vstack([one.raw for one in others])
    centre, span = raw.mean(axis=0), np.ptp(raw, axis=0)

    def squared(one: _Rows) -> _Rows:
        return replace(one, raw=np.hstack([one.raw, ((one.raw - centre) / span) ** 2]))

    scale = np.maximum(np.vstack([one.wrench for one in rows]).std(axis=0), 1e-12)
    if len(raw) <= 2 * raw.shape[1] + 1:
        return 0.0
    plain, more = _fit(others), _fit([squared(one) for one in others])
    one = rows[k]
    return float((((plain(one.raw) - one.wrench) / scale) ** 2).mean()
                 - (((more(squared(one).raw) - one.wrench) / scale) ** 2).mean())
