"""What an in-situ calibration yields for one sensor, and its documents."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import plain
from forcecal_ros.insitu.departure import Cause, Causes, Departure
from forcecal_ros.insitu.excitation import Excitation, Norm
from forcecal_ros.insitu.matrix import Load, LoadEstimate
from forcecal_ros.insitu.offset_moves import Jump
from forcecal_ros.insitu.rank import RankReport
from forcecal_ros.insitu.reduce import Options
from forcecal_ros.insitu.screen import Cut
from forcecal_ros.insitu.stated import Contradiction
import numpy as np


class NonLinearity(NamedTuple):
    """
    What a linear map leaves where every wrench is known.

    ``share`` RMS of the wrench's error over its range, of the worst axis; ``squares`` whether
    squares of the channels make errors of data sets left out smaller, by two standard errors.
    """

    share: float
    squares: bool


@dataclass(frozen=True)
class DataSetResult:
    """
    One data set.

    Attributes
    ----------
    load : Load or None
        As stated.
    kept : tuple of (float, float)
        Stretches used [s].
    cuts : tuple of Cut
        What was left out and why.
    samples : int
        Used.
    singular_values : ndarray, shape (n,)
        Of the centred raw measurements, over sqrt(samples).
    departure : Departure or None
        What leaves the subspace; None in motion, which has no subspace.
    gravity_scatter : float
        Standard deviation of measured |g|, which motion makes [m/s^2].
    raw, gravity : ndarray, shape (b, n), (b, 3)
        Block means used, for pictures.
    added_mass, position, semi_axes : Estimate or None
        By the calibrated sensor [kg], (3,) [m], (3,) [N].
    by_manufacturer : LoadEstimate or None
        The same by the manufacturer's matrix.
    """

    name: str
    train: bool
    load: Load | None
    kept: tuple[tuple[float, float], ...]
    cuts: tuple[Cut, ...]
    samples: int
    singular_values: Array
    departure: Departure | None
    gravity_scatter: float
    raw: Array
    gravity: Array
    added_mass: Estimate | None = None
    position: Estimate | None = None
    semi_axes: Estimate | None = None
    by_manufacturer: LoadEstimate | None = None


@dataclass(frozen=True)
class SensorResult:
    """
    One sensor.

    Attributes
    ----------
    norm : Norm or None
        What |g| says of the accelerometer; None in motion.
    offset : Estimate, shape (n,)
        [raw units]
    offset_scatter : ndarray, shape (k,)
        How far each data set's own offset is from the shared one, in its standard errors.
    offset_moves : ndarray, shape (k,)
        How far each data set's own offset is from the usual one, as a share of what gravity moves.
    jumps : tuple of Jump or None
        Of the offset within each data set; empty in motion and of poses.
    manufacturer_matrix : ndarray or None, shape (6, n)
    causes : Causes or None
        What the residuals of the affine maps of gravity come from; None in motion.
    matrix : Estimate or None, shape (6, n)
        Wire wrench = matrix (raw - offset).
    wrench_bias : Estimate or None, shape (6,)
        Zero, with the standard errors that the offset leaves of it [N, N m].
    mass, com, inertia : Estimate or None
        Of the body without added masses [kg], (3,) [m], (3, 3) about the centre of mass in
        motion [kg m^2].
    rank : RankReport or None
        Of the unknowns, on the data.
    nonlinearity : NonLinearity or None
        Where nothing hangs there but the added masses.
    contradiction : Contradiction or None
        Which stated loads cannot be.
    """

    name: str
    options: Options
    excitation: Excitation
    norm: Norm | None
    offset: Estimate
    offset_scatter: Array
    offset_moves: Array
    causes: Causes | None
    data_sets: tuple[DataSetResult, ...]
    manufacturer_matrix: Array | None
    matrix: Estimate | None = None
    wrench_bias: Estimate | None = None
    mass: Estimate | None = None
    com: Estimate | None = None
    inertia: Estimate | None = None
    rank: RankReport | None = None
    nonlinearity: NonLinearity | None = None
    contradiction: Contradiction | None = None
    jumps: tuple[Jump | None, ...] = ()
    warnings: tuple[str, ...] = ()


FORMAT = 'forcecal-insitu-result/1'


def to_document(results: tuple[SensorResult, ...]) -> dict[str, Any]:
    """
    Turn results into dicts, lists, numbers and words.

    Returns
    -------
    dict
        What ``insitu.json`` holds and ``--json`` prints.
    """
    return {'format': FORMAT, 'sensors': {r.name: plain(_sensor(r)) for r in results}}


def _sensor(r: SensorResult) -> dict[str, Any]:
    e = r.excitation
    return {
        'warnings': r.warnings,
        'excitation': {'spreads': e.spreads, 'directions': e.directions, 'weak': e.weak,
                       'weakest': e.weakest, 'unit': 'm/s^2'},
        'accelerometer_offset': None if r.norm is None else Estimate(
            r.norm.offset, r.norm.std, 'm/s^2'),
        'offset': r.offset,
        'matrix': r.matrix,
        'manufacturer_matrix': r.manufacturer_matrix,
        'body': {'mass': r.mass, 'com': r.com, 'inertia': r.inertia or 'not identified'},
        'rank': None if r.rank is None else {
            'rank': r.rank.rank, 'unknowns': r.rank.unknowns,
            'undetermined': r.rank.undetermined, 'singular_values': r.rank.singular_values},
        'leaves_subspace': None if r.causes is None else {
            'bending': _cause(r, r.causes.bending),
            'hysteresis': _cause(r, r.causes.hysteresis)},
        'data_sets': {d.name: _data_set(d) for d in r.data_sets},
    }


def _cause(r: SensorResult, cause: Cause) -> dict[str, Any]:
    return {'found': cause.significant, 'p': cause.p,
            'rms': np.sqrt(np.diag(cause.covariance)), 'unit': r.options.raw_unit}


def _data_set(d: DataSetResult) -> dict[str, Any]:
    maker = d.by_manufacturer
    return {
        'use': 'train' if d.train else 'validate',
        'samples': d.samples,
        'kept': d.kept,
        'cut': [{'start': c.start, 'end': c.end, 'reason': c.reason} for c in d.cuts],
        'singular_values': d.singular_values,
        'departure': None if d.departure is None else {
            'times_noise': d.departure.times_noise, 'p': d.departure.p},
        'stated': None if d.load is None else {
            'added_mass': d.load.mass, 'position': d.load.position if d.load.mass else None},
        'added_mass': d.added_mass, 'position': d.position, 'semi_axes': d.semi_axes,
        'by_manufacturer': None if maker is None else {
            'added_mass': maker.mass, 'semi_axes': maker.semi_axes,
            'position': maker.position if d.position else None},
    }


def to_calibration(result: SensorResult, frame: str, source: str) -> Calibration:
    """
    Return the calibration that observer and sequencer load; the tool is the body.

    Parameters
    ----------
    frame : str
        frame_id of the wrench.
    source : str
        What it was made from.

    Raises
    ------
    UnobservableError
        No matrix was estimated.
    """
    if result.matrix is None or result.mass is None or result.com is None \
            or result.wrench_bias is None or result.rank is None:
        raise UnobservableError(f'{result.name}: only the offset was estimated; a calibration '
                                'needs the matrix (several added masses)')
    return Calibration(
        mass=result.mass, com=result.com, wrench_bias=result.wrench_bias, inertia=result.inertia,
        matrix=result.matrix, matrix_offset=result.offset, gravity=result.options.gravity,
        sensor_frame=frame,
        quality={'warnings': list(result.warnings), 'rank': result.rank.rank,
                 'unknowns': result.rank.unknowns},
        source={'method': 'forcecal insitu', 'recording': source})
