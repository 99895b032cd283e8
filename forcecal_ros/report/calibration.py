"""The report of a calibration as one HTML page."""

from collections.abc import Mapping
from typing import Any

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.geometry import Array
from forcecal_ros.recording.level import levelled
from forcecal_ros.recording.mount import in_axes_of_pose
from forcecal_ros.recording.streams import Recording, Stream
from forcecal_ros.report import figures
from forcecal_ros.report.page import picture, render_page
from forcecal_ros.report.rows import interval, Row, table, value
from matplotlib.figure import Figure


def render(recording: Recording, calibration: Calibration, contact: Stream | None = None,
           truth: Mapping[str, Array] | None = None) -> str:
    """
    Return a calibration report: warnings first, then numbers, then pictures.

    Parameters
    ----------
    recording : Recording
        What was identified from.
    contact : Stream, optional
        (n, 6) contact wrench by the observer over the same recording [N, N m].
    truth : mapping of str to ndarray, optional
        True values by key, where a simulator knows them.

    Returns
    -------
    str
        HTML, one file without network; everything from the recording is escaped.
    """
    recording = in_axes_of_pose(levelled(recording, calibration.gravity_direction),
                                calibration.sensor_rotation)
    rows = [*table(calibration, truth), *promises(calibration)]
    source = calibration.source
    with_truth = any(row.truth is not None for row in rows)
    return render_page(
        'calibration.html.j2', 'Calibration report',
        origin=' · '.join(str(source[k]) for k in ('recording', 'created') if k in source),
        warnings=calibration.quality.get('warnings', ()),
        head=['estimate', 'value', '95 % interval', 'unit'] + ['truth', 'off by'] * with_truth,
        rows=[_cells(row, with_truth) for row in rows],
        figures=list(_pictures(recording, calibration, contact)),
        quality=sorted(_flat(calibration.quality)))


def _cells(row: Row, with_truth: bool) -> list[str]:
    cells = [row.name, value(row), interval(row), row.unit]
    if with_truth:
        cells += ['' if row.truth is None else f'{row.truth:.6g}',
                  '' if row.sigmas is None else f'{row.sigmas:+.1f} σ']
    return cells


def _pictures(recording: Recording, calibration: Calibration,
              contact: Stream | None) -> Any:
    drawn: list[tuple[str, str, Figure | None]] = [
        ('Poses', 'The weight of the tool in each orientation, and the residuals.',
         figures.pose_means(recording, calibration)),
        ('Step', 'The inertial force of the step motion that the accelerometer has to explain.',
         figures.step_fit(recording, calibration)),
        ('Accelerometer', 'The slope is the gain, free of the delay between the two sensors.',
         figures.accelerometer_regression(recording, calibration)),
    ]
    if contact is not None:
        drawn += [
            ('Observer', 'Weight and inertia are gone from the contact force.',
             figures.observer_output(recording, calibration, contact)),
            ('Spectra', 'How the observer filters the noise of sensor and accelerometer.',
             figures.spectra(recording, calibration, contact)),
        ]
    words = 'What filter kalman leaves of the noise of a steady contact, and what another would.'
    drawn.append(('Noise against response', words, figures.noise_against_rise(calibration)))
    for title, words, figure in drawn:
        if figure is not None:
            yield picture(title, words, figure, dpi=130)


def _flat(quality: Mapping[str, Any], prefix: str = '') -> Any:
    for key, one in quality.items():
        if isinstance(one, Mapping):
            yield from _flat(one, f'{prefix}{key}.')
        elif key != 'warnings':
            yield f'{prefix}{key}', _short(one)


def _short(one: Any) -> str:
    """Write a figure, or a list of them, in a few digits."""
    if isinstance(one, float):
        return f'{one:.4g}'
    if isinstance(one, (list, tuple)):
        return '[' + ', '.join(map(_short, one)) + ']'
    if isinstance(one, Mapping):
        return ', '.join(f'{key} {_short(item)}' for key, item in one.items())
    return str(one)
