"""A page as a browser shows it: it zooms, prints values, toggles lines, and fits a phone."""

from browser import browser, CUT, NEEDED
from forcecal_ros.core.streams import Phase
from forcecal_ros.report.figures import Line, Panel, Shown
from forcecal_ros.report.page import Fact, picture, render_page
import numpy as np
import pytest

pytestmark = NEEDED

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
        headline='The tool weighs 13 kg.', notes=[], pages=[],
        facts=[Fact('Next', 'Do it:', f'forcecal {long}')],
        warnings=[long], first=[picture('Force', 'words', SHOWN)], figures=[],
        head=['estimate', 'value', '±', 'unit', 'truth', 'off by'],
        rows=3 * [
            ['centre of mass', '1.00003', '0.00007', 'kg m^2', '1.00000', '0.00004']],
        quality=[('Note', 'a sentence that is longer than a phone is wide')]))
    with browser(folder / 'browser') as one:
        one.size(1280, 1000)
        one.open(f'file://{folder}/page.html')
        one.until(DRAWN)
        yield one


@pytest.fixture(scope='module')
def live_page(tmp_path_factory):
    folder = tmp_path_factory.mktemp('live')
    (folder / 'live.html').write_text(render_page(
        'live.html.j2', 'Live', robot='a robot', nonce='n', sequences=['calibrate'],
        token='t'))  # noqa: S106 - of no server
    with browser(folder / 'browser') as one:
        one.size(1280, 1000)
        one.open(f'file://{folder}/live.html')
        yield one


def shown(page, level=0.0, spread=0.1, age=0.02, bins=200):
    """Show wrenches of noise about a level on the live page."""
    page.run(f"""rows = []; show({{phase: 'idle', reason: '', answer: '', gap: null, late: 0,
        nodes: [{{name: 'observer', level: 'ok', message: 'estimating', age: 0.4}}],
        topics: Object.fromEntries([...Object.keys(COLUMN), 'phase', 'diagnostics'].map(key => [
            key, {{topic: '/' + key, age: {age}}}])),
        rows: Array.from({{length: {bins}}}, (_, i) => {{
            const noise = () => {level} + {spread} * (Math.random() - 0.5);
            const wrench = [0, 1].map(k => Array.from(
                {{length: 6}}, () => noise() + k * {spread}));
            return [i, 'idle', wrench, wrench, null]; }})}}); true""")
    page.until('!changed')


def colours(page, canvas):
    """Count the pixels of a canvas that are of the colour of x, y and z."""
    return page.run(f"""(() => {{
        const c = document.querySelectorAll('canvas')[{canvas}];
        const data = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        const want = ['simulated', 'good', 'explained'].map(name => {{
            const p = document.createElement('canvas').getContext('2d');
            p.fillStyle = colour(name); p.fillRect(0, 0, 1, 1);
            return [...p.getImageData(0, 0, 1, 1).data]; }});
        const count = [0, 0, 0];
        for (let i = 0; i < data.length; i += 4)
            want.forEach((w, k) => count[k] += data[i + 3] > 99
                && [0, 1, 2].every(j => Math.abs(data[i + j] - w[j]) < 40));
        return count; }})()""")


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
    assert page.run(CUT) == []
    text = page.run('document.body.innerText')
    assert text.count('0.00007') == 3 and text.count('0.00004') == 3


def test_the_live_page_begins_with_the_measured_wrench(live_page):
    titles = live_page.run('[...document.querySelectorAll("figure h2")].map(e => e.textContent)')
    assert [one.partition(':')[0] for one in titles[::2]] == [
        'Measured wrench', 'Contact wrench', 'Weight and inertia of the tool']


@pytest.mark.parametrize(('width', 'dark'), [(1280, False), (400, True)])
def test_abort_is_a_red_button_apart_from_the_others(live_page, width, dark):
    live_page.size(width, 1000, dark)
    start, abort = live_page.run("""['calibrate', 'abort'].map(name => {
        const e = document.querySelector(`[data-ask=${name}]`), r = e.getBoundingClientRect();
        return [getComputedStyle(e).backgroundColor, r.left, r.right, r.top, r.bottom]; })""")
    red, green, blue = (int(x) for x in abort[0].strip('rgb()').split(','))
    assert red > 150 and green < 60 and blue < 60 and start[0] != abort[0]
    assert abort[2] <= width
    if width > 600:
        assert abort[1] - start[2] > 100
    else:
        assert abort[3] - start[4] > 15 and abort[2] - abort[1] > 300


def test_labels_of_neighbouring_lanes_do_not_overlap(live_page):
    live_page.size(1280, 1000)
    live_page.run("""limits.clear(); window.heights = [];
        CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
            if (x === 0 && this.canvas.dataset.first === '0') heights.push(y); }; true""")
    shown(live_page, spread=0.02)  # about 0, from -1 to 1
    heights = live_page.run('[...new Set(heights)]')
    assert len(heights) == 9
    assert np.diff(np.sort(heights)).min() > 10.0


def test_a_picture_is_folded_until_something_is_received(live_page):
    shown(live_page)
    assert live_page.run('[...document.querySelectorAll("canvas")].map(one => one.hidden)') == (
        [False] * 4 + [True] * 2)
    assert live_page.run('[...document.querySelectorAll(".key b")].map(one => '
                         'one.textContent.split(".")[1]?.length ?? 0)') == (
        [2, 2, 2, 3, 3, 3] * 2 + [0] * 6)


def test_each_topic_shows_the_time_since_its_last_message(live_page):
    shown(live_page, age=0.02)
    assert live_page.run('document.querySelector("[data-age=wrench]").textContent') == (
        '/wrench, 0.0 s ago')
    shown(live_page, age=3.2)
    assert live_page.run('document.querySelector("[data-age=wrench].old").textContent') == (
        '/wrench, 3.2 s ago')
    # those of status come once a second
    assert live_page.run("""Object.fromEntries([...document.querySelectorAll('.age')].map(
        e => [e.textContent.split(',')[0], e.matches('.old')]))""") == {
            '/wrench': True, '/contact': True, '/inertial': True, '/phase': False,
            '/diagnostics': False}
    assert '0.4 s ago' in live_page.run('document.querySelector("#nodes").textContent')
    shown(live_page, age='null')
    said = live_page.run('document.querySelector("[data-age=contact]").textContent')
    assert said == '/contact: no message'


def test_axes_do_not_jump_to_noise(live_page):
    def limits():
        return live_page.run('limits.get(document.querySelector("canvas"))')

    live_page.run('limits.clear()')
    shown(live_page, spread=0.02)
    quiet = limits()
    assert quiet['span'] >= 2.0  # N, however small the noise
    shown(live_page, spread=0.3)
    assert limits() == quiet
    shown(live_page, level=130.0, spread=5.0)
    loaded = limits()
    assert all(begin < 127.5 and begin + loaded['span'] > 137.5 for begin in loaded['begins'])
    shown(live_page, level=130.0, spread=3.0)
    assert limits() == loaded


def test_no_axis_hides_another_one(live_page):
    live_page.size(1280, 1000)
    shown(live_page, spread=1.0)
    assert min(colours(live_page, 0)) > 100


@pytest.mark.parametrize('dark', [False, True])
def test_the_live_page_fits_a_phone(live_page, dark):
    live_page.size(400, 900, dark)
    shown(live_page)
    assert live_page.run(CUT) == []
    assert live_page.run('document.documentElement.scrollWidth') <= 400
