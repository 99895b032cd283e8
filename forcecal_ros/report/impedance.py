"""The contact experiment as tables for a terminal, pictures, and one HTML page."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.report import impedance_figures as drawn
from forcecal_ros.report.page import picture, png, render_page
from forcecal_ros.report.text import aligned
from forcecal_ros.report.words import Fact
from forcecal_ros.reproduce.assess import Figures
from forcecal_ros.reproduce.experiment import Experiment
from forcecal_ros.reproduce.printed_gains import continuous, error_poles, PRINTED
from matplotlib.figure import Figure

HEAD = ['force fed back', 'phantom RMS [N]', 'peak [N]', 'strayed [mm]', 'peak at contact [N]',
        'bounces', 'settling [s]', 'force error [N]', 'contact force [N]']
FEEDBACKS = {
    'true': 'true force', 'raw': '(a) raw sensor', 'static': '(b) gravity-compensated sensor',
    'printed': '(c) newton, K of the paper', 'newton': '(c) newton, K of ours',
    'kalman': '(d) kalman'}
PAPER = {'acc1': 'Accelerometer 1', 'acc2': 'Accelerometer 2'}


RUNAWAY = 1e6
"""A force beyond this is of a loop that has run away, whatever its number [N]: no arm bears it."""


class Table(NamedTuple):
    """One table with what has to be said below it."""

    title: str
    head: list[str]
    rows: list[list[str]]
    notes: list[str]


NEXT = Fact('Next', 'Identify how your own robot follows commands, for a law that fits it:',
            'forcecal identify-robot shaken_bag -o plant.yaml')


def tables(experiment: Experiment) -> Iterator[Table]:
    """Yield every table."""
    for name in experiment.calibrations:
        rows = [[FEEDBACKS[row.feedback], *_cells(row.figures)]
                for row in experiment.rows if row.accelerometer == name]
        yield Table(f'{PAPER[name]}: force fed back along x', HEAD, rows,
                    list(experiment.notes[name]))
    yield _gains(experiment)


def conclusions(experiment: Experiment) -> Iterator[tuple[str, str]]:
    """Yield each accelerometer and a sentence on what its observer is worth."""
    for name in experiment.calibrations:
        found = {row.feedback: row.figures for row in experiment.rows
                 if row.accelerometer == name}
        if 'kalman' in found and 'raw' in found:
            yield PAPER[name], f'{_with("kalman", found)} {_with("raw", found)}'


def _with(feedback: str, found: Mapping[str, Figures]) -> str:
    f = found[feedback]
    by = {'kalman': 'With the observer’s force fed back', 'raw': 'With the raw sensor’s'}[feedback]
    if not f.phantom_peak < RUNAWAY:
        return f'{by}, the loop runs away before it touches anything.'
    settles = (f'settles in {f.settling:.2f} s' if f.settling == f.settling else 'never settles')
    return (f'{by}, free motion feels like {f.phantom_rms:.2g} N of contact (RMS), and contact '
            f'{settles}, {f.force_error:.2g} N off.')


def text(experiment: Experiment) -> str:
    """Return conclusions and tables for a terminal."""
    parts = [*(f'{name}: {said}' for name, said in conclusions(experiment)), '']
    for title, head, rows, notes in tables(experiment):
        parts += [title, *('  ' + line for line in aligned([head, *rows])), *notes, '']
    return '\n'.join(parts)


def pictures(experiment: Experiment) -> dict[str, bytes]:
    """Return Figures 5 to 8 as PNG, by file name."""
    first, *_, last = experiment.calibrations if len(experiment.calibrations) > 1 else (
        *experiment.calibrations, *experiment.calibrations)
    one, other = (drawn.plotted(experiment.runs[name, 'kalman'], experiment.calibrations[name])
                  for name in (first, last))
    swing = drawn.plotted(experiment.oscillations[last], experiment.calibrations[last])
    figures: dict[str, Figure] = {
        f'figure_5_{first}': drawn.sensor_and_observer(one),
        f'figure_6_{first}': drawn.power_spectra(one),
        f'figure_7_{last}': drawn.four_panels(other),
        f'figure_8_{last}': drawn.oscillation(swing)}
    return {f'{name}.png': png(figure, dpi=130) for name, figure in figures.items()}


GAIN_NOTES = [
    ('Comparable: the poles of the error (A - K C), once the paper’s gain is divided by its '
     'period. It prints none; at 4 ms, its robot’s, k11 and k21 are to the last digit those of '
     'critically damped double poles at 5.0 and 7.5 rad/s. k23 = 1 on both sides, by Newton’s '
     'law.'),
    ('Not comparable: the single numbers. They follow from the covariances Q and R of each rig’s '
     'sensors, which the paper does not print. Ours is faster because the simulated pose is '
     'precise: 20 µm.'),
]

WORDS = {
    '5': ('Figure 5: sensor and observer',
          ('Free movement, contact transition, constrained movement. The sensor shows the tool’s '
           'inertia as force; the observer shows contact alone.')),
    '6': ('Figure 6: spectra of u - m a and of the observer',
          ('The gain of newton has k23 = 1, which passes the noise of u - m a; the Kalman '
           'observer cuts it off.')),
    '7': ('Figure 7: sensor, observer, acceleration, compensation',
          'The compensation is the inertial force that the observer takes off the sensor’s.'),
    '8': ('Figure 8: an oscillation in free space',
          'The same axis on both sides: a controller would take the residual for contact.'),
}


def render(experiment: Experiment, images: Mapping[str, bytes], origin: str) -> str:
    """
    Return the report as HTML, one file without network.

    Parameters
    ----------
    images : mapping of str to bytes
        Of :func:`pictures`.
    origin : str
        What it was made from.
    """
    figures = []
    for name, image in images.items():
        _, number, accelerometer = name.removesuffix('.png').split('_')
        title, words = WORDS[number]
        figures.append(picture(f'{title} ({PAPER[accelerometer]})', words, image))
    return render_page('impedance.html.j2', 'Contact experiment', origin=origin,
                       headlines=list(conclusions(experiment)), steps=[NEXT],
                       tables=list(tables(experiment)), figures=figures)


def _cells(f: Figures) -> list[str]:
    if not f.phantom_peak < RUNAWAY:
        return ['runs away', *'-------']
    settling = f'{f.settling:.2f}' if f.settling == f.settling else 'never'
    return [f'{f.phantom_rms:.3f}', f'{f.phantom_peak:.2f}', f'{1e3 * f.strayed:.2f}',
            f'{f.peak:.1f}', str(f.bounces), settling, f'{f.force_error:.2f}',
            f'{f.contact_force:.1f}']


def _gains(experiment: Experiment) -> Table:
    """Set our K beside the paper's."""
    head = ['gain', 'k11', 'k12', 'k13', 'k21', 'k22', 'k23', 'error poles [rad/s]', 'damping']
    rows = []
    for name, calibration in experiment.calibrations.items():
        printed = PRINTED[name]
        rows.append([f'{PAPER[name]}: paper, as printed', *_numbers(printed), '', ''])
        rows.append(_gain_row(f'{PAPER[name]}: paper, per second', continuous(printed)))
        if calibration.observer is not None:
            rows.append(_gain_row(f'{PAPER[name]}: ours, per second',
                                  calibration.observer.K.value))
    return Table('Observer gain K beside [Gamez2005] Eq. 32 and 33', head, rows, GAIN_NOTES)


def _gain_row(name: str, K: Array) -> list[str]:
    poles = error_poles(K)
    return [name, *_numbers(K), f'{poles.frequency:.3g}', f'{poles.damping:.2f}']


def _numbers(K: Array) -> list[str]:
    return [f'{k:.4g}' for k in K.ravel()]
