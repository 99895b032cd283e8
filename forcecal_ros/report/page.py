"""Reports as pages: one HTML file each without network, everything in it escaped."""

import base64
from io import BytesIO
from typing import Any

import jinja2
from matplotlib.figure import Figure

PAGES = jinja2.Environment(
    loader=jinja2.PackageLoader('forcecal_ros', 'report'), autoescape=True, trim_blocks=True,
    undefined=jinja2.StrictUndefined)
"""The templates of this folder, all of them in the frame of ``page.html.j2``."""


def render_page(template: str, title: str, **context: Any) -> str:
    """Fill in a template of this folder; everything that is given is escaped."""
    return PAGES.get_template(template).render(title=title, **context)


def png(figure: Figure, dpi: int = 110) -> bytes:
    """Return a figure as a PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format='png', dpi=dpi)
    return buffer.getvalue()


def embedded(image: bytes) -> str:
    """Return a PNG as the text that a page shows it by."""
    return base64.b64encode(image).decode()
