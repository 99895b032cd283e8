"""The report of a diagnosis as one HTML page."""

from forcecal_ros.report import diagnosis_figures as figures
from forcecal_ros.report.diagnosis_view import View
from forcecal_ros.report.page import embedded, png, render_page

CAPTIONS = {
    'Where': 'Excess of the recalibrated residual over the noise at standstill, by stage and '
             'channel, phase and octave. Grey: within the noise.',
    'Signals': 'The channels that the effects change most, on the recording that was judged.',
    'Spectra': 'Residual in motion before and after the effects, against the noise at standstill.',
}


def render(view: View) -> str:
    """
    Return a diagnosis as a page: verdict first, then where, which, how far and what next.

    Returns
    -------
    str
        HTML, one file without network; everything is escaped.
    """
    drawn = (('Where', figures.heat_map(view)), ('Signals', figures.overlays(view)),
             ('Spectra', figures.spectra(view))) if len(view.times) else ()
    d = view.diagnosis
    effects = [(e.name, name, f'{p.value:.5g}', f'{p.std:.2g}', '' if p.unit == '1' else p.unit)
               for e in d.effects for name, p in e.parameters.items()]
    effects += [(e.name, 'from', f'{e.begin:.3f}',
                 f'{e.begin_ci95[0]:.3f} to {e.begin_ci95[1]:.3f}', 's')
                for e in d.effects if e.begin is not None and e.begin_ci95 is not None]
    return render_page(
        'diagnosis.html.j2', 'Sim-to-real gap', verdict=d.verdict.replace('_', ' '),
        reason=d.reason, notes=d.notes, effects=effects, gap=d.gap, advice=view.advice,
        candidates=[(name, 100.0 * p) for name, p in d.candidates],
        channels=[(name, view.units[name], *(f'{x:.3g}' for x in rms))
                  for name, rms in (d.gap.channels.items() if d.gap else ())],
        figures=[{'title': title, 'words': CAPTIONS[title], 'png': embedded(png(figure))}
                 for title, figure in drawn if figure is not None])
