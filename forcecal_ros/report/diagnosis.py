"""The report of a diagnosis as one HTML page, and its pictures."""

from collections.abc import Iterator

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import beside, rounded, with_error
from forcecal_ros.diagnose.dataset import CHANNELS, STAGES
from forcecal_ros.diagnose.judge.named_effects import AT_BOUND, instants, Parameter
from forcecal_ros.diagnose.localise import BANDS, BLOCK_RATE
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.verdict import percent
from forcecal_ros.report.diagnosis_view import FAINT, SEEN, View
from forcecal_ros.report.diagnosis_words import explained, facts, headline, NAMED
from forcecal_ros.report.effect_words import phrase
from forcecal_ros.report.page import Picture, picture, render_page
from forcecal_ros.report.panels import COLOURS, Line, Panel, Shown
from forcecal_ros.report.words import Step
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from scipy import signal

TONES = {'no_gap': 'good', 'identified': 'known', 'ambiguous': 'doubt', 'partial': 'doubt',
         'unknown': 'bad', 'not_excited': 'plain', 'invalid_data': 'bad'}
"""Colour of each verdict."""

CAPTIONS = {
    'Where it shows most': 'The channel and the phase that the verdict names; below, its '
                           'residual: measured - simulated.',
    'Where else': 'How far measured and simulated are apart beyond the noise at rest, by stage '
                  'and channel, phase and octave. Grey: no farther than noise.',
    'Signals': 'Simulated: after what differs from robot to robot was re-estimated within its '
               'tolerances.',
    'Residuals': 'The same channels, measured - simulated.',
    'Spectra': 'Power of the residuals in motion, beside the noise at rest.',
}


WITH_EFFECTS = {'Signals': ' Explained: with the effects added.',
                'Residuals': ' Explained: with the effects added.'}
"""What follows where effects are named."""


def render(view: View, origin: list[str], step: Step) -> str:
    """
    Return a diagnosis as a page: its answer first, then where, how far, which and what next.

    Parameters
    ----------
    origin : list of str
        What was diagnosed, and what it was compared with, a line each.
    step : Step
        What to do next.

    Returns
    -------
    str
        HTML, one file without network; everything is escaped.
    """
    d = view.diagnosis
    named = d.verdict in NAMED
    arms = ('nominal', 'simulated', *(('explained',) if named else ()), 'noise')
    kept = [0, 1, *((2,) if named else ()), 3]
    return render_page(
        'diagnosis.html.j2', 'Sim-to-real gap', origin=origin, verdict=d.verdict.replace('_', ' '),
        tone=TONES[d.verdict], headline=headline(d), facts=facts(view, step), notes=d.notes,
        share=explained(d), effects=_numbers(d),
        gap=None if d.gap is None else {
            'nominal': rounded(d.gap.nominal), 'recalibrated': rounded(d.gap.recalibrated),
            'explained': rounded(d.gap.explained) if named else ''},
        advice=view.advice if d.verdict != 'invalid_data' else '',
        candidates=[(name, percent(p), phrase(name), 100.0 * p) for name, p in d.candidates
                    ] if d.verdict != 'not_excited' else [],
        head=('channel', 'unit', *arms),
        channels=[_row(name, [rms[k] for k in kept], view.units[name])
                  for name, rms in (d.gap.channels.items() if d.gap else ())],
        closest=list(_pictures(view, first=True)), figures=list(_pictures(view, first=False)))


def _row(channel: str, values: list[float], unit: str) -> list[str]:
    shown, cells = beside(values, unit)
    return [channel, shown, *cells]


def _pictures(view: View, *, first: bool) -> Iterator[Picture]:
    if not len(view.times):
        return
    shown: dict[str, Figure | Shown | None] = {
        'Where it shows most': closest(view)} if first else {
        'Where else': heat_map(view), 'Signals': signals(view),
        'Residuals': residuals(view), 'Spectra': spectra(view)}
    for title, what in shown.items():
        if what is not None:
            more = WITH_EFFECTS.get(title, '') if named(view) else ''
            yield picture(title, CAPTIONS[title] + more, what)


def _with_error(p: Parameter) -> tuple[str, str]:
    """Write a number and its standard error, or that it stands at its bound."""
    return (with_error(p.value, 0.0)[0], AT_BOUND) if p.at_bound else with_error(p.value, p.std)


def _numbers(d: Diagnosis) -> list[tuple[str, str, str, str, str]]:
    """Return every number that was found, in SI units, as a rig file wants them."""
    out = [(e.name, name, *_with_error(p), '' if p.unit == '1' else p.unit)
           for e in d.effects for name, p in e.parameters.items()
           if p.value or p.std or p.at_bound]
    return out + [(e.name, word, f'{at:.3f}', f'{low:.3f} to {high:.3f} (95 %)', 's')
                  for e in d.effects for word, at, (low, high) in instants(e)]


SHOWN = 4
"""Number of channels that are drawn."""

AROUND = 0.25
"""Part of the plainest phase that is shown before and after it."""


def heat_map(view: View) -> Figure | None:
    """Draw the excess of every channel, phase and octave over the noise, by stage."""
    found = [c for c in view.cells if c.z > SEEN and c.excess > FAINT]
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
    image = axes.imshow(table, aspect='auto', cmap='viridis_r', interpolation='none',
                        norm=LogNorm(FAINT, max(1.0, float(np.nanmax(table)))))
    for i in range(1, len(phases)):
        axes.axvline(i * len(bands) - 0.5, color='white', linewidth=2)
    axes.set_xticks([(i + 0.5) * len(bands) - 0.5 for i in range(len(phases))], phases)
    axes.set_yticks(range(len(rows)), [f'{CHANNELS[i].stage}  {CHANNELS[i].name}' for i in rows],
                    fontsize=8)
    axes.set_xlabel(f'phase; within each, octaves from below {bands[0][1]:g} Hz to '
                    f'{bands[-1][1]:g} Hz')
    figure.colorbar(image, label='excess [noise RMS]')
    return figure


def closest(view: View) -> Shown | None:
    """Show the channel and the time that the verdict speaks of; None where all is noise."""
    span, place, part = view.span(), view.focus(), view.closer()
    if span is None or place is None:
        return None
    margin = AROUND * (span.end - span.start)
    start, end = span.start - margin, span.end + margin
    for at in begun(view):
        start, end = min(start, at - margin), max(end, at + margin)
    return Shown((_signals(view, place.channel), _residuals(view, place.channel)), view.phases,
                 max(start, float(view.times[0])), min(end, float(view.times[-1])), begun(view),
                 None if begun(view) or part is None else (part.start, part.end))


def signals(view: View) -> Shown:
    """Show measured, simulated and explained signals over each other."""
    return _whole(view, tuple(_signals(view, c) for c in view.channels(SHOWN)))


def residuals(view: View) -> Shown:
    """Show measured - simulated, before and after the effects."""
    return _whole(view, tuple(_residuals(view, c) for c in view.channels(SHOWN)))


def begun(view: View) -> tuple[float, ...]:
    """Return the instants at which effects began."""
    return tuple(at for e in view.diagnosis.effects for _, at, _ in instants(e))


def _whole(view: View, panels: tuple[Panel, ...]) -> Shown:
    return Shown(panels, view.phases, float(view.times[0]), float(view.times[-1]), begun(view))


def _signals(view: View, channel: int) -> Panel:
    measured = view.measured[:, channel]
    return _panel(view, channel, (
        ('measured', 'measured', measured, False),
        ('simulated', 'simulated', measured - view.recalibrated[:, channel], False),
        ('nominal', 'other', measured - view.nominal[:, channel], True),
        ('explained', 'explained', measured - view.explained[:, channel], False)))


def _residuals(view: View, channel: int) -> Panel:
    there = view.present[:, channel]
    title = f'Δ {CHANNELS[channel].name}'
    return _panel(view, channel, tuple(
        (name, role, np.where(there, values[:, channel], np.nan), False)
        for name, role, values in (('measured - simulated', 'simulated', view.recalibrated),
                                   ('measured - explained', 'explained', view.explained))), title)


def _panel(view: View, channel: int, lines: tuple[tuple[str, str, Array, bool], ...],
           title: str = '') -> Panel:
    """Leave out what is explained where no effect is named."""
    name, there = CHANNELS[channel].name, view.present[:, channel]
    # of what is recorded more seldom than in every other block no two points are neighbours
    rows = there if there.mean() < 0.5 else np.ones(len(there), dtype=bool)
    return Panel(title or name, view.units[name], tuple(
        Line(called, role, view.times[rows], values[rows], hidden)
        for called, role, values, hidden in lines
        if role != 'explained' or named(view)))


def named(view: View) -> bool:
    """Tell whether effects change what is simulated."""
    return not np.array_equal(view.explained, view.recalibrated)


def spectra(view: View) -> Figure | None:
    """Draw the residual's spectra before and after, and at standstill; None: of no channel."""
    chosen = view.channels(SHOWN)
    if not len(chosen):
        return None
    figure = Figure(figsize=(10.0, 3.0), layout='constrained')
    axes = np.atleast_1d(figure.subplots(1, len(chosen)))
    for ax, c in zip(axes, chosen):
        there = view.present[:, c]
        moving = there & (view.groups > 0)
        for rows, role, label in (
                (view.recalibrated[moving, c], 'simulated', 'measured - simulated'),
                (view.explained[moving, c], 'explained', 'measured - explained'),
                (view.explained[there & (view.groups == 0), c], 'other', 'at rest')):
            if len(rows) > 64 and (role != 'explained' or named(view)):
                _spectrum(ax, rows, COLOURS[role], label, _rate(there))
        name = CHANNELS[c].name
        ax.set(xlabel='frequency [Hz]')
        ax.set_title(f'{name} [{_squared(view.units[name])}/Hz]', fontsize=9)
    axes[0].set_ylabel('power density')
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside upper left', ncols=3,
                  frameon=False, fontsize=9)
    return figure


def _squared(unit: str) -> str:
    return f'({unit})²' if ' ' in unit or '/' in unit else f'{unit}²'


def _rate(there: NDArray[np.bool_]) -> float:
    """Rate of the blocks that hold samples [Hz]."""
    steps = np.diff(np.flatnonzero(there))
    return BLOCK_RATE / max(1.0, float(np.median(steps))) if len(steps) else BLOCK_RATE


def _spectrum(axes: Axes, rows: Array, color: str, label: str, rate: float) -> None:
    f, power = signal.welch(rows, rate, nperseg=min(256, len(rows)))
    axes.loglog(f[1:], power[1:], color=color, linewidth=1.0, label=label)
