"""The pictures of a calibration report, each a function of a recording and its calibration."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import size
from forcecal_ros.core.streams import Phase, Recording, Stream, TOUCHING
from forcecal_ros.observe.design import noise_of_force, rise_time
from forcecal_ros.observe.settings import BANDWIDTH_LIMITS
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, NullLocator
import numpy as np
from scipy import signal

COLOURS = {'measured': '#222222', 'simulated': '#D55E00', 'explained': '#0072B2',
           'other': '#777777'}
"""Of a line, by its role, on white; the page has others for dark screens."""

TINTS = {'exciting': '#0072B2', 'touching': '#E69F00', 'moving': '#777777'}
"""Of a phase, by its kind; at standstill there is none."""

TINT_NAMES = {'moving': 'grey', 'exciting': 'blue', 'touching': 'orange'}

EXCITING, STANDING = ('step', 'sweep', 'reverse'), ('measure', 'settle', 'idle', 'done')

WIDER = {'measured': 2.4}
"""How much wider than others a line is, so that it shows beside what covers it."""

DASHED = 'other'
"""Role of lines that let what they cover show."""

MOST_POINTS = 2400
"""Most points of a line: more than two for each dot across a page."""

LETTER_FRACTION = 0.0072
"""Width of a letter of a phase's name, of that of the axes: a name is shown where it has room.
In a figure it is twice as much."""

FIGURE_WIDTH = 5.0
"""Of a figure [in]: its print can be read on a phone, and two fill a page."""


class Line(NamedTuple):
    """One line: what it is called, its role, times [s] and values."""

    name: str
    role: str
    t: Array
    values: Array
    hidden: bool = False


class Panel(NamedTuple):
    """Lines over each other."""

    title: str
    unit: str
    lines: tuple[Line, ...]


class Shown(NamedTuple):
    """
    What is shown over one time axis.

    Attributes
    ----------
    panels : tuple of Panel
    phases : tuple of Phase
    start, end : float
        Of what is there [s].
    instants : tuple of float
        That are marked [s].
    closer : tuple of (float, float)
        Begin and end of what is seen before anybody zooms out [s]; by default all of it.
    """

    panels: tuple[Panel, ...]
    phases: tuple[Phase, ...]
    start: float
    end: float
    instants: tuple[float, ...] = ()
    closer: tuple[float, float] | None = None

    @property
    def visible(self) -> tuple[float, float]:
        """Begin and end of what is seen first [s]."""
        return self.closer or (self.start, self.end)


def joined(phases: Iterable[Phase]) -> tuple[Phase, ...]:
    """Join phases of one name that follow each other: a sweep is a hundred moves."""
    out: list[Phase] = []
    for phase in phases:
        if out and out[-1].name == phase.name and phase.start - out[-1].end < 1e-6:
            out[-1] = replace(out[-1], end=phase.end)
        else:
            out.append(phase)
    return tuple(out)


def kind(phase: str) -> str:
    """Say which tint a phase has; empty: none."""
    if phase in STANDING:
        return ''
    return 'exciting' if phase in EXCITING else 'touching' if phase in TOUCHING else 'moving'


def between(line: Line, start: float, end: float) -> Line:
    """Cut a line to a time, thinned so that no peak is lost."""
    i, j = np.searchsorted(line.t, [start, end])
    t, values = thinned(line.t[i:j], line.values[i:j])
    return line._replace(t=t, values=values)


def thinned(t: Array, values: Array) -> tuple[Array, Array]:
    """Keep the smallest and the largest value of each of ``most / 2`` stretches."""
    width = -(-2 * len(t) // MOST_POINTS)
    if width <= 2:
        return t, values
    n = len(t) - len(t) % width
    stretches = values[:n].reshape(-1, width)
    first = np.arange(0, n, width)
    lowest = np.where(np.isnan(stretches), np.inf, stretches).argmin(axis=1)
    highest = np.where(np.isnan(stretches), -np.inf, stretches).argmax(axis=1)
    index = np.unique([*(first + lowest), *(first + highest), *range(n, len(t))])
    return t[index], values[index]


def drawn(shown: Shown) -> Figure:
    """Draw a picture, the legend above the panels."""
    n = len(shown.panels)
    shown = shown._replace(start=shown.visible[0], end=shown.visible[1])
    names = {line.name for panel in shown.panels for line in panel.lines if not line.hidden}
    legend = 0.2 * ((len(names) + 1) // 2)  # two names a line [in]
    height, width = 0.8 + legend + 1.5 * n, FIGURE_WIDTH
    figure = Figure(figsize=(width, height))
    # margins as wide as any label, in inches: to measure all labels takes a third of drawing them
    rows = list(np.atleast_1d(figure.subplots(n, 1, sharex=True, gridspec_kw={
        'left': 0.85 / width, 'right': 1.0 - 0.1 / width, 'bottom': 0.5 / height,
        'top': 1.0 - (0.3 + legend) / height, 'hspace': 0.12})))
    figure.align_ylabels(rows)
    for axes, panel in zip(rows, shown.panels):
        for line in panel.lines:
            if not line.hidden:
                cut = between(line, shown.start, shown.end)
                axes.plot(cut.t, cut.values, color=COLOURS[line.role],
                          linewidth=0.9 * WIDER.get(line.role, 1.0),
                          linestyle='--' if line.role == DASHED else '-',
                          label=line.name)
        axes.set_ylabel(f'{panel.title} [{panel.unit}]')
        axes.spines[['top', 'right']].set_visible(False)
        axes.margins(x=0)
        _shade(axes, shown, labelled=axes is rows[0])
    rows[-1].set_xlabel('time [s]')
    rows[0].set_xlim(shown.start, shown.end)
    lines = {label: line for axes in rows
             for line, label in zip(*axes.get_legend_handles_labels())}
    if len(lines) > 1:
        figure.legend(lines.values(), lines.keys(), loc='upper left', ncols=2,
                      frameon=False, fontsize=9)
    return figure


def background(shown: Shown) -> str:
    """Say which phases each tint is of; empty where there is none."""
    phases = dict.fromkeys(name for name, _, _ in _visible(shown))
    tints = [f'{colour} for {", ".join(same)}' for tint, colour in TINT_NAMES.items()
             if (same := [phase for phase in phases if kind(phase) == tint])]
    return f'Background: {"; ".join(tints)}.' if tints else ''


def _has_room(phase: str, share: float) -> bool:
    return share > LETTER_FRACTION * len(phase)


def _shade(axes: Axes, shown: Shown, *, labelled: bool) -> None:
    for phase, start, end in _visible(shown):
        if kind(phase):
            axes.axvspan(start, end, color=TINTS[kind(phase)], alpha=0.13, linewidth=0)
        if labelled and _has_room(2 * phase, (end - start) / (shown.end - shown.start)):
            axes.text(0.5 * (start + end), 1.0, phase, transform=axes.get_xaxis_transform(),
                      ha='center', va='bottom', fontsize=8, color='#555555')
    for at in shown.instants:
        axes.axvline(at, color='#CC0000', linewidth=1, linestyle='--')


def _visible(shown: Shown) -> Iterator[tuple[str, float, float]]:
    for phase in joined(shown.phases):
        start, end = max(phase.start, shown.start), min(phase.end, shown.end)
        if end > start:
            yield phase.name, start, end


def live(shown: Shown) -> dict[str, Any]:
    """
    Return the same as a plot of plotly.js: zoom, hover, and lines that a click takes away.

    Returns
    -------
    dict
        ``data`` and ``layout`` as JSON can hold them; colours are variables of the page's style.
    """
    n = len(shown.panels)
    height = (1.0 - 0.06 * (n - 1)) / n
    layout: dict[str, Any] = {
        'height': 90 + 190 * n, 'margin': {'l': 56, 'r': 8, 't': 44, 'b': 40},
        'autosize': True, 'hovermode': 'x unified', 'dragmode': 'zoom', 'uirevision': 'kept',
        'paper_bgcolor': 'rgba(0,0,0,0)', 'plot_bgcolor': 'rgba(0,0,0,0)',
        'font': {'color': 'var(ink)', 'size': 12},
        'modebar': {'bgcolor': 'rgba(0,0,0,0)', 'color': 'var(quiet)',
                    'activecolor': 'var(ink)'},
        'hoverlabel': {'bgcolor': 'var(paper)', 'font': {'color': 'var(ink)'}},
        'legend': {'orientation': 'h', 'x': 0, 'y': 1.02 + 0.1 / n, 'yanchor': 'bottom'},
        'xaxis': {'title': {'text': 'time [s]'}, 'range': [*shown.visible],
                  'anchor': f'y{n if n > 1 else ""}', **_axis()},
        'shapes': list(_shapes(shown)), 'annotations': list(_labels(shown))}
    data: list[dict[str, Any]] = []
    for i, panel in enumerate(shown.panels):
        suffix = '' if i == 0 else str(i + 1)
        top = 1.0 - i * (height + 0.06)
        layout[f'yaxis{suffix}'] = {
            'title': {'text': f'{panel.title} [{panel.unit}]'}, **_axis(),
            'domain': [max(0.0, top - height), top]}
        named = {trace['name'] for trace in data}
        data += [_trace(line, panel, shown, suffix, line.name not in named)
                 for line in panel.lines]
    return {'data': data, 'layout': layout}


def _axis() -> dict[str, Any]:
    return {'gridcolor': 'var(line)', 'zerolinecolor': 'var(line)', 'automargin': True}


def _trace(line: Line, panel: Panel, shown: Shown, suffix: str, first: bool) -> dict[str, Any]:
    cut = between(line, shown.start, shown.end)
    return {
        'type': 'scatter', 'mode': 'lines', 'name': line.name, 'legendgroup': line.name,
        'showlegend': first, 'yaxis': f'y{suffix}', 'xaxis': 'x',
        'visible': 'legendonly' if line.hidden else True,
        'line': {'color': f'var({line.role})', 'width': 1.2 * WIDER.get(line.role, 1.0),
                 'dash': 'dash' if line.role == DASHED else 'solid'},
        'hovertemplate': f'%{{y:.4g}} {panel.unit}',
        'x': [round(float(x), 4) for x in cut.t],
        'y': [float(f'{y:.5g}') if np.isfinite(y) else None for y in cut.values]}


def _shapes(shown: Shown) -> Iterator[dict[str, Any]]:
    for phase, start, end in _visible(shown):
        if kind(phase):
            yield {'type': 'rect', 'xref': 'x', 'yref': 'paper', 'x0': start, 'x1': end, 'y0': 0,
                   'y1': 1, 'fillcolor': f'var({kind(phase)})', 'opacity': 0.16,
                   'line': {'width': 0}, 'layer': 'below'}
    for at in shown.instants:
        yield {'type': 'line', 'xref': 'x', 'yref': 'paper', 'x0': at, 'x1': at, 'y0': 0,
               'y1': 1, 'line': {'color': 'var(bad)', 'width': 1.5, 'dash': 'dash'}}


def _labels(shown: Shown) -> Iterator[dict[str, Any]]:
    first, last = shown.visible
    for phase, start, end in _visible(shown._replace(start=first, end=last)):
        if _has_room(phase, (end - start) / (last - first)):
            yield {'text': phase, 'x': 0.5 * (start + end), 'xref': 'x', 'y': 1, 'yref': 'paper',
                   'showarrow': False, 'yanchor': 'bottom',
                   'font': {'size': 10, 'color': 'var(quiet)'}}


MEASURED, ESTIMATED, TRUE = '#0072B2', '#D55E00', '#555555'


def specific_force(recording: Recording, calibration: Calibration) -> Stream | None:
    """Return calibrated specific force in ft_sensor, its delay removed [m/s^2]."""
    raw, sensor = recording.accelerometer, calibration.accelerometer
    if raw is None or sensor is None:
        return None
    f = np.linalg.solve(sensor.matrix, (raw.values - sensor.offset.value).T).T
    return Stream(raw.t - float(sensor.delay), f, raw.frame)


def in_step(recording: Recording, *streams: Stream | None, least: int = 2) -> list[Stream]:
    """Return streams in the step motion and the ringing after it; none where one is too short."""
    span = next((phase for phase in recording.phases if phase.name == 'step'), None)
    parts = [one.between(span.start, span.end) for one in streams if one is not None and span]
    return parts if len(parts) == len(streams) and min(map(len, parts)) >= least else []


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
            middle = np.searchsorted(pose.t, (span.start + span.end) / 2)
            down = -pose.R_base_sensor[min(int(middle), len(pose) - 1), 2]
            means.append(part.values[:, :3].mean(axis=0))
            predicted.append(float(calibration.mass) * calibration.gravity * down
                             + calibration.wrench_bias.value[:3])
    figure, (top, bottom) = axes_grid(2, 1, height=4.6)
    x, measured = np.arange(1, len(means) + 1), np.array(means)
    for axis, (name, mark) in enumerate(zip('xyz', 'os^')):
        top.plot(x, measured[:, axis], mark, label=f'measured {name}')
        bottom.plot(x, (measured - predicted)[:, axis], mark, label=name)
    top.plot(x, np.array(predicted), '_', color=TRUE, markersize=14,
              label=['predicted', None, None])
    bottom.axhline(0, color=TRUE, linewidth=0.8)
    for axes, title, columns in ((top, 'Mean force at rest', 2),
                                 (bottom, 'Measured - predicted', 3)):
        axes.set(xlabel='pose', ylabel='force [N]', xticks=x)
        headed(axes, title, columns)
    return figure


def step_fit(recording: Recording, calibration: Calibration) -> Figure | None:
    """Draw the step: sensor force along x, mass times acceleration, and the residual."""
    f, parts = specific_force(recording, calibration), in_step(recording, recording.wrench)
    if f is None or not parts:
        return None
    part, = parts
    measured = part.values[:, 0] - calibration.wrench_bias.value[0]
    predicted = -float(calibration.mass) * f.at(part.t)[:, 0]
    offset = (measured - predicted).mean()
    figure, (top, bottom) = axes_grid(2, 1, height=4.2, sharex=True)
    t = part.t - part.t[0]
    top.plot(t, measured, color=MEASURED, linewidth=1, label='sensor, bias removed')
    top.plot(t, predicted + offset, color=ESTIMATED, linewidth=1, label='mass x acceleration')
    top.set(ylabel='force [N]')
    headed(top, 'Step along x')
    bottom.plot(t, measured - predicted - offset, color=TRUE, linewidth=0.7)
    bottom.set(xlabel='time since the step [s]', ylabel='residual [N]')
    return figure


def accelerometer_regression(recording: Recording, calibration: Calibration) -> Figure | None:
    """Draw voltage against specific force from the wrench, [Gamez2005] Eq. 17 as a picture."""
    wrench, sensor = recording.wrench, calibration.accelerometer
    parts = in_step(recording, recording.accelerometer)
    if wrench is None or sensor is None or not parts:
        return None
    part, = parts
    axis = int(np.argmax(np.abs(sensor.map.value[:, 0])))
    f = -(wrench.at(part.t - float(sensor.delay))[:, 0]
          - calibration.wrench_bias.value[0]) / float(calibration.mass)
    figure, (axes,) = axes_grid(1, 1, height=3.4)
    axes.plot(f, part.values[:, axis], '.', markersize=2, color=MEASURED, label='samples')
    line = np.array([f.min(), f.max()])
    slope = sensor.matrix[axis, 0]
    gain = size(slope, f'{sensor.unit}/(m/s^2)', 4)
    middle = part.values[:, axis].mean() - slope * f.mean()
    axes.plot(line, middle + slope * line, color=ESTIMATED, label=f'gain {gain}')
    axes.set(xlabel='specific force from the wrench [m/s²]', ylabel=f'reading [{sensor.unit}]')
    headed(axes, 'Accelerometer and specific force in the step')
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
    headed(axes, 'Filter kalman; dotted: limits of its bandwidth')
    return figure


def spectra(recording: Recording, calibration: Calibration, contact: Stream | None
            ) -> Figure | None:
    """Draw the power spectra of u - m a and of the observer, as [Gamez2005] Fig. 6."""
    f = specific_force(recording, calibration)
    parts = in_step(recording, recording.wrench, contact, least=256)
    if f is None or not parts:
        return None
    wrench, output = parts
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


def label_log_axes(axes: Axes) -> None:
    """Label logarithmic axes by plain numbers; over two decades by powers of ten alone."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == 'log':
            low, high = axis.get_view_interval()
            axis.set_major_formatter(LogFormatter())
            axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))
            if high > 100.0 * low:
                axis.set_minor_locator(NullLocator())  # hundreds of ticks take a second to draw


def headed(axes: Axes, title: str, columns: int = 3) -> None:
    """Put title and legend above the curves, one over the other."""
    label_log_axes(axes)
    lines = -(-len(axes.get_legend_handles_labels()[1]) // columns)
    axes.set_title(title, loc='left', fontsize=10, pad=6.0 + 16.0 * lines)
    axes.legend(fontsize=9, ncols=columns, frameon=False, loc='lower left',
                bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)


def axes_grid(rows: int, columns: int, *, height: float, sharex: bool = False,
              sharey: bool = False) -> tuple[Figure, list[Any]]:
    """Return a figure of the reports' width and its axes, row by row."""
    figure = Figure(figsize=(FIGURE_WIDTH, height), layout='constrained')
    axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey)
    for one in axes.flat:
        one.grid(alpha=0.25)
        one.spines[['top', 'right']].set_visible(False)
    return figure, list(axes.flat)
