"""Reports as pages: one HTML file each without network, everything in it escaped."""

import base64
from collections.abc import Sequence
from datetime import datetime, timezone
from functools import cache
import gzip
from io import BytesIO
from pathlib import Path
import shlex
from typing import Any, NamedTuple
from urllib.parse import quote

from forcecal_ros import __version__
from forcecal_ros.core.extras import program
from forcecal_ros.core.streams import Recording
from forcecal_ros.report.figures import background, drawn, live, Shown
from forcecal_ros.report.rows import HALF_WIDTH
import jinja2
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[2]


class Step(NamedTuple):
    """What to do next: a sentence, and the command that does it where there is one."""

    words: str
    command: str = ''


def estimated_by(bag: str, calibration: str, how: Sequence[str] = ()) -> Step:
    """Return how a calibration is used; ``how``: what the command states of the recording."""
    return Step('Remove weight, inertia and bias from this recording, or another one:', shlex.join(
        ('forcecal', 'estimate', bag, '--calibration', calibration, *how, '-o', 'contact')))


class Fact(NamedTuple):
    """One line of the first screen."""

    label: str
    words: str
    command: str = ''


def origin(recordings: Sequence[Recording]) -> list[str]:
    """Say of each recording which one it is, when it was made and how long it is."""
    return [' · '.join(part for part in (one.source, _made(one), _lasting(one)) if part)
            for one in recordings]


def _made(recording: Recording) -> str:
    if recording.start_ns < 10 ** 18:  # 2001: of a clock that began with the simulation
        return 'on simulated time'
    return datetime.fromtimestamp(recording.start_ns / 1e9, timezone.utc).strftime(
        '%Y-%m-%d %H:%M:%S UTC')


def _lasting(recording: Recording) -> str:
    ends = [s.t[-1] for s in (recording.wrench, recording.pose, recording.target)
            if s is not None and len(s)]
    return f'{max(ends):.0f} s' if ends else ''


PAGES = jinja2.Environment(
    loader=jinja2.PackageLoader('forcecal_ros', 'report'), autoescape=True, trim_blocks=True,
    lstrip_blocks=True, undefined=jinja2.StrictUndefined)
"""The templates of this folder, all of them in the frame of ``page.html.j2``."""
PAGES.globals['program'] = program


class Picture(NamedTuple):
    """
    One picture of a page.

    Attributes
    ----------
    title, words : str
    pngs : tuple of str
        The pictures as text; they are printed, and shown if nothing can zoom.
    live : dict or None
        The same as a plot that zooms; empty where plotly is missing.
    """

    title: str
    words: str
    pngs: tuple[str, ...]
    live: dict[str, Any] | None = None


def picture(title: str, words: str, *what: Figure | Shown | bytes) -> Picture:
    """Make a picture of figures, of their PNG, or of what is shown over time."""
    pngs = tuple(base64.b64encode(one if isinstance(one, bytes) else png(
        drawn(one) if isinstance(one, Shown) else one)).decode() for one in what)
    if isinstance(what[0], Shown):
        return Picture(title, f'{words} {background(what[0])}'.strip(), pngs,
                       live(what[0]) if _plotly() else {})
    return Picture(title, words, pngs)


def render_page(template: str, title: str, **context: Any) -> str:
    """Fill in a template of this folder; everything that is given is escaped."""
    return PAGES.get_template(template).render(
        title=title, version=__version__, plotly=_plotly, half_width=HALF_WIDTH, **context)


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG, two of which fill a page."""
    buffer = BytesIO()
    figure.savefig(buffer, format='png', dpi=115)
    return buffer.getvalue()


def docs_link(name: str, word: str) -> tuple[str, str]:
    """Return a word and its address on a page of docs/; where that is not installed, its path."""
    pages = ROOT / 'build' / 'site' / 'docs' / f'{name}.html', ROOT / 'docs' / f'{name}.md'
    found = next((page.as_uri() for page in pages if page.is_file()), '')
    return (word, f'{found}#:~:text={quote(word)}') if found else (
        f'docs/{name}.md in the sources of forcecal_ros', '')


@cache
def _plotly() -> str | None:
    """Return plotly.js, packed as text; None where it is not installed."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        return None
    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode()

