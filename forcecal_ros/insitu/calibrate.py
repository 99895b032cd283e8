"""From the recordings of one sensor to its calibration: the steps of [Traversaro2014] in order."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import quantity
from forcecal_ros.insitu.blocks import Blocks, Mask, Mounting
from forcecal_ros.insitu.equations import GROSS, Load, MASS, MOVING, require, STATIC
from forcecal_ros.insitu.fit import MatrixProblem, with_known_wrenches, with_matrix
from forcecal_ros.insitu.moments import Moments
from forcecal_ros.insitu.offset import (
    excitation,
    explained,
    offset_moves,
    shared_offset,
)
from forcecal_ros.insitu.reduce import (
    DataSet,
    LITTLE,
    Options,
    reduce,
    Reduced,
    without_hysteresis,
)
from forcecal_ros.insitu.result import (
    affine_misfit,
    bent,
    DataSetResult,
    offsets_of,
    SensorResult,
    warnings_of,
)
from forcecal_ros.insitu.uncertainty import (
    causes,
    hidden_covariance,
    Residual,
    residuals,
)
import numpy as np


def calibrate(name: str, data_sets: Sequence[DataSet], mounting: Mounting, options: Options,
              manufacturer_matrix: Array | None = None) -> SensorResult:
    """
    Calibrate one sensor in situ.

    Parameters
    ----------
    name : str
        Of the sensor.
    manufacturer_matrix : ndarray, shape (6, n), optional
        For comparison.

    Raises
    ------
    DataError, UnobservableError
        The recordings cannot answer; the message names the data set, numbers and a remedy.
    """
    if options.moving and not options.matrix:
        raise UnobservableError('with motion: on the offset is estimated only together with the '
                                'matrix; record several added masses')
    if options.matrix:
        loads = _training_loads(data_sets)
        if options.body:
            require(loads, MOVING if options.moving else STATIC)
    reduced, found_norm = reduce(data_sets, mounting, options)
    _check_channels([len(r.moments.mean) for r in reduced], options, manufacturer_matrix)
    # longer blocks, as recordings of many hours have, do not tell why they leave the subspace [s]
    longest = 1.0
    used = [(r.blocks, r.use) for r in reduced]
    brief = not options.moving and max(blocks.length for blocks, _ in used) <= longest
    found_causes = causes(used) if brief else None
    # data sets from which on a common hysteresis is removed: drift or touch is not common
    agreeing = 3
    if found_causes and options.body and len(data_sets) >= agreeing:
        reduced = without_hysteresis(reduced, found_causes.lags)
        used = [(r.blocks, r.use) for r in reduced]
    moments = [r.moments for r in reduced]
    excited = excitation(moments, options.gravity)
    if options.matrix and not options.moving:
        _require_alive(used)
    offset = np.zeros_like(moments[0].mean) if options.moving else shared_offset(moments)
    left = residuals([(r.moments, r.blocks, r.use) for r in reduced],
                     0.0 if options.poses else options.filter_window, options.filter_order)
    covariance = _covariance(moments, left)
    hidden = hidden_covariance(moments, found_causes)
    covariance = covariance if hidden is None else covariance + hidden
    offset_covariance = covariance[:len(offset), :len(offset)]
    result = SensorResult(
        name=name, options=options, excitation=excited, norm=found_norm,
        offset=Estimate(offset, np.sqrt(np.diag(offset_covariance)), options.raw_unit),
        offset_moves=np.zeros(len(moments)) if options.moving else offset_moves(used),
        causes=found_causes,
        data_sets=tuple(map(_data_set, data_sets, reduced)),
        manufacturer_matrix=manufacturer_matrix)
    if options.matrix:
        noise = np.mean([one.long_run for one in left], axis=0) + 1e-6 * np.diag(
            np.mean([np.diag(r.blocks.raw_noise) for r in reduced], axis=0))
        problem = MatrixProblem(tuple(data_sets), tuple(moments), offset, noise, covariance,
                                options.gravity)
        try:
            result = with_matrix(result, problem) if options.body else with_known_wrenches(
                result, data_sets, reduced)
        except UnobservableError as error:
            raise UnobservableError('; '.join([
                *offsets_of(result), str(error), *affine_misfit(result), *_cut_down(reduced)]
            )) from error
        if not bent(result) and result.matrix is not None:
            result = replace(result, contradiction=problem.contradiction(
                options.body, result.matrix.value))
    _require_possible(result, reduced)
    return replace(result, warnings=warnings_of(result))


def _cut_down(reduced: Sequence[Reduced]) -> Iterator[str]:
    """Say that screening left little."""
    share = sum(int(r.use.sum()) for r in reduced) / sum(len(r.use) for r in reduced)
    if share < LITTLE:
        yield (f'only {share:.0%} of the recordings fit an affine map of gravity, the rest was '
               'cut: contact, moving joints, or a nonlinear sensor')


def _require_possible(result: SensorResult, reduced: Sequence[Reduced]) -> None:
    """Refuse loads that contradict each other grossly, and masses below zero."""
    causes = [*offsets_of(result), *affine_misfit(result)]
    found = result.contradiction
    if found and found.share > GROSS:
        raise DataError('; '.join([*_cut_down(reduced), *offsets_of(result), found.words,
                                   *affine_misfit(result)]))
    careful = MASS * max(d.load.mass if d.load else 0.0 for d in result.data_sets)
    masses = [('the body', result.mass, 0.0), *(
        (f'the added mass in {d.name}', d.added_mass, careful) for d in result.data_sets)]
    for name, mass, known in masses:
        # standard errors below zero from which on a mass is refused: once in 30 000 by chance
        forbidden = 4.0
        if mass is not None and float(mass.value) < -forbidden * np.hypot(float(mass.std), known):
            words = [found.words] if found else [
                'the stated masses, positions or the direction of gravity are wrong']
            words += [] if causes else ['or the sensor is nonlinear']
            weight = quantity(float(mass), float(mass.std), 'kg')
            raise DataError(f'{name} is estimated as {weight}: {"; ".join([*causes, *words])}')


def _training_loads(data_sets: Sequence[DataSet]) -> list[Load]:
    missing = [d.name for d in data_sets if d.train and d.load is None]
    if missing:
        raise DataError(f'the added mass of {", ".join(missing)} is missing; set added_mass (0 '
                        'for none)')
    return [d.load for d in data_sets if d.train and d.load is not None]


def _check_channels(counts: Sequence[int], options: Options,
                    manufacturer_matrix: Array | None) -> None:
    channels = counts[0]
    if len(set(counts)) > 1:
        raise DataError(f'the data sets have {sorted(set(counts))} raw channels; the number must '
                        'be the same in all')
    if channels < (6 if options.matrix else 3):
        raise DataError(f'{channels} raw channels; at least {6 if options.matrix else 3} required')
    if manufacturer_matrix is not None and manufacturer_matrix.shape != (6, channels):
        raise DataError(f"the manufacturer's matrix is {manufacturer_matrix.shape}, {channels} "
                        f'raw channels require (6, {channels})')


def _require_alive(used: Sequence[tuple[Blocks, Mask]]) -> None:
    """Refuse fewer than six channels that gravity moves."""
    shares = explained(used)
    # share of a channel's changes that gravity explains at least: 0.4 of those of a sensor that
    # bends by twice its range, next to none of noise
    alive = 0.2
    dead = np.flatnonzero(shares < alive)
    if len(shares) - len(dead) < 6 and len(dead):
        raise DataError(
            f'channel {", ".join(str(k + 1) for k in dead)} does not respond to gravity (which '
            f'explains at most {max(float(shares[dead].max()), 0.0):.0%} of its variation): dead, '
            'not connected, or the wrong column; a six-axis matrix requires six that do')


def _covariance(moments: Sequence[Moments], left: Sequence[Residual]) -> Array:
    """
    Covariance of [offset, raw pseudo-samples of every data set], in the order of pack.

    Both are linear in the scores of each data set, which are independent of each other.
    """
    n = len(left[0].long_run)
    counts = [len(m.ones) for m in moments]
    starts = n * np.concatenate([[1], 1 + np.cumsum(counts)])
    total = np.zeros((starts[-1], starts[-1]))
    still = moments[0].directions.shape[1] == STATIC
    weight = sum(m.constant_weight for m in moments) if still else np.inf
    for m, one, start, size in zip(moments, left, starts, counts):
        to_offset = np.concatenate([[1.0], -m.ones])[None] / weight
        linear = np.zeros((starts[-1], (1 + size) * n))
        linear[:n] = np.kron(to_offset, np.eye(n))
        linear[start:start + size * n, n:] = np.eye(size * n)
        total += linear @ one.scores @ linear.T
    return total


def _data_set(data_set: DataSet, reduced: Reduced) -> DataSetResult:
    blocks, use = reduced.blocks, reduced.use
    return DataSetResult(
        name=data_set.name, train=data_set.train, load=data_set.load,
        kept=tuple((max(a, float(blocks.start[0])), min(b, float(blocks.end[-1])))
                   for a, b in reduced.screening.kept),
        cuts=reduced.screening.cuts, samples=reduced.moments.count,
        singular_values=reduced.moments.singular_values,
        departure=reduced.departure,
        gravity_scatter=reduced.gravity_scatter, raw=blocks.raw[use],
        gravity=blocks.regressors[use, :3])
