"""The pictures of a diagnosis: localisation, signals over each other, spectra."""

from forcecal_ros.diagnose.channels import CHANNELS, STAGES
from forcecal_ros.diagnose.remainder import BANDS, RATE
from forcecal_ros.geometry import Array
from forcecal_ros.report.diagnosis_view import View
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
import numpy as np
from scipy import signal

MEASURED, BEFORE, AFTER, NOISE = '#222222', '#D55E00', '#0072B2', '#999999'

SEEN = 4.0
"""Standard deviations above which a time-frequency bin is coloured."""

SHOWN = 4
"""Number of channels that are drawn."""

MOST_POINTS = 3000
"""Most points of a line; more would not be visible."""


def heat_map(view: View) -> Figure | None:
    """Draw the excess of every channel, phase and octave over the noise, by stage."""
    found = [c for c in view.cells if c.z > SEEN and c.excess > 0.05]
    if not found:
        return None
    there = {c.channel for c in view.cells}
    rows = [i for stage in STAGES for i, c in enumerate(CHANNELS) if c.stage == stage
            and i in there]
    phases = list(dict.fromkeys(p.name for p in view.phases
                                if any(c.phase == p.name for c in view.cells)))
    bands = BANDS[:-1]
    table = np.full((len(rows), len(phases) * len(bands)), np.nan)
    for c in found:
        column = phases.index(c.phase) * len(bands) + bands.index(c.band)
        table[rows.index(c.channel), column] = c.excess
    figure = Figure(figsize=(10.0, 1.4 + 0.27 * len(rows)), layout='constrained')
    axes = figure.subplots()
    axes.set_facecolor('#f2f2f2')
    image = axes.imshow(table, aspect='auto', cmap='viridis', interpolation='none',
                        norm=LogNorm(0.05, max(1.0, float(np.nanmax(table)))))
    for i in range(1, len(phases)):
        axes.axvline(i * len(bands) - 0.5, color='white', linewidth=2)
    axes.set_xticks([(i + 0.5) * len(bands) - 0.5 for i in range(len(phases))], phases)
    axes.set_yticks(range(len(rows)), [f'{CHANNELS[i].stage}  {CHANNELS[i].name}' for i in rows],
                    fontsize=8)
    axes.set_xlabel(f'phase; within each, octaves from below {bands[0][1]:g} Hz to '
                    f'{bands[-1][1]:g} Hz')
    figure.colorbar(image, label='excess [noise RMS]')
    return figure


def overlays(view: View) -> Figure:
    """Draw measured, nominal and explained signals over each other, and the residuals."""
    chosen = view.channels(SHOWN)
    figure = Figure(figsize=(10.0, 2.3 * len(chosen)), layout='constrained')
    grid = np.atleast_2d(figure.subplots(len(chosen), 2, sharex=True))
    thin = max(1, len(view.times) // MOST_POINTS)
    t = view.times[::thin]
    for (left, right), c in zip(grid, chosen):
        name = CHANNELS[c].name
        measured = view.measured[:, c]
        for residual, color, label in ((None, MEASURED, 'measured'),
                                       (view.nominal, BEFORE, 'nominal'),
                                       (view.explained, AFTER, 'explained')):
            line = measured if residual is None else measured - residual[:, c]
            left.plot(t, line[::thin], color=color, linewidth=0.8, label=label)
        for residual, color, label in ((view.recalibrated, BEFORE, 'recalibrated'),
                                       (view.explained, AFTER, 'explained')):
            line = np.where(view.present[:, c], residual[:, c], np.nan)
            right.plot(t, line[::thin], color=color, linewidth=0.5, label=label)
        left.set_ylabel(f'{name} [{view.units[name]}]')
    grid[0, 0].set_title('signals')
    grid[0, 1].set_title('measured less simulated')
    for axes in grid[0]:
        axes.legend(fontsize=7, ncols=3, loc='upper right')
    for axes in grid[-1]:
        axes.set_xlabel('time [s]')
    return figure


def spectra(view: View) -> Figure:
    """Draw the spectra of the residual before and after against those at standstill."""
    chosen = view.channels(SHOWN)
    figure = Figure(figsize=(10.0, 2.8), layout='constrained')
    axes = np.atleast_1d(figure.subplots(1, len(chosen)))
    for ax, c in zip(axes, chosen):
        there = view.present[:, c]
        for rows, color, label in (
                (view.recalibrated[there & (view.groups > 0), c], BEFORE, 'recalibrated'),
                (view.explained[there & (view.groups > 0), c], AFTER, 'explained'),
                (view.explained[there & (view.groups == 0), c], NOISE, 'at standstill')):
            if len(rows) > 64:
                _spectrum(ax, rows, color, label)
        name = CHANNELS[c].name
        ax.set(xlabel='frequency [Hz]')
        ax.set_title(f'{name} [({view.units[name]})²/Hz]', fontsize=9)
    axes[0].set_ylabel('power density')
    axes[0].legend(fontsize=7)
    return figure


def _spectrum(axes: Axes, rows: Array, color: str, label: str) -> None:
    f, power = signal.welch(rows, RATE, nperseg=min(256, len(rows)))
    axes.loglog(f[1:], power[1:], color=color, linewidth=1.0, label=label)
