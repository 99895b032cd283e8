"""Results as plain documents, and as the calibration that observer and sequencer load."""

from typing import Any

from forcecal_ros.calibration.model import Calibration, Estimate
from forcecal_ros.errors import UnobservableError
from forcecal_ros.insitu.departure import Cause
from forcecal_ros.insitu.result import DataSetResult, SensorResult
from forcecal_ros.schema import plain
import numpy as np

FORMAT = 'forcecal-insitu-result/1'


def to_document(results: tuple[SensorResult, ...]) -> dict[str, Any]:
    """
    Turn results into dicts, lists, numbers and words.

    Parameters
    ----------
    results : tuple of SensorResult

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
    result : SensorResult
    frame : str
        frame_id of the wrench.
    source : str
        What it was made from.

    Returns
    -------
    Calibration

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
