"""The pictures of an in-situ calibration, [Traversaro2014] Fig. 5 and 6."""

from collections.abc import Sequence
from typing import Any

from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu import SensorResult
from forcecal_ros.insitu.offset import principal_directions, Subspace, to_coordinates
from forcecal_ros.insitu.result import DataSetResult
from forcecal_ros.report.figures import headed
from matplotlib.figure import Figure
import numpy as np

CALIBRATED, MANUFACTURER, TRUE = '#009E73', '#D55E00', '#555555'
POINTS = 600
"""Most points of a cloud; more would hide each other."""

COLUMNS = 4
"""Most pictures side by side."""

HEAD = 0.7
"""Of a picture, for title and legend [in]."""


def subspace_clouds(result: SensorResult) -> Figure:
    """Draw raw measurements in their subspace with the ellipsoid about the offset, Fig. 5."""
    figure, axes = _grid(result.data_sets)
    for one, data_set in zip(axes, result.data_sets):
        basis, _ = principal_directions(data_set.raw)
        subspace = Subspace(data_set.raw.mean(axis=0), basis)
        y = to_coordinates(subspace, data_set.raw)
        centre = to_coordinates(subspace, result.offset.value)
        _ellipsoid(one, _map(data_set.gravity, y - centre) * result.options.gravity, centre,
                   CALIBRATED)
        _cloud(one, y, CALIBRATED, 'measured')
        one.scatter(*centre[:, None], color=TRUE, s=20, label='offset')
        one.set_title(data_set.name, fontsize=8)
        one.set_aspect('equal')
    _head(figure, axes[0], f'{result.name}: raw measurements in their three dimensions '
          f'[{result.options.raw_unit}]')
    return figure


def force_clouds(result: SensorResult) -> Figure | None:
    """Draw forces by the estimated matrix and by the manufacturer's, Fig. 6."""
    if result.matrix is None:
        return None
    chosen = [d for d in result.data_sets if not d.train] or list(result.data_sets)
    figure, axes = _grid(chosen)
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
        one.set_title(data_set.name, fontsize=8)
        one.set_aspect('equal')
    _head(figure, axes[0], f'{result.name}: measured force; gravity makes a sphere of it [N]')
    return figure


def singular_values(result: SensorResult) -> Figure:
    """Draw singular values over sqrt(n), which are RMS: [Traversaro2014] Lemma 1."""
    figure = Figure(figsize=(8.0, 3.2), layout='constrained')
    axes = figure.subplots()
    for data_set in result.data_sets:
        values = data_set.singular_values
        axes.semilogy(np.arange(1, len(values) + 1), values, 'o-', linewidth=0.7, markersize=4,
                      label=data_set.name)
    axes.axvline(3.5, color=TRUE, linewidth=0.8, linestyle='--')
    axes.set(xlabel='direction', ylabel=f'RMS along it [{result.options.raw_unit}]')
    axes.set_xticks(np.arange(1, len(result.offset.value) + 1))
    axes.grid(alpha=0.25)
    axes.spines[['top', 'right']].set_visible(False)
    headed(axes, f'{result.name}: dimensions of the raw measurements', COLUMNS)
    return figure


def _grid(data_sets: Sequence[DataSetResult]) -> tuple[Figure, list[Any]]:
    columns = min(len(data_sets), COLUMNS)
    rows = -(-len(data_sets) // columns)
    height = 2.7 * rows + HEAD
    figure = Figure(figsize=(max(2.6 * columns, 4.5), height))
    figure.subplots_adjust(0.02, 0.02, 0.92, 1 - (HEAD + 0.2) / height, 0.2, 0.12)
    axes = [figure.add_subplot(rows, columns, k + 1, projection='3d')
            for k in range(len(data_sets))]
    for one in axes:
        one.tick_params(labelsize=6, pad=-3)
        one.locator_params(nbins=3)
    return figure, axes


def _head(figure: Figure, axes: Any, title: str) -> None:
    """Put title and legend above all clouds."""
    figure.suptitle(title, fontsize=10, x=0.02, ha='left', y=1.0 - 0.08 / figure.get_figheight(),
                    va='top')
    figure.legend(*axes.get_legend_handles_labels(), loc='upper left', frameon=False, fontsize=8,
                  ncols=COLUMNS, bbox_to_anchor=(0.0, 1.0 - 0.25 / figure.get_figheight()))


def _map(gravity: Array, values: Array) -> Array:
    """Linear map from gravity to values that have no offset, shape (3, 3)."""
    return np.linalg.lstsq(gravity, values, rcond=None)[0].T


def _cloud(axes: Any, points: Array, colour: str, label: str) -> None:
    points = points[::-(-len(points) // POINTS)]
    axes.scatter(*points.T, s=3, color=colour, label=label, depthshade=False)


def _ellipsoid(axes: Any, linear: Array, centre: Array, colour: str) -> None:
    """Draw the image of the unit sphere."""
    u, v = np.mgrid[0:2 * np.pi:19j, 0:np.pi:10j]
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    x, y, z = np.tensordot(linear, sphere, 1) + centre[:, None, None]
    axes.plot_wireframe(x, y, z, color=colour, linewidth=0.25, alpha=0.6)
