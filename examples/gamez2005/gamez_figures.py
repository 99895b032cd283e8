"""
The contact experiment as tables for a terminal, and pictures.

Signs are the paper's: u = F + m a is the force of the robot on the tool, F that of the tool on
its environment, both the opposite of the wire's.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Stream
from forcecal_ros.observe import ContactEstimate, ObserverSettings, replay
from forcecal_ros.report.figures import (
    axes_grid,
    ESTIMATED,
    headed,
    MEASURED,
    specific_force,
    TRUE,
)
from forcecal_ros.report.page import png
from forcecal_ros.report.rows import aligned
from gamez_assess import Figures
from gamez_gains import continuous, error_poles, PRINTED
from gamez_loop import ClosedLoopRun
from matplotlib.figure import Figure
from scipy import signal

HEAD = ['force fed back', 'phantom RMS [N]', 'peak [N]', 'strayed [mm]', 'peak at contact [N]',
        'bounces', 'settling [s]', 'force error [N]', 'contact force [N]']
FEEDBACKS = {
    'true': 'true force', 'raw': '(a) raw sensor', 'static': '(b) gravity-compensated sensor',
    'printed': '(c) newton, K of the paper', 'newton': '(c) newton, K of ours',
    'kalman': '(d) kalman'}
PAPER = {'acc1': 'Accelerometer 1', 'acc2': 'Accelerometer 2'}


RUNAWAY = 1e6
"""A force beyond this is of a loop that has run away, whatever its number [N]: no arm bears it."""


class Row(NamedTuple):
    """One line of the table."""

    accelerometer: str
    feedback: str
    figures: Figures


class Experiment(NamedTuple):
    """
    Runs and figures of the experiment.

    Attributes
    ----------
    calibrations : mapping of str to Calibration
        Identified from a simulated sequence, by accelerometer.
    runs : mapping of (str, str) to ClosedLoopRun
        By accelerometer and feedback.
    oscillations : mapping of str to ClosedLoopRun
        In free space with feedback ``kalman``, by accelerometer.
    """

    calibrations: Mapping[str, Calibration]
    runs: Mapping[tuple[str, str], ClosedLoopRun]
    oscillations: Mapping[str, ClosedLoopRun]
    rows: tuple[Row, ...]


class Table(NamedTuple):
    """One table with what has to be said below it."""

    title: str
    head: list[str]
    rows: list[list[str]]
    notes: list[str]


def tables(experiment: Experiment) -> Iterator[Table]:
    """Yield every table."""
    for name in experiment.calibrations:
        rows = [[FEEDBACKS[row.feedback], *_cells(row.figures)]
                for row in experiment.rows if row.accelerometer == name]
        yield Table(f'{PAPER[name]}: force fed back along x', HEAD, rows, [])
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
    one, other = (plotted(experiment.runs[name, 'kalman'], experiment.calibrations[name])
                  for name in (first, last))
    swing = plotted(experiment.oscillations[last], experiment.calibrations[last])
    figures: dict[str, Figure] = {
        f'figure_5_{first}': sensor_and_observer(one),
        f'figure_6_{first}': power_spectra(one),
        f'figure_7_{last}': four_panels(other),
        f'figure_8_{last}': oscillation(swing)}
    return {f'{name}.png': png(figure) for name, figure in figures.items()}


GAIN_NOTES = [
    ('Comparable: the poles of the error (A - K C), once the paper’s gain is divided by its '
     'period. It prints none; at 4 ms, its robot’s, k11 and k21 are to the last digit those of '
     'critically damped double poles at 5.0 and 7.5 rad/s. k23 = 1 on both sides, by Newton’s '
     'law.'),
    ('Not comparable: the single numbers. They follow from the covariances Q and R of each rig’s '
     'sensors, which the paper does not print. Ours is faster because the simulated pose is '
     'precise: 20 µm.'),
]


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


FORCE = (-40.0, 40.0)
"""The paper's axis of forces [N]."""

SEGMENT = 1024
"""Samples a segment of Welch's method."""


class PlottedRun(NamedTuple):
    """
    A run as the figures show it, along x of ft_sensor in the paper's signs.

    Attributes
    ----------
    sensor : Stream
        u, bias removed [N].
    kalman, newton : ContactEstimate
        What each observer makes of the same recording.
    acceleration : Stream
        Of the tool, by the calibrated accelerometer [m/s^2].
    """

    sensor: Stream
    kalman: ContactEstimate
    newton: ContactEstimate
    acceleration: Stream
    run: ClosedLoopRun


def plotted(run: ClosedLoopRun, calibration: Calibration) -> PlottedRun:
    """Run both observers over a run."""
    recording = run.recording
    wrench, acceleration = recording.wrench, specific_force(recording, calibration)
    assert wrench is not None and acceleration is not None
    sensor = float(calibration.wrench_bias.value[0]) - wrench.values[:, :1]
    kalman, newton = (_finished(replay(recording, calibration, ObserverSettings(mode)),
                                acceleration.t[-1]) for mode in ('kalman', 'newton'))
    return PlottedRun(Stream(wrench.t, sensor), kalman, newton, acceleration, run)


def _finished(estimate: ContactEstimate, end: float) -> ContactEstimate:
    """Leave out what was answered only because the recording ends, without acceleration."""
    known = estimate.t <= end - 2e-3
    arrays = {name: getattr(estimate, name)[known] for name in (
        't', 'contact', 'measured', 'innovation', 'inertial', 'status')}
    return replace(estimate, **arrays)


def sensor_and_observer(run: PlottedRun) -> Figure:
    """Draw sensor and observer over the whole run, as Fig. 5."""
    figure, (axes,) = axes_grid(1, 1, height=4.0)
    axes.plot(run.sensor.t, run.sensor.values, color=MEASURED, linewidth=0.7,
              label='Force sensor output')
    axes.plot(run.kalman.t, -run.kalman.contact[:, 0], '-.', color=ESTIMATED, linewidth=1.2,
              label='Observer output')
    axes.set(xlabel='t (s)', ylabel='F (N)', xlim=(0, run.sensor.t[-1]))
    _paper_forces(axes, run)
    headed(axes, 'Sensor and observer')
    return figure


def power_spectra(run: PlottedRun) -> Figure:
    """Draw the spectra of u - m a and of the observer's output, as Fig. 6."""
    figure, (left, right) = axes_grid(1, 2, height=3.4, sharey=True)
    composed, kalman, newton = (-values for values in (
        run.kalman.measured[:, 0], run.kalman.contact[:, 0], run.newton.contact[:, 0]))
    _spectrum(left, composed, run.sensor.rate, MEASURED, 'u - m a')
    _spectrum(right, newton, run.sensor.rate, TRUE, 'observer, newton')
    _spectrum(right, kalman, run.sensor.rate, ESTIMATED, 'observer, kalman')
    left.set(ylabel='power spectral density (N²/Hz)')
    for axes, title in ((left, 'Composed signal u - m a'), (right, 'Observer')):
        axes.set(xlabel='f (Hz)', xlim=(0, run.sensor.rate / 2))
        headed(axes, title)
    return figure


def four_panels(run: PlottedRun) -> Figure:
    """Draw sensor, observer, acceleration and compensation, as Fig. 7."""
    figure, (sensor, observer, acceleration, taken_off) = axes_grid(2, 2, height=5.4, sharex=True)
    _line(sensor, run.sensor.t, run.sensor.values, 'Force sensor')
    _line(observer, run.kalman.t, -run.kalman.contact[:, 0], 'Observer output', ESTIMATED)
    _line(acceleration, run.acceleration.t, run.acceleration.values[:, 0],
          'Acceleration of the tool')
    _line(taken_off, run.kalman.t, -run.kalman.inertial[:, 0], 'Observer compensation',
          ESTIMATED)
    for axes in (sensor, observer, taken_off):
        axes.set(ylabel='F (N)')
        _paper_forces(axes, run)
    acceleration.set(xlabel='t (s)', ylabel='a (m/s²)')
    taken_off.set(xlabel='t (s)', xlim=(0, run.sensor.t[-1]))
    return figure


def oscillation(run: PlottedRun) -> Figure:
    """Draw sensor and observer during an oscillation in free space, as Fig. 8."""
    figure, (left, right) = axes_grid(1, 2, height=3.4, sharey=True)
    _line(left, run.sensor.t, run.sensor.values, 'Force sensor')
    _line(right, run.kalman.t, -run.kalman.contact[:, 0], 'Observer output', ESTIMATED)
    for axes in (left, right):
        axes.set(xlabel='t (s)', xlim=(0, run.sensor.t[-1]))
    left.set(ylabel='F (N)')
    _paper_forces(left, run)
    return figure


def _paper_forces(axes: Any, run: PlottedRun) -> None:
    """Set the paper's axis of forces, wider where something would be cut off."""
    low, high = FORCE
    for values in (run.sensor.values, -run.kalman.contact[:, 0]):
        low, high = min(low, float(values.min()) - 1.0), max(high, float(values.max()) + 1.0)
    axes.set_ylim(low, high)


def _line(axes: Any, t: Array, values: Array, title: str, colour: str = MEASURED) -> None:
    axes.plot(t, values, color=colour, linewidth=0.7)
    axes.set(title=title)


def _spectrum(axes: Any, values: Array, rate: float, colour: str, label: str) -> None:
    frequency, power = signal.welch(values, rate, nperseg=min(SEGMENT, len(values)))
    axes.semilogy(frequency[1:], power[1:], color=colour, linewidth=0.9, label=label)
