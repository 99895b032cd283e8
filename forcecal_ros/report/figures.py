"""The pictures of a calibration report, each a function of a recording and its calibration."""

from typing import Any

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.observe.design import noise_of_force, rise_time
from forcecal_ros.observe.settings import BANDWIDTH_LIMITS
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from scipy import signal

MEASURED, ESTIMATED, TRUE = '#0072B2', '#D55E00', '#555555'


def gravity_in_sensor(pose: PoseStream, t: Array, gravity: float) -> Array:
    """Return gravity in ft_sensor at the pose samples nearest to ``t``, shape (n, 3) [m/s^2]."""
    nearest = np.clip(np.searchsorted(pose.t, t), 0, len(pose) - 1)
    return -gravity * pose.R_base_sensor[nearest][:, 2, :]


def specific_force(recording: Recording, calibration: Calibration) -> Stream | None:
    """Return calibrated specific force in ft_sensor, its delay removed [m/s^2]."""
    raw, sensor = recording.accelerometer, calibration.accelerometer
    if raw is None or sensor is None:
        return None
    f = np.linalg.solve(sensor.matrix, (raw.values - sensor.offset.value).T).T
    return Stream(raw.t - float(sensor.delay), f, raw.frame)


def step_phase(recording: Recording) -> Phase | None:
    """Return the step motion of the sequence with the ringing that follows it."""
    return next((phase for phase in recording.phases if phase.name == 'step'), None)


def pose_means(recording: Recording, calibration: Calibration) -> Figure | None:
    """Draw the mean wrench of every pose against what the calibration predicts there."""
    wrench, pose = recording.wrench, recording.pose
    spans = [p for p in recording.phases if p.name == 'measure']
    if wrench is None or pose is None or not spans:
        return None
    means, predicted = [], []
    for span in spans:
        part = wrench.between(span.start, span.end)
        if len(part):
            middle = np.array([(span.start + span.end) / 2])
            means.append(part.values[:, :3].mean(axis=0))
            predicted.append(float(calibration.mass) * gravity_in_sensor(
                pose, middle, calibration.gravity)[0] + calibration.wrench_bias.value[:3])
    figure, (left, right) = axes_grid(1, 2, height=3.0)
    x = np.arange(1, len(means) + 1)
    residual = np.array(means) - np.array(predicted)
    for axis, mark in enumerate('os^'):
        left.plot(x, np.array(means)[:, axis], mark, label=f'measured {"xyz"[axis]}')
        right.plot(x, residual[:, axis], mark, label='xyz'[axis])
    left.plot(x, np.array(predicted), '_', color=TRUE, markersize=14,
              label=['predicted', None, None])
    left.set(xlabel='pose', ylabel='force [N]')
    right.set(xlabel='pose', ylabel='force [N]')
    right.axhline(0, color=TRUE, linewidth=0.8)
    for axes, title in ((left, 'Mean force at rest'), (right, 'Measured less predicted')):
        axes.set_xticks(x)
        headed(axes, title, 2)
    return figure


def step_fit(recording: Recording, calibration: Calibration) -> Figure | None:
    """Draw the step: sensor force along x, mass times acceleration, and the residual."""
    force, f, span = recording.wrench, specific_force(recording, calibration), \
        step_phase(recording)
    if force is None or f is None or span is None:
        return None
    part = force.between(span.start, span.end)
    if len(part) < 2:
        return None
    measured = part.values[:, 0] - calibration.wrench_bias.value[0]
    predicted = -float(calibration.mass) * f.at(part.t)[:, 0]
    offset = (measured - predicted).mean()
    figure, (top, bottom) = axes_grid(2, 1, height=4.2, sharex=True)
    t = part.t - span.start
    top.plot(t, measured, color=MEASURED, linewidth=1, label='sensor, bias removed')
    top.plot(t, predicted + offset, color=ESTIMATED, linewidth=1, label='mass x acceleration')
    top.set(ylabel='force [N]')
    headed(top, 'Step along x')
    bottom.plot(t, measured - predicted - offset, color=TRUE, linewidth=0.7)
    bottom.set(xlabel='time since the step [s]', ylabel='residual [N]')
    return figure


def accelerometer_regression(recording: Recording, calibration: Calibration) -> Figure | None:
    """Draw voltage against specific force from the wrench, [Gamez2005] Eq. 17 as a picture."""
    wrench, raw, sensor = recording.wrench, recording.accelerometer, calibration.accelerometer
    if wrench is None or raw is None or sensor is None or step_phase(recording) is None:
        return None
    span = step_phase(recording)
    assert span is not None
    part = raw.between(span.start, span.end)
    if len(part) < 2:
        return None
    axis = int(np.argmax(np.abs(sensor.map.value[:, 0])))
    f = -(wrench.at(part.t - float(sensor.delay))[:, 0]
          - calibration.wrench_bias.value[0]) / float(calibration.mass)
    figure, (axes,) = axes_grid(1, 1, height=3.4)
    axes.plot(f, part.values[:, axis], '.', markersize=2, color=MEASURED, label='samples')
    line = np.array([f.min(), f.max()])
    slope = sensor.matrix[axis, 0]
    middle = part.values[:, axis].mean() - slope * f.mean()
    axes.plot(line, middle + slope * line, color=ESTIMATED, label=f'gain {slope:.4f}')
    axes.set(xlabel='specific force from the wrench [m/s²]', ylabel=f'reading [{sensor.unit}]')
    headed(axes, 'Accelerometer against force over mass, during the step')
    return figure


def noise_against_rise(calibration: Calibration) -> Figure | None:
    """Draw the noise of a steady contact force over the rise time, and what was chosen."""
    observer = calibration.observer
    if observer is None or 'bandwidth' not in observer.kalman:
        return None
    chosen = np.array([float(observer.kalman['bandwidth'])])
    limits = [float(observer.kalman[name]) if name in observer.kalman else usual for name, usual
              in zip(('bandwidth_min', 'bandwidth_max'), BANDWIDTH_LIMITS)]
    bandwidths = np.geomspace(min(*limits, *chosen) / 1.5, 1.5 * max(*limits, *chosen), 60)
    noise, marks = (noise_of_force(calibration, one) for one in (bandwidths, chosen))
    if noise is None or marks is None:
        return None
    figure, (axes,) = axes_grid(1, 1, height=3.4)
    for axis, colour in enumerate((MEASURED, ESTIMATED, TRUE)):
        axes.loglog(1e3 * rise_time(bandwidths), noise[:, axis], color=colour, linewidth=1,
                    label='xyz'[axis])
        axes.plot(1e3 * rise_time(chosen), marks[:, axis], 'o', color=colour)
    for limit in limits:
        axes.axvline(1e3 * rise_time(limit), color=TRUE, linestyle=':', linewidth=0.8)
    axes.set(xlabel='10-90 % rise [ms]', ylabel='noise of the force [N]')
    headed(axes, 'Filter kalman: noise against response, dotted the limits')
    return figure


def spectra(recording: Recording, calibration: Calibration, contact: Stream) -> Figure | None:
    """Draw the power spectra of u - m a and of the observer, as [Gamez2005] Fig. 6."""
    f = specific_force(recording, calibration)
    span = step_phase(recording)
    if recording.wrench is None or f is None or span is None:
        return None
    wrench = recording.wrench.between(span.start, span.end)
    output = contact.between(span.start, span.end)
    if min(len(wrench), len(output)) < 256:
        return None
    direct = wrench.values[:, 0] + float(calibration.mass) * f.at(wrench.t)[:, 0]
    figure, (axes,) = axes_grid(1, 1, height=3.4)
    for values, rate, colour, label in (
            (direct, wrench.rate, MEASURED, 'u - m a'),
            (output.values[:, 0], output.rate, ESTIMATED, 'observer')):
        frequency, power = signal.welch(values, rate, nperseg=min(512, len(values)))
        axes.semilogy(frequency[1:], power[1:], color=colour, linewidth=1, label=label)
    axes.set(xlabel='frequency [Hz]', ylabel='power [N²/Hz]')
    headed(axes, 'Power spectra during the step')
    return figure


def headed(axes: Axes, title: str, columns: int = 3) -> None:
    """Put title and legend above the curves, one over the other."""
    lines = -(-len(axes.get_legend_handles_labels()[1]) // columns)
    axes.set_title(title, loc='left', fontsize=10, pad=6.0 + 14.0 * lines)
    axes.legend(fontsize=8, ncols=columns, frameon=False, loc='lower left',
                bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)


def axes_grid(rows: int, columns: int, *, height: float, sharex: bool = False,
              sharey: bool = False) -> tuple[Figure, list[Any]]:
    """Return a figure of the reports' width and its axes, row by row."""
    figure = Figure(figsize=(8.0, height), layout='constrained')
    axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey)
    for one in axes.flat:
        one.grid(alpha=0.25)
        one.spines[['top', 'right']].set_visible(False)
    return figure, list(axes.flat)
