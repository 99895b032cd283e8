"""The report of a diagnosis as one HTML page."""

import base64
from io import BytesIO

from forcecal_ros.diagnose.pipeline import Outcome
from forcecal_ros.report import diagnosis_figures as figures
import jinja2
from matplotlib.figure import Figure


def render(outcome: Outcome) -> str:
    """
    Return a diagnosis as a page: verdict first, then why, where, and how far.

    Parameters
    ----------
    outcome : Outcome

    Returns
    -------
    str
        HTML, one file without network; everything is escaped.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader('forcecal_ros', 'report'), autoescape=True,
        trim_blocks=True, undefined=jinja2.StrictUndefined)
    drawn = (('Where', figures.heat_map(outcome)), ('Signals', figures.overlays(outcome)),
             ('Spectra', figures.spectra(outcome)))
    d = outcome.diagnosis
    effects = [(e.name, name, f'{p.value:.5g}', f'{p.std:.2g}', p.unit)
               for e in d.effects for name, p in e.parameters.items()]
    return environment.get_template('diagnosis.html.j2').render(
        title='Sim-to-real gap', verdict=d.verdict.replace('_', ' '), reason=d.reason,
        notes=d.notes, effects=effects, not_excited=d.not_excited, gap=d.gap,
        candidates=[(name, f'{100.0 * p:.1f}') for name, p in d.candidates],
        channels=[(name, *(f'{x:.4g}' for x in rms))
                  for name, rms in (d.gap.channels.items() if d.gap else ())],
        figures=[(title, _png(figure)) for title, figure in drawn if figure is not None])


def _png(figure: Figure) -> str:
    buffer = BytesIO()
    figure.savefig(buffer, format='png', dpi=110)
    return base64.b64encode(buffer.getvalue()).decode()
