"""The report of a diagnosis as one HTML page."""

from collections.abc import Iterator

from forcecal_ros.diagnose.judge.named_effects import AT_BOUND, Parameter
from forcecal_ros.diagnose.say.result import Diagnosis
from forcecal_ros.diagnose.say.verdict import percent
from forcecal_ros.report import diagnosis_figures as figures
from forcecal_ros.report.diagnosis_view import View
from forcecal_ros.report.diagnosis_words import explained, facts, headline, NAMED
from forcecal_ros.report.effect_words import phrase
from forcecal_ros.report.page import Picture, picture, render_page
from forcecal_ros.report.panels import Shown
from forcecal_ros.report.quantity import beside, rounded, with_error
from forcecal_ros.report.words import Step
from matplotlib.figure import Figure

TONES = {'no_gap': 'good', 'identified': 'known', 'ambiguous': 'doubt', 'partial': 'doubt',
         'unknown': 'bad', 'not_excited': 'plain', 'invalid_data': 'bad'}
"""Colour of each verdict."""

CAPTIONS = {
    'Where it shows most': 'The channel and the phase that the verdict names; below it measured '
                           'less simulated.',
    'Where else': 'How far measured and simulated are apart beyond the noise at rest, by stage '
                  'and channel, phase and octave. Grey: no farther than noise.',
    'Signals': 'Simulated: after what differs from robot to robot was fitted within its '
               'tolerances.',
    'What is left': 'The same channels, measured less simulated.',
    'Spectra': 'What is left in motion, against the noise at rest.',
}


WITH_EFFECTS = {'Signals': ' Explained: with the effects, too.',
                'What is left': ' Less explained: with the effects, too.'}
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
    arms = ('as the file has it', 'simulated', *(('explained',) if named else ()), 'noise')
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
        'Where it shows most': figures.closest(view)} if first else {
        'Where else': figures.heat_map(view), 'Signals': figures.signals(view),
        'What is left': figures.residuals(view), 'Spectra': figures.spectra(view)}
    for title, what in shown.items():
        if what is not None:
            more = WITH_EFFECTS.get(title, '') if figures.named(view) else ''
            yield picture(title, CAPTIONS[title] + more, what)


def _with_error(p: Parameter) -> tuple[str, str]:
    """Write a number and its standard error, or that it stands at its bound."""
    return (with_error(p.value, 0.0)[0], AT_BOUND) if p.at_bound else with_error(p.value, p.std)


def _numbers(d: Diagnosis) -> list[tuple[str, str, str, str, str]]:
    """Return every number of every effect in SI units, as a rig file wants them."""
    out = [(e.name, name, *_with_error(p), '' if p.unit == '1' else p.unit)
           for e in d.effects for name, p in e.parameters.items()]
    return out + [(e.name, 'from', f'{e.begin:.3f}',
                   f'{e.begin_ci95[0]:.3f} to {e.begin_ci95[1]:.3f} (95 %)', 's')
                  for e in d.effects if e.begin is not None and e.begin_ci95 is not None]
