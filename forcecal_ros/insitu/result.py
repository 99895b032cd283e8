"""What an in-situ calibration yields for one sensor, and its documents."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import plain
from forcecal_ros.insitu.equations import (
    Contradiction,
    GROSS,
    Load,
    LoadEstimate,
    MASS,
    PLACE,
    POOR,
    RankReport,
)
from forcecal_ros.insitu.offset import affine, Excitation, Norm
from forcecal_ros.insitu.reduce import Options
from forcecal_ros.insitu.screen import Cut
from forcecal_ros.insitu.uncertainty import Cause, Causes, Departure
import numpy as np


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
        What |g| shows of the accelerometer; None in motion.
    offset : Estimate, shape (n,)
        [raw units]
    offset_moves : ndarray, shape (k,)
        How far each data set's own offset is from the usual one, as a share of what gravity moves.
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
    nonlinearity : float or None
        What a linear map leaves where nothing hangs there but the added masses: RMS of the wrench
        over its range, of the worst axis.
    contradiction : Contradiction or None
        Which stated loads cannot be.
    """

    name: str
    options: Options
    excitation: Excitation
    norm: Norm | None
    offset: Estimate
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
    nonlinearity: float | None = None
    contradiction: Contradiction | None = None
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
        'accelerometer_offset': r.norm and Estimate(r.norm.offset, r.norm.std, 'm/s^2'),
        'offset': r.offset,
        'matrix': r.matrix,
        'manufacturer_matrix': r.manufacturer_matrix,
        'body': {'mass': r.mass, 'com': r.com, 'inertia': r.inertia or 'not identified'},
        'rank': r.rank and vars(r.rank),
        'leaves_subspace': r.causes and {
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
        'cut': [vars(cut) for cut in d.cuts],
        'singular_values': d.singular_values,
        'departure': d.departure and vars(d.departure),
        'stated': d.load and {
            'added_mass': d.load.mass, 'position': d.load.position if d.load.mass else None},
        'added_mass': d.added_mass, 'position': d.position, 'semi_axes': d.semi_axes,
        'by_manufacturer': maker and {
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
                                'requires the matrix (several added masses)')
    return Calibration(
        mass=result.mass, com=result.com, wrench_bias=result.wrench_bias, inertia=result.inertia,
        matrix=result.matrix, matrix_offset=result.offset, gravity=result.options.gravity,
        sensor_frame=frame,
        quality={'warnings': list(result.warnings), 'rank': result.rank.rank,
                 'unknowns': result.rank.unknowns},
        source={'method': 'forcecal insitu', 'recording': source})


FACTORS = {2.2046: 'check whether its forces are in lbf, or masses were converted twice',
           0.45359: 'check whether masses are in lb', 1e-3: 'check whether masses are in g',
           1 / 9.80665: 'check whether its forces are in kgf'}
"""Forces by the manufacturer over those by the matrix found, and what makes them so."""


def warnings_of(result: SensorResult) -> tuple[str, ...]:
    """Collect what is weak, cut, suspicious or contradictory."""
    return (*offsets_of(result), *_contradictions(result), *_by_manufacturer(result),
            *_excitation(result), *_accelerometer(result), *_cuts(result), *_subspace(result))


def _excitation(result: SensorResult) -> Iterator[str]:
    e = result.excitation
    if e.weak:
        yield (f'gravity varies little along {e.weakest} of the sensor frame: {e.spreads[2]:.2g} '
               f'm/s^2, compared with {e.spreads[0]:.3g} along the best direction; what depends '
               'on it has large standard errors: tilt further that way')


def _accelerometer(result: SensorResult) -> Iterator[str]:
    found, stated = result.norm, result.options.gravity
    if found is None:
        return
    if found.usable:
        b = ', '.join(f'{value:+.3f}' for value in found.offset)
        done = 'removed' if result.options.level_accelerometer else 'not removed'
        yield f'|g| indicates an accelerometer offset of ({b}) m/s^2 in the sensor frame; {done}'
    # share by which measured |g| may differ from the stated one without a warning
    most = 0.005
    if abs(found.magnitude / stated - 1) > most:
        yield (f'measured |g| is {found.magnitude:.4g} m/s^2, stated {stated:.6g}: the '
               "accelerometer's gain or the stated gravity is wrong, and so are all masses")
    for d in result.data_sets:
        # scatter of |g| above which a recording counts as moving [m/s^2]
        moves = 0.1
        if d.gravity_scatter > moves:
            yield (f'{d.name}: |g| varies by {d.gravity_scatter:.2g} m/s^2 because the body '
                   'accelerates; move slower')


def _by_manufacturer(result: SensorResult) -> Iterator[str]:
    """Compare total forces with those by the manufacturer's matrix: a sign, a unit of mass."""
    maker = result.manufacturer_matrix
    if result.matrix is None or maker is None:
        return
    raw = np.vstack([d.raw for d in result.data_sets]) - result.offset.value
    mine, other = (raw @ matrix[:3].T for matrix in (result.matrix.value, maker))
    ratio = float((mine * other).sum() / (mine ** 2).sum())
    # share by which two matrices' forces may differ and still be the same but for sign and unit
    alike = 0.1
    if np.linalg.norm(other - ratio * mine) > alike * np.linalg.norm(other):
        return
    if ratio < 0:
        yield ("forces by the manufacturer's matrix have the opposite sign: `measures` of the "
               'accelerometer is wrong (specific_force or gravity), or the manufacturer uses '
               'forces on the environment')
    for factor, unit in FACTORS.items():
        if abs(abs(ratio) / factor - 1) < alike:
            yield (f"forces by the manufacturer's matrix are {abs(ratio):.4g} times as large: "
                   f'{unit}')


def _cuts(result: SensorResult) -> Iterator[str]:
    for d in result.data_sets:
        for cut in d.cuts:
            inside = any(start <= cut.start and cut.end < end for start, end in d.kept)
            yield (f'{d.name}: {cut.start:.2f}..{cut.end:.2f} s '
                   f'{"should be" if inside else "was"} cut: {cut.reason}')


def _subspace(result: SensorResult) -> Iterator[str]:
    leaving = [d for d in result.data_sets if d.departure and d.departure.significant]
    if leaving:
        worst = max(leaving, key=_times)
        yield ('the raw measurements deviate from their three-dimensional subspace in '
               f'{len(leaving)} of {len(result.data_sets)} data sets, most in {worst.name}: '
               f'{_times(worst):.1f} times the noise of a block')
    causes = result.causes
    if causes and causes.bending.significant:
        yield ('channels deviate from the subspace with the square of gravity by up to '
               f'{_size(result, causes.bending)}: a joint (lock it) or the mount of sensor or '
               'accelerometer bends under load; the standard errors are increased by the part '
               'that an affine fit hides')
    if causes and causes.hysteresis.significant:
        yield (f'channels have a hysteresis of up to {_size(result, causes.hysteresis)}; it is '
               'removed if three data sets or more agree')
    yield from affine_misfit(result)


def affine_misfit(result: SensorResult) -> Iterator[str]:
    """Name a misfit of the linear model that is large against what the sensor shows."""
    found = result.nonlinearity
    shares = {d.name: _off_affine(d) for d in result.data_sets}
    worst = max(shares, key=lambda name: shares[name])
    if result.contradiction and shares[worst] < POOR:
        return  # what such loads leave over is not the sensor's
    if found is not None and found > POOR:
        yield (f'wrenches deviate from the linear map by {found:.0%} of their range (RMS): the '
               'sensor is nonlinear, or has hysteresis or drift; this, not noise, limits the '
               'calibration and is included in the standard errors')
    if found is not None:
        return
    if shares[worst] > POOR:
        yield (f'{worst}: the raw channels deviate from an affine map of gravity by '
               f'{shares[worst]:.0%} of their range (RMS): nonlinearity, hysteresis, drift, '
               'bending, or a dead or clipped channel; this, not noise, limits the calibration. '
               'If only the added mass hangs on the sensor, `body: none` is less sensitive to it')


def bent(result: SensorResult) -> bool:
    """Whether most data sets, each by itself, are far from an affine map of gravity."""
    return float(np.median([_off_affine(d) for d in result.data_sets])) > GROSS


def _off_affine(data_set: DataSetResult) -> float:
    """RMS of the residual of a data set's own affine map over the range, worst channel."""
    _, rms, _ = affine(data_set.gravity, data_set.raw)
    return float((rms / np.maximum(np.ptp(data_set.raw, axis=0), 1e-12)).max())


def _times(data_set: DataSetResult) -> float:
    return data_set.departure.times_noise if data_set.departure else 0.0


def _size(result: SensorResult, cause: Cause) -> str:
    rms = np.sqrt(np.diag(cause.covariance))
    return f'{rms.max():.2g} {result.options.raw_unit} (RMS, channel {int(rms.argmax()) + 1})'


def offsets_of(result: SensorResult) -> Iterator[str]:
    """Say that the offset moved between data sets."""
    if len(result.data_sets) < 2:
        return
    worst = int(result.offset_moves.argmax())
    if result.offset_moves[worst] > GROSS:
        yield (f'the offset changed between data sets, in {result.data_sets[worst].name} by '
               f'{result.offset_moves[worst]:.0%} of the effect of gravity: a tare (disable it, '
               'at the start of the driver too), temperature, a cable, or another order of '
               'channels')


def _contradictions(result: SensorResult) -> Iterator[str]:
    """Stated loads that cannot be, of data sets to train on and of those kept back."""
    if result.contradiction:
        yield result.contradiction.words
    heaviest = max((d.load.mass for d in result.data_sets if d.load), default=0.0)
    # standard errors from which on a load that was kept back is not as stated: once in a million
    far_off = 5.0
    for d in result.data_sets:
        if d.train or d.load is None or d.added_mass is None:
            continue
        off = float(d.added_mass.value) - d.load.mass
        careful = np.hypot(float(d.added_mass.std), MASS * heaviest)
        if abs(off) > far_off * careful:
            yield (f'{d.name}: the calibrated sensor finds {float(d.added_mass.value):.3f} kg '
                   f'added, stated {d.load.mass:g} kg; check which mass was attached in that '
                   'recording')
        elif d.position is not None and d.load.mass:
            away = d.position.value - d.load.position
            if (np.abs(away) > far_off * np.hypot(d.position.std, PLACE)).any():
                yield (f'{d.name}: the calibrated sensor finds the added mass '
                       f'{1000 * np.linalg.norm(away):.0f} mm from its stated position; check '
                       'where it was in that recording')
