"""The reference pages are those that the code of today writes."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs'


@pytest.fixture(scope='module')
def reference():
    spec = importlib.util.spec_from_file_location('reference', DOCS / 'reference.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize('page', ['nodes.md', 'commands.md'])
def test_the_page_is_what_the_code_writes(reference, page):
    written = ''.join(reference.PAGES[page]())
    assert (DOCS / 'reference' / page).read_text() == written, 'run python docs/reference.py'
