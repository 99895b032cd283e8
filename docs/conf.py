"""The pages of this project as a site: ``sphinx-build -W -c docs . build/site``."""

from pathlib import Path
import re

ROOT = Path(__file__).resolve().parents[1]

project = 'forcecal_ros'
copyright = 'the maintainers of forcecal_ros, Apache-2.0'  # noqa: A001  sphinx calls it so
release = re.search(r"__version__ = '(.+)'",
                    (ROOT / 'forcecal_ros' / '__init__.py').read_text())[1]

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon']
root_doc = 'docs/index'
include_patterns = ['README.md', 'CONTRIBUTING.md', 'CHANGELOG.md', 'docs/**.md']
exclude_patterns = ['.venv', 'build', 'install', 'log', 'test', 'forcecal_ros']
html_theme = 'furo'
html_title = f'forcecal_ros {release}'

myst_heading_anchors = 3

autodoc_typehints = 'description'
autodoc_member_order = 'bysource'
napoleon_google_docstring = False
napoleon_use_ivar = True


def setup(app):
    """Offer files of the benchmarks, which are no pages of the site, as downloads; begin at the top."""
    app.connect('source-read', lambda app, page, source: source.__setitem__(
        0, re.sub(r'\]\((?=(\.\./)+benchmark/)', '](path:', source[0])))
    app.connect('build-finished', lambda app, error: Path(app.outdir, 'index.html').write_text(
        '<meta http-equiv="refresh" content="0; url=docs/index.html">\n'))
