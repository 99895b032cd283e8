"""The report of an in-situ calibration: tables, pictures of [Traversaro2014], one HTML page."""

from collections.abc import Iterator, Mapping, Sequence
import shlex
from typing import Any

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import pair, rounded
from forcecal_ros.insitu import SensorResult
from forcecal_ros.insitu.offset import principal_basis
from forcecal_ros.insitu.result import DataSetResult
from forcecal_ros.report.figures import axes_grid, FIGURE_WIDTH, headed
from forcecal_ros.report.page import docs_link, Fact, picture, png, render_page
from forcecal_ros.report.rows import aligned, HALF_WIDTH
from matplotlib.figure import Figure
import numpy as np

CALIBRATED, MANUFACTURER, TRUE = '#009E73', '#D55E00', '#555555'


def subspace_clouds(result: SensorResult) -> Figure:
    """Draw raw measurements in their subspace with the ellipsoid about the offset, Fig. 5."""
    figure, axes = _grid(result.data_sets,
                         f'{result.name}: raw measurements [{result.options.raw_unit}]')
    for one, data_set in zip(axes, result.data_sets):
        mean, basis = data_set.raw.mean(axis=0), principal_basis(np.cov(data_set.raw.T))
        y, centre = ((raw - mean) @ basis for raw in (data_set.raw, result.offset.value))
        _ellipsoid(one, _map(data_set.gravity, y - centre) * result.options.gravity, centre,
                   CALIBRATED)
        _cloud(one, y, CALIBRATED, 'measured')
        one.scatter(*centre[:, None], color=TRUE, s=20, label='offset')
    return _finished(figure, axes)


def force_clouds(result: SensorResult) -> Figure | None:
    """Draw forces by the estimated matrix and by the manufacturer's, Fig. 6."""
    if result.matrix is None:
        return None
    chosen = [d for d in result.data_sets if not d.train] or list(result.data_sets)
    figure, axes = _grid(chosen, f'{result.name}: measured force [N]')
    matrices = [(result.manufacturer_matrix, MANUFACTURER, 'manufacturer'),
                (result.matrix.value, CALIBRATED, 'calibrated')]
    for one, data_set in zip(axes, chosen):
        for matrix, colour, label in matrices:
            if matrix is None:
                continue
            force = (data_set.raw - result.offset.value) @ matrix[:3].T
            _ellipsoid(one, _map(data_set.gravity, force) * result.options.gravity, np.zeros(3),
                       colour)
            _cloud(one, force, colour, label)
        for axis, name in zip((one.xaxis, one.yaxis, one.zaxis), 'xyz'):
            axis.set_label_text(name, fontsize=8)
            axis.labelpad = -7.0
    return _finished(figure, axes)


def singular_values(result: SensorResult) -> Figure:
    """Draw singular values over sqrt(n), which are RMS: [Traversaro2014] Lemma 1."""
    figure, (axes,) = axes_grid(1, 1, height=3.4)
    for data_set in result.data_sets:
        values = data_set.singular_values
        axes.semilogy(np.arange(1, len(values) + 1), values, 'o-', linewidth=0.7, markersize=4,
                      label=data_set.name)
    axes.axvline(3.5, color=TRUE, linewidth=0.8, linestyle='--')
    axes.set(xlabel='direction', ylabel=f'RMS along it [{result.options.raw_unit}]')
    axes.set_xticks(np.arange(1, len(result.offset.value) + 1))
    headed(axes, f'{result.name}: dimensions of the raw measurements', 2)
    return figure


def _grid(data_sets: Sequence[DataSetResult], title: str) -> tuple[Figure, list[Any]]:
    columns = min(len(data_sets), 2)
    rows = -(-len(data_sets) // columns)
    figure = Figure(figsize=(FIGURE_WIDTH, FIGURE_WIDTH / columns * rows + 0.6),
                    layout='constrained')
    figure.suptitle(title, fontsize=10)
    axes = [figure.add_subplot(rows, columns, k + 1, projection='3d')
            for k in range(len(data_sets))]
    for one, data_set in zip(axes, data_sets):
        one.set_title(data_set.name, fontsize=10)
        one.tick_params(labelsize=9, pad=-2)
        one.locator_params(nbins=3)
    return figure, axes


def _finished(figure: Figure, axes: Sequence[Any]) -> Figure:
    """Give all axes of clouds one scale, and their legend."""
    for one in axes:
        spans = np.ptp([one.get_xlim(), one.get_ylim(), one.get_zlim()], axis=1)
        flat = spans[2] < 0.6 * spans[0]
        one.set_box_aspect(spans, zoom=1.15 if flat else 0.9)
        one.locator_params('z', nbins=2 if flat else 3)
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside lower left', frameon=False,
                  fontsize=9, ncols=2)
    return figure


def _map(gravity: Array, values: Array) -> Array:
    """Linear map from gravity to values that have no offset, shape (3, 3)."""
    return np.linalg.lstsq(gravity, values, rcond=None)[0].T


def _cloud(axes: Any, points: Array, colour: str, label: str) -> None:
    points = points[::-(-len(points) // 600)]
    axes.scatter(*points.T, s=3, color=colour, label=label, depthshade=False)


def _ellipsoid(axes: Any, linear: Array, centre: Array, colour: str) -> None:
    """Draw the image of the unit sphere."""
    u, v = np.mgrid[0:2 * np.pi:19j, 0:np.pi:10j]
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    x, y, z = np.tensordot(linear, sphere, 1) + centre[:, None, None]
    axes.plot_wireframe(x, y, z, color=colour, linewidth=0.25, alpha=0.6)


Rows = list[list[str]]

AXES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')

WORDS = {
    'forces': 'Forces by the estimated matrix, and by the manufacturer’s, if given. '
              'Weight is constant, so that a correct matrix makes a sphere ([Traversaro2014] '
              'Fig. 6).',
    'subspace': 'Raw measurements in the three dimensions they span, and the ellipsoid that '
                'gravity draws about the offset ([Traversaro2014] Fig. 5).',
    'singular_values': 'Three singular values are large if one rigid body hangs freely '
                       '([Traversaro2014] Lemma 1).',
}


def pictures(result: SensorResult) -> dict[str, bytes]:
    """Return the pictures of one sensor as PNG by title."""
    drawn = {'forces': force_clouds(result), 'subspace': subspace_clouds(result),
             'singular_values': singular_values(result)}
    return {title: png(figure) for title, figure in drawn.items() if figure is not None}


def render(results: Sequence[SensorResult], drawn: Mapping[str, Mapping[str, bytes]],
           origin: str, written: Mapping[str, str]) -> str:
    """
    Return the report as HTML, one file without network.

    Parameters
    ----------
    drawn : mapping
        Of :func:`pictures`, by sensor.
    origin : str
        What it was made from.
    written : mapping of str to str
        Sensor -> file of its calibration.
    """
    sensors = [{
        'name': r.name, 'warnings': r.warnings, 'headline': conclusion(r),
        'facts': list(_facts(r, written.get(r.name, ''))),
        'tone': 'warn' if r.warnings else 'good', 'tables': list(tables(r)),
        'figures': [picture(title.replace('_', ' ').capitalize(), WORDS[title], image)
                    for title, image in drawn[r.name].items()],
    } for r in results]
    return render_page('insitu.html.j2', 'In-situ calibration', origin=[origin], sensors=sensors,
                       pages=[docs_link('how-to/insitu', 'in-situ calibration')])


def _facts(result: SensorResult, file: str) -> Iterator[Fact]:
    """Say how large, how sure, and what to do next."""
    if result.matrix is not None and result.mass is not None and result.com is not None:
        yield Fact('Body', (
            f'The body on the sensor weighs {_estimate(result.mass)} kg. Its centre '
            f'of mass is at {_pairs(1e3 * result.com.value, 1e3 * result.com.std)} mm (x, y, z).'))
    if result.warnings:
        yield Fact('Next', 'Follow the warnings below, and calibrate again.')
    elif result.matrix is None:
        yield Fact('Next', ('State added_mass and position of three data sets or more in the '
                            'specification, for the matrix.'))
    else:
        yield Fact('Next', 'Identify the tool through the matrix, from raw channels and poses:',
                   shlex.join(('forcecal', 'calibrate', 'my_bag', '--matrix', file)))


def conclusion(result: SensorResult) -> str:
    """Say in a sentence or two what was calibrated, and how well it does on what it never saw."""
    if result.matrix is None:
        return (f'The offset of {len(result.offset.value)} channels is known; the matrix is not, '
                'because no added masses are stated.')
    judged = [(d, d.load.mass, float(d.added_mass)) for d in result.data_sets
              if not d.train and d.load is not None and d.added_mass is not None
              and d.load.mass > 0.0]
    if not judged:
        return ('Matrix and offset are calibrated. No recording with an added mass was held out '
                'to check them.')
    d, stated, found = max(judged, key=lambda one: abs(one[2] / one[1] - 1.0))
    text = (f'Matrix and offset are calibrated. Held-out added masses are found '
            f'within {_share(found / stated)} (data set {d.name}: {rounded(found, 4)} kg of '
            f'{stated:g} kg)')
    maker = [abs(d.by_manufacturer.mass / stated - 1.0) for d, stated, _ in judged
             if d.by_manufacturer is not None]
    return f'{text}; by the manufacturer’s matrix, {_share(1.0 + max(maker))}.' if (
        maker) else f'{text}.'


def _share(ratio: float) -> str:
    """Say how far a ratio is from one."""
    return f'{rounded(100.0 * abs(ratio - 1.0), 2)} %'


def text(result: SensorResult) -> str:
    """Return the conclusion and the tables of one sensor for a terminal."""
    parts = [f'sensor {result.name}', conclusion(result), HALF_WIDTH]
    for title, head, rows in tables(result):
        lines = aligned([head, *rows], left=range(len(head)))
        parts += ['', title, *('  ' + line for line in lines)]
    return '\n'.join(parts) + '\n'


def tables(result: SensorResult) -> Iterator[tuple[str, list[str], Rows]]:
    """Yield every table of one sensor: how well it does, what it is, what it was found from."""
    unit = result.options.raw_unit
    if result.matrix is not None and result.mass is not None and result.com is not None:
        yield from _masses(result)
        yield (f'Matrix [N per {unit}, N m per {unit}]', ['', *(str(k + 1) for k in range(len(
            result.offset.value)))],
               [[axis, *map(pair, row, std)] for axis, row, std in zip(
                   AXES, result.matrix.value, result.matrix.std)])
        yield 'Body', ['', 'estimate'], list(_body(result, result.mass, result.com))
    yield (f'Offset [{unit}]', ['channel', 'offset'],
           [[str(k + 1), pair(v, s)]
            for k, (v, s) in enumerate(zip(result.offset.value, result.offset.std))])
    if result.matrix is not None:
        yield _ellipsoids(result)
    e = result.excitation
    yield ('Spread of gravity in the sensor frame', ['direction x, y, z', 'm/s^2'],
           [[_vector(v, 2), rounded(s)] for v, s in zip(e.directions, e.spreads)])
    yield ('Data used', ['data set', 'use', 'samples', 'stretches [s]',
            f'RMS along each direction [{unit}]'],
           [[d.name, 'train' if d.train else 'validate', str(d.samples),
             ', '.join(f'{a:.1f} to {b:.1f}' for a, b in d.kept),
             ', '.join(map(rounded, d.singular_values))] for d in result.data_sets])


def _body(result: SensorResult, mass: Estimate, com: Estimate) -> Iterator[list[str]]:
    yield ['mass [kg]', pair(float(mass), float(mass.std))]
    yield ['centre of mass x, y, z [m]', _estimate(com)]
    if result.inertia is not None:
        yield ['inertia about it xx, yy, zz [kg m^2]', _pairs(
            np.diag(result.inertia.value), np.diag(result.inertia.std))]


def _ellipsoids(result: SensorResult) -> tuple[str, list[str], Rows]:
    """[Traversaro2014] Table I."""
    return ('Semi-axes of the force ellipsoid [N] (Table I)',
            ['data set', 'added mass [kg]', 'calibrated', *_maker(result)],
            [[_name(d), _mass(d), _estimate(d.semi_axes),
              *([_vector(d.by_manufacturer.semi_axes, 1)] if d.by_manufacturer else [])]
             for d in result.data_sets])


def _masses(result: SensorResult) -> Iterator[tuple[str, list[str], Rows]]:
    """[Traversaro2014] Tables II and III."""
    loads = [d for d in result.data_sets
             if d.load is not None and (d.load.mass > 0.0 or not d.train)]
    yield ('Added mass [kg] (Table II)', ['data set', 'stated', 'calibrated', *_maker(result)],
           [[_name(d), _mass(d), _estimate(d.added_mass),
             *([f'{d.by_manufacturer.mass:.2f}'] if d.by_manufacturer else [])] for d in loads])
    yield ('Position x, y, z of the added mass [m] (Table III)',
           ['data set', 'stated', 'calibrated', *_maker(result)],
           [[_name(d), _vector(np.array(d.load.position), 3), _estimate(d.position),
             *([_vector(d.by_manufacturer.position, 3)] if d.by_manufacturer else [])]
            for d in loads if d.load is not None and d.position is not None])


def _maker(result: SensorResult) -> list[str]:
    return [] if result.manufacturer_matrix is None else ['by manufacturer']


def _name(data_set: DataSetResult) -> str:
    return data_set.name + (' (trained on)' if data_set.train else '')


def _mass(data_set: DataSetResult) -> str:
    return 'not stated' if data_set.load is None else f'{data_set.load.mass:g}'


def _vector(values: Array, digits: int) -> str:
    return ', '.join(f'{round(float(value), digits) + 0.0:.{digits}f}' for value in values)


def _pairs(values: Array, errors: Array) -> str:
    return ', '.join(map(pair, np.atleast_1d(values), np.atleast_1d(errors)))


def _estimate(estimate: Estimate | None) -> str:
    return '-' if estimate is None else _pairs(estimate.value, estimate.std)
