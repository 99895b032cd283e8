"""A page as a browser shows it: it zooms, says values, toggles lines, and fits a phone."""

from browser import browser, CHROMIUM
from forcecal_ros.core.streams import Phase
from forcecal_ros.report.figures import Line, Panel, Shown
from forcecal_ros.report.page import Fact, picture, render_page
import numpy as np
import pytest

pytestmark = pytest.mark.skipif(
    not CHROMIUM, reason='wants Chromium or Chrome, which is not installed')

T = np.arange(0.0, 40.0, 0.01)
PHASES = (Phase('move', 0.0, 10.0), Phase('step', 10.0, 20.0), Phase('contact', 20.0, 40.0))
SHOWN = Shown(tuple(Panel(f'force {axis}', 'N', (
    Line('measured', 'measured', T, np.sin(T)), Line('simulated', 'simulated', T, np.cos(T)),
    Line('explained', 'explained', T, np.sin(T)))) for axis in 'xy'), PHASES, 0.0, 40.0,
    closer=(12.0, 14.0))
DRAWN = 'document.querySelectorAll(".live .main-svg").length > 0'
RANGE = 'document.querySelector(".live").layout.xaxis.range.map(Number)'
VISIBLE = 'document.querySelector(".live").data.map(line => line.visible)'


@pytest.fixture(scope='module')
def page(tmp_path_factory):
    pytest.importorskip('plotly')
    folder = tmp_path_factory.mktemp('page')
    long = 'a_name_without_a_place_to_break_at_' * 3
    (folder / 'page.html').write_text(render_page(
        'calibration.html.j2', 'Page', origin=[long], tone='good', word='calibrated',
        headline='The tool weighs 13 kg.', facts=[Fact('Next', 'Do it:', f'forcecal {long}')],
        warnings=[long], first=[picture('Force', 'words', SHOWN)], figures=[],
        head=['estimate', 'value', 'unit', '95 % interval'],
        rows=[['centre of mass', '1.00000', 'kg m^2', '0.99999 … 1.00001']] * 3,
        quality=[('Note', 'a sentence that is longer than a phone is wide')]))
    with browser(folder / 'browser') as one:
        one.size(1280, 1000)
        one.open(f'file://{folder}/page.html')
        one.until(DRAWN)
        yield one


def box(page, selector, of='.live'):
    """Return left, top, right and bottom of an element on the screen."""
    return page.run(f"""(() => {{ const r = document.querySelector('{of}')
        .querySelector('{selector}').getBoundingClientRect();
        return [r.left, r.top, r.right, r.bottom]; }})()""")


def test_a_picture_zooms_by_dragging_and_back_by_a_button(page):
    page.size(1280, 1000)
    assert page.run(RANGE) == [12.0, 14.0]
    left, top, right, _ = box(page, '.nsewdrag')
    middle, width = 0.5 * (left + right), right - left
    page.drag((middle, top + 20), (middle + 0.25 * width, top + 21))
    page.until(f'{RANGE}[0] > 12.9')
    assert page.run(RANGE) == pytest.approx([13.0, 13.5], abs=0.02)
    x, y, *_ = box(page, '[data-title="Reset axes"]')
    page.click(x + 5, y + 5)
    page.until(f'{RANGE}[0] === 12')


def test_the_pointer_says_the_values_of_all_lines(page):
    left, top, right, bottom = box(page, '.nsewdrag')
    page.mouse('Moved', 0.5 * (left + right), 0.5 * (top + bottom))
    page.mouse('Moved', 0.5 * (left + right) + 1, 0.5 * (top + bottom))
    said = page.until('document.querySelector(".live .hoverlayer").textContent')
    assert all(word in said for word in ('measured', 'simulated', 'explained', ' N'))
    assert '0.42' in said or '0.41' in said  # the sine of 13


def test_a_click_in_the_legend_takes_a_line_away_in_all_panels_and_brings_it_back(page):
    left, top, right, bottom = box(page, '.legendtoggle')
    page.click(0.5 * (left + right), 0.5 * (top + bottom))
    page.until(f'{VISIBLE}[0] === "legendonly"')
    assert page.run(VISIBLE) == ['legendonly', True, True] * 2
    page.click(0.5 * (left + right), 0.5 * (top + bottom))
    page.until(f'{VISIBLE}[0] === true')


def test_no_button_sends_anything_away(page):
    assert page.run('[...document.querySelectorAll(".modebar-btn")]'
                    '.map(one => one.dataset.title)') == [
        'Download plot as a PNG', 'Zoom', 'Pan', 'Reset axes']


@pytest.mark.parametrize('dark', [False, True])
def test_a_page_fits_a_phone_and_follows_its_colours(page, dark):
    page.size(400, 900, dark)
    page.until(f'document.querySelector(".live").layout.font.color === '
               f'"{"#e6e6e6" if dark else "#1b1b1b"}"')
    scrolled, seen = page.run('[document.documentElement.scrollWidth, '
                              'document.documentElement.clientWidth]')
    assert scrolled == seen <= 400
    page.until(f'document.querySelector(".main-svg").getBoundingClientRect().right <= {seen}')
