"""The report of a calibration as one HTML page, its quality figures as sentences."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from forcecal_ros.calibrate.settings import Thresholds
from forcecal_ros.core.axes import in_axes_of_pose, levelled
from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import HALF, quantity, rounded, size, sizes
from forcecal_ros.core.streams import FREE, Recording, STILL, Stream
from forcecal_ros.report import figures
from forcecal_ros.report.figures import Line, Panel, Shown
from forcecal_ros.report.page import docs_link, Fact, origin, Picture, picture, render_page, Step
from forcecal_ros.report.rows import cells, promises, table
import numpy as np

REPEAT = Step('Follow the warnings below, and calibrate again. Estimates that they do not name '
              'can be used.')


class Free(NamedTuple):
    """Force where nothing touches: RMS of sensor less bias and of the observer [N], samples."""

    sensor: float
    observer: float
    samples: int


def render(recording: Recording, calibration: Calibration, contact: Stream | None = None,
           truth: Mapping[str, Array] | None = None, step: Step | None = None) -> str:
    """
    Return a calibration report: what it is worth first, then numbers, then details.

    Parameters
    ----------
    recording : Recording
        What was identified from.
    contact : Stream, optional
        (n, 6) contact wrench by the observer over the same recording [N, N m].
    truth : mapping of str to ndarray, optional
        True values by key, where a simulator knows them.
    step : Step, optional
        What to do next where nothing is called into question.

    Returns
    -------
    str
        HTML, one file without network; everything from the recording is escaped.
    """
    recording = in_axes_of_pose(levelled(recording, calibration.gravity_direction),
                                calibration.sensor_rotation)
    head, *rows = cells([*table(calibration, truth), *promises(calibration)])
    warnings = list(calibration.quality.get('warnings', ()))
    free, found = free_motion(recording, calibration, contact), list(in_words(calibration.quality))
    return render_page(
        'calibration.html.j2', 'Calibration report', origin=_origin(recording, calibration),
        tone='warn' if warnings else 'good',
        word=f'calibrated, warnings: {len(warnings)}' if warnings else 'calibrated',
        headline=_headline(calibration, free), facts=_facts(calibration, free, warnings, step),
        warnings=warnings, head=head, rows=rows,
        first=[picture('Force before and after', (
            'The measured force without its bias, and the contact force of the observer, which '
            'contains neither weight nor inertia of the tool.'), forces(
                recording, calibration, contact))] if recording.wrench and contact else [],
        figures=list(_pictures(recording, calibration, contact)),
        quality=[one for one in found if one[0] != 'Note'],
        notes=[words for title, words in found if title == 'Note'],
        pages=[docs_link('explanation/calibration', 'calibration')])


def free_motion(recording: Recording, calibration: Calibration, contact: Stream | None
                ) -> Free | None:
    """Compare sensor and observer where the phases say that nothing touches the tool."""
    wrench = recording.wrench
    if not (wrench and contact):
        return None
    t = wrench.t
    rows = np.zeros(len(t), dtype=bool)
    for phase in recording.phases:
        if phase.name in FREE + STILL:
            rows |= (t >= phase.start) & (t < phase.end)
    estimated = contact.at(t)[:, :3]
    rows &= (t >= contact.t[0]) & (t <= contact.t[-1]) & np.isfinite(estimated).all(axis=1)
    if not rows.any():
        return None
    sensor = wrench.values[:, :3] - calibration.wrench_bias.value[:3]
    before, after = (float(np.sqrt(np.mean(np.sum(f[rows] ** 2, axis=1))))
                     for f in (sensor, estimated))
    return Free(before, after, int(rows.sum()))


def _headline(c: Calibration, free: Free | None) -> str:
    tool = f'The tool weighs {quantity(float(c.mass), float(c.mass.std), "kg")}.'
    if free is None:
        return tool
    return (f'{tool} In free motion the sensor shows {size(free.sensor, "N")}; '
            f'{size(free.observer, "N", 2)} RMS remain after compensation.')


def _facts(c: Calibration, free: Free | None, warnings: list[str], step: Step | None
           ) -> list[Fact]:
    com = ', '.join(f'{axis} {quantity(float(v), float(s), "m")}'
                    for axis, v, s in zip('xyz', c.com.value, c.com.std))
    facts = [Fact('Tool', f'Centre of mass {com} from the sensor.')]
    if free is not None:
        facts.append(Fact('Contact force', (
            f'{size(free.observer, "N", 2)} RMS of error in free motion, of '
            f'{size(free.sensor, "N")} that the sensor shows without its bias '
            f'({free.samples:,} samples).')))
    if c.accelerometer is not None and float(c.accelerometer.delay.std) > 0.0:
        delay = c.accelerometer.delay
        facts.append(Fact('Accelerometer', f'{_begun(delay)}.'))
    if warnings:
        return [*facts, Fact('Checks', f'{len(warnings)} did not pass; see below.'),
                Fact('Next', REPEAT.words)]
    facts.append(Fact('Checks', 'Every estimate in the table passed its checks.'))
    return [*facts, Fact('Next', *step)] if step else facts


def _begun(delay: Estimate) -> str:
    """Say by how much the accelerometer is late or early, or that it is neither."""
    late, std = float(delay), float(delay.std)
    if abs(late) < HALF * std:
        return f'No delay relative to the wrench, within {size(HALF * std, "s", 2)}'
    where = 'behind' if late > 0.0 else 'ahead of'
    return f'{quantity(abs(late), std, "s")} {where} the wrench'


def _origin(recording: Recording, c: Calibration) -> list[str]:
    lines = origin([recording]) if recording.source else [str(c.source.get('recording', ''))]
    created = str(c.source.get('created', '')).replace('T', ' ').replace('+00:00', ' UTC')
    return [line for line in (*lines, f'calibrated {created}' if created else '') if line]


def forces(recording: Recording, c: Calibration, contact: Stream) -> Shown:
    """Show the force of sensor and observer, and the true one if a simulator states it."""
    wrench, truth = recording.wrench, recording.contact_truth
    assert wrench is not None
    panels = tuple(Panel(f'force {axis}', 'N', (
        Line('sensor, bias removed', 'simulated', wrench.t,
             wrench.values[:, i] - c.wrench_bias.value[i]),
        Line('contact force', 'explained', contact.t, contact.values[:, i]),
        *(() if truth is None else (
            Line('true contact force', 'other', truth.t, truth.values[:, i]),))))
        for i, axis in enumerate('xyz'))
    return Shown(panels, recording.phases, float(wrench.t[0]), float(wrench.t[-1]))


def _pictures(recording: Recording, calibration: Calibration, contact: Stream | None
              ) -> Iterator[Picture]:
    for title, words, figure in (
            ('Poses', 'The weight of the tool in each orientation, and the residuals.',
             figures.pose_means(recording, calibration)),
            ('Step', 'The inertial force of the step motion, measured and by the accelerometer.',
             figures.step_fit(recording, calibration)),
            ('Accelerometer', 'The slope is the gain; the delay between the sensors is removed.',
             figures.accelerometer_regression(recording, calibration)),
            ('Spectra', 'How the observer filters the noise of sensor and accelerometer.',
             figures.spectra(recording, calibration, contact)),
            ('Noise against response', (
                'Noise of the contact force at a steady contact, over the rise time of the '
                'filter.'), figures.noise_against_rise(calibration))):
        if figure is not None:
            yield picture(title, words, figure)


def in_words(quality: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """
    Yield each figure as a title and a sentence.

    Parameters
    ----------
    quality : mapping
        Of ``calibration.yaml``; what it does not hold is left out.
    """
    if quality.get('method') == 'motion':
        force, torque = (float(quality['residual_rms'][i]) for i in (0, 3))
        yield 'Residual in motion', (
            f'{size(force, "N", 2)} and {size(torque, "N m", 2)} RMS of an axis between the '
            'wrench below 4 Hz and one rigid tool, without contact.')
    elif 'residual_rms' in quality:
        yield 'Residual at rest', (
            f'{sizes(quality["residual_rms"][:3], "N")} and '
            f'{sizes(quality["residual_rms"][3:], "N m")} RMS (x, y, z) between the poses and one '
            'rigid tool.')
    if 'condition' in quality:
        count, condition = len(quality.get('poses') or ()), float(quality['condition'])
        poses = f'{count or "The"} poses'
        yield 'Poses', (
            f'{poses} do not separate mass, centre of mass and bias alone; the motion between '
            'them does.' if condition > Thresholds().condition else
            f'{poses} separate mass, centre of mass and bias with condition '
            f'{rounded(condition)} (1 is best).')
    if 'chi_square' in quality:
        yield 'Fit of the poses', _fit(quality['chi_square'])
    if quality.get('rejection', {}).get('poses'):
        yield 'Rejection test', _rejection(quality['rejection'])
    errors = quality.get('errors', {})
    if 'force_eq26' in errors:
        yield 'Expected error', (
            f'{size(abs(float(errors["force_eq26"])), "N", 2)} of contact force at 10 m/s^2, and '
            f'{size(abs(float(errors["acceleration_eq27"])), "m/s^2", 2)} of acceleration, by '
            'uncertain parameters; noise is additional.')
    for key, what in (('pose_delay', 'pose'), ('optidrive_delay', 'displacement')):
        if key in quality:
            late = float(quality[key])
            yield f'Delay of the {what}', (f'{size(abs(late), "s", 2)} '
                                           f'{"behind" if late > 0.0 else "ahead of"} the wrench.')
    if quality.get('removed_samples'):
        yield 'Samples left out', str(quality['removed_samples'])
    yield from (('Note', _sentence(note)) for note in quality.get('notes', ()))
    yield from (('Question', _sentence(one)) for one in quality.get('questions', ()))


def _fit(chi_square: Mapping[str, Any]) -> str:
    p = float(chi_square['probability'])
    if not np.isfinite(p):
        return 'Not tested: the noise at rest is not known.'
    # probability of a chi-square below which its fit is called a poor one, as warnings do
    fits = 'do not fit one rigid tool' if p < 0.01 else 'fit one rigid tool'
    return (f'They {fits}: chi-square {rounded(float(chi_square["value"]))} for '
            f'{chi_square["degrees"]:g} degrees of freedom (probability {rounded(p, 2)}).')


def _rejection(test: Mapping[str, Any]) -> str:
    limit = rounded(float(test['threshold']), 2)
    if test['pose'] is None:
        return f'No pose differs from the others beyond chance (limit {limit} for all poses).'
    one = test['poses'][int(test['pose']) - 1]
    force, torque = sizes(one['off'][:3], 'N'), sizes(one['off'][3:], 'N m')
    return (f'Pose {test["pose"]} would be rejected: it differs by {force} and {torque} '
            f'(x, y, z), and by {size(float(one["mass_eq23"]), "kg", 2)} of mass by Eq. 23 '
            f'(probability {rounded(float(one["probability"]), 2)}, limit {limit} for all '
            'poses). Measure it again.')


def _sentence(words: str) -> str:
    return f'{words[:1].upper()}{words[1:]}.'
