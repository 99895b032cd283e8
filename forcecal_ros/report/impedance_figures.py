"""Figures 5 to 8 of [Gamez2005], drawn from the simulated contact experiment.

Signs are the paper's: u = F + m a is the force of the robot on the tool, F that of the tool on
its environment, both the opposite of the wire's.
"""

from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.geometry import Array
from forcecal_ros.observe import ContactEstimate, ObserverSettings, replay
from forcecal_ros.recording.streams import Stream
from forcecal_ros.report.figures import (
    axes_grid,
    ESTIMATED,
    headed,
    MEASURED,
    specific_force,
    TRUE,
)
from forcecal_ros.reproduce.closed_loop import ClosedLoopRun
from matplotlib.figure import Figure
from scipy import signal

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
