"""The pictures of a diagnosis: where the gap is, signals over each other, spectra."""

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.pipeline import Outcome
from matplotlib.figure import Figure
import numpy as np
from scipy import signal

BEFORE, AFTER, NOISE = '#D55E00', '#0072B2', '#555555'


def heat_map(outcome: Outcome) -> Figure | None:
    """Draw the excess of every channel and phase, in noise RMS."""
    places = outcome.diagnosis.where
    if not places:
        return None
    channels = [c.name for c in CHANNELS if any(w.channel == c.name for w in places)]
    phases = list(dict.fromkeys(w.phase for w in places))
    table = np.full((len(channels), len(phases)), np.nan)
    for w in places:
        table[channels.index(w.channel), phases.index(w.phase)] = w.excess
    figure = Figure(figsize=(8.0, 1.2 + 0.28 * len(channels)), layout='constrained')
    axes = figure.subplots()
    image = axes.imshow(table, aspect='auto', cmap='viridis')
    axes.set_xticks(range(len(phases)), phases)
    axes.set_yticks(range(len(channels)), channels)
    figure.colorbar(image, label='excess [noise RMS]')
    return figure


def _strongest(outcome: Outcome, count: int) -> list[int]:
    """Name the channels where most has changed or, where nothing has, the first ones."""
    index = {c.name: i for i, c in enumerate(CHANNELS)}
    listed = list(dict.fromkeys(index[w.channel] for w in outcome.diagnosis.where))
    assert outcome.noise is not None
    listed += [i for i in range(len(CHANNELS)) if outcome.noise[i] > 0.0 and i not in listed]
    return listed[:count]


def overlays(outcome: Outcome) -> Figure | None:
    """Draw the residual of the strongest channels before and after, over time."""
    if not outcome.cases or outcome.noise is None:
        return None
    case, before, after = outcome.cases[-1], outcome.recalibrated[-1], outcome.explained[-1]
    chosen = _strongest(outcome, 3)
    figure = Figure(figsize=(8.0, 2.0 * len(chosen)), layout='constrained')
    axes = np.atleast_1d(figure.subplots(len(chosen), 1, sharex=True))
    for ax, c in zip(axes, chosen):
        ax.plot(case.times, before[:, c], color=BEFORE, linewidth=0.6, label='recalibrated')
        ax.plot(case.times, after[:, c], color=AFTER, linewidth=0.6, label='explained')
        ax.set_ylabel(f'{CHANNELS[c].name} [{CHANNELS[c].unit}]')
    axes[0].set_title('measured less simulated')
    axes[0].legend(fontsize=7, ncols=2)
    axes[-1].set_xlabel('time [s]')
    return figure


def spectra(outcome: Outcome) -> Figure | None:
    """Draw the residual's spectra before and after against those at rest."""
    if not outcome.cases or outcome.noise is None:
        return None
    case, before, after = outcome.cases[-1], outcome.recalibrated[-1], outcome.explained[-1]
    chosen = _strongest(outcome, 3)
    figure = Figure(figsize=(8.0, 2.6), layout='constrained')
    axes = np.atleast_1d(figure.subplots(1, len(chosen)))
    rest = case.groups == 0
    for ax, c in zip(axes, chosen):
        for rows, color, label in ((before[:, c], BEFORE, 'recalibrated'),
                                   (after[:, c], AFTER, 'explained'),
                                   (after[rest, c], NOISE, 'at rest')):
            if len(rows) > 256:
                f, power = signal.welch(rows, 250.0, nperseg=256)
                ax.loglog(f[1:], power[1:], color=color, linewidth=1.0, label=label)
        ax.set(title=CHANNELS[c].name, xlabel='frequency [Hz]')
    axes[0].set_ylabel('power density')
    axes[0].legend(fontsize=7)
    return figure
