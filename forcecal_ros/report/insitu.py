"""The report of an in-situ calibration: tables for a terminal, pictures, one HTML page."""

from collections.abc import Iterator, Mapping, Sequence

from forcecal_ros.calibration.model import Estimate
from forcecal_ros.geometry import Array
from forcecal_ros.insitu import SensorResult
from forcecal_ros.insitu.result import DataSetResult
from forcecal_ros.report.insitu_figures import force_clouds, singular_values, subspace_clouds
from forcecal_ros.report.page import picture, png, render_page
from forcecal_ros.report.quantity import rounded
from forcecal_ros.report.text import aligned
import numpy as np

Rows = list[list[str]]

WORDS = {
    'forces': 'Forces by the estimated matrix, and by the manufacturer’s where there is one. '
              'Weight is constant, so that a good matrix makes a sphere ([Traversaro2014] '
              'Fig. 6).',
    'subspace': 'Raw measurements in the three dimensions they span, and the ellipsoid that '
                'gravity draws about the offset ([Traversaro2014] Fig. 5).',
    'singular_values': 'Three singular values stand out where one rigid body hangs free '
                       '([Traversaro2014] Lemma 1).',
}


def pictures(result: SensorResult) -> dict[str, bytes]:
    """Return the pictures of one sensor as PNG by title."""
    figures = {'forces': force_clouds(result), 'subspace': subspace_clouds(result),
               'singular_values': singular_values(result)}
    return {title: png(figure) for title, figure in figures.items() if figure is not None}


def render(results: Sequence[SensorResult], drawn: Mapping[str, Mapping[str, bytes]],
           origin: str) -> str:
    """
    Return the report as HTML, one file without network.

    Parameters
    ----------
    drawn : mapping
        Of :func:`pictures`, by sensor.
    origin : str
        What it was made from.
    """
    sensors = [{
        'name': r.name, 'warnings': r.warnings, 'headline': conclusion(r),
        'tone': 'doubt' if r.warnings else 'good', 'tables': list(tables(r)),
        'figures': [picture(title.replace('_', ' ').capitalize(), WORDS[title], image)
                    for title, image in drawn[r.name].items()],
    } for r in results]
    return render_page('insitu.html.j2', 'In-situ calibration', origin=origin, sensors=sensors)


def conclusion(result: SensorResult) -> str:
    """Say in a sentence or two what was calibrated, and how well it does on what it never saw."""
    if result.matrix is None:
        return (f'The offset of {len(result.offset.value)} channels is known; the matrix is not, '
                'for want of stated added masses.')
    judged = [(d, d.load.mass, float(d.added_mass)) for d in result.data_sets
              if not d.train and d.load is not None and d.added_mass is not None
              and d.load.mass > 0.0]
    if not judged:
        return ('Matrix and offset are calibrated. No recording with an added mass was kept back '
                'to check them.')
    d, stated, found = max(judged, key=lambda one: abs(one[2] / one[1] - 1.0))
    said = (f'Matrix and offset are calibrated. Added masses that were kept back come out '
            f'within {_share(found / stated)} (data set {d.name}: {rounded(found, 4)} kg of '
            f'{stated:g} kg)')
    maker = [abs(d.by_manufacturer.mass / stated - 1.0) for d, stated, _ in judged
             if d.by_manufacturer is not None]
    return f'{said}; by the manufacturer’s matrix, {_share(1.0 + max(maker))}.' if (
        maker) else f'{said}.'


def _share(ratio: float) -> str:
    """Say how far a ratio is from one."""
    return f'{rounded(100.0 * abs(ratio - 1.0), 2)} %'


def text(result: SensorResult) -> str:
    """Return the conclusion and the tables of one sensor for a terminal."""
    parts = [f'sensor {result.name}', conclusion(result)]
    for title, head, rows in tables(result):
        lines = aligned([head, *rows], left=range(len(head)))
        parts += ['', title, *('  ' + line for line in lines)]
    return '\n'.join(parts) + '\n'


def tables(result: SensorResult) -> Iterator[tuple[str, list[str], Rows]]:
    """Yield every table of one sensor."""
    e = result.excitation
    yield ('Spread of gravity in the sensor frame', ['direction', 'm/s^2'],
           [[_vector(v, 2), f'{s:.3g}'] for v, s in zip(e.directions, e.spreads)])
    yield ('Data used', ['data set', 'use', 'samples', 'stretches [s]', 'singular values'],
           [[d.name, 'train' if d.train else 'validate', str(d.samples),
             ', '.join(f'{a:.1f}..{b:.1f}' for a, b in d.kept),
             ' '.join(f'{s:.3g}' for s in d.singular_values)] for d in result.data_sets])
    unit = result.options.raw_unit
    yield (f'Offset [{unit}]', ['channel', 'offset', 'standard error'],
           [[str(k + 1), f'{v:.6g}', f'{s:.2g}']
            for k, (v, s) in enumerate(zip(result.offset.value, result.offset.std))])
    if result.matrix is None or result.mass is None or result.com is None:
        return
    axes = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
    yield (f'Matrix [N/{unit}, N m/{unit}]', ['', *(str(k + 1) for k in range(len(
        result.offset.value)))],
           [[axis, *(f'{v:.5g} ± {s:.1g}' for v, s in zip(row, std))]
            for axis, row, std in zip(axes, result.matrix.value, result.matrix.std)])
    body = [['mass [kg]', f'{float(result.mass):.4f}', f'{float(result.mass.std):.2g}'],
            ['centre of mass [m]', _vector(result.com.value, 4), _vector(result.com.std, 4)]]
    if result.inertia is not None:
        body.append(['inertia about it [kg m^2]', _vector(np.diag(result.inertia.value), 4),
                     _vector(np.diag(result.inertia.std), 4)])
    yield 'Body', ['', 'estimate', 'standard error'], body
    yield from _papers(result)


def _papers(result: SensorResult) -> Iterator[tuple[str, list[str], Rows]]:
    """[Traversaro2014] Tables I, II and III."""
    maker = result.manufacturer_matrix is not None
    more = ['by manufacturer'] if maker else []
    loads = [d for d in result.data_sets if d.load is not None]
    yield ('Semi-axes of the force ellipsoid [N] (Table I)',
           ['data set', 'added mass [kg]', 'calibrated', *more],
           [[_name(d), _mass(d), _estimate(d.semi_axes, 2),
             *([_vector(d.by_manufacturer.semi_axes, 1)] if d.by_manufacturer else [])]
            for d in result.data_sets])
    yield ('Added mass [kg] (Table II)', ['data set', 'stated', 'calibrated', *more],
           [[_name(d), _mass(d), _estimate(d.added_mass, 4),
             *([f'{d.by_manufacturer.mass:.2f}'] if d.by_manufacturer else [])] for d in loads])
    yield ('Position of the added mass [m] (Table III)',
           ['data set', 'stated', 'calibrated', *more],
           [[_name(d), _vector(np.array(d.load.position), 3), _estimate(d.position, 4),
             *([_vector(d.by_manufacturer.position, 3)] if d.by_manufacturer else [])]
            for d in loads if d.load is not None and d.position is not None])


def _name(data_set: DataSetResult) -> str:
    return data_set.name + (' (trained on)' if data_set.train else '')


def _mass(data_set: DataSetResult) -> str:
    return 'not stated' if data_set.load is None else f'{data_set.load.mass:g}'


def _vector(values: Array, digits: int) -> str:
    return ' '.join(f'{value:.{digits}f}' for value in values)


def _estimate(estimate: Estimate | None, digits: int) -> str:
    if estimate is None:
        return '-'
    value, std = np.atleast_1d(estimate.value), np.atleast_1d(estimate.std)
    return f'{_vector(value, digits)} ± {_vector(std, digits)}'
