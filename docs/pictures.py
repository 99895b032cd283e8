"""Make the pictures of the README in a real browser: ``python docs/pictures.py [FOLDER]``.

live.gif: the page of ``forcecal live`` with a recording of the simulated rig, played at its pace.
report.png: the first screen of a diagnosis. FOLDER keeps what they are made of, and shows every
page as a reader sees it: FOLDER/pages/PAGE_WIDTH_SCHEME.png. Requires Chromium or Chrome, and
pillow.
"""

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test' / 'helpers')]

from browser import browser, Page  # noqa: E402
from forcecal_ros.core.calibration import Estimate  # noqa: E402
from forcecal_ros.io.bags import read_recording  # noqa: E402
from forcecal_ros.io.calibration_file import dump, load  # noqa: E402
from forcecal_ros.observe import replay  # noqa: E402
from forcecal_ros.report.page import render_page  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

COMMANDS = {
    'sample': ['sample', 'rig', '-o', 'sample'],
    'calibration.yaml': ['calibrate', 'sample/sound', '-o', 'calibration.yaml', '--report',
                         'calibration.html', '--quiet'],
    'gap': ['diagnose', 'sample/late', '--rig', 'nominal', '-o', 'gap', '--quiet'],
    'limb': ['sample', 'insitu', '-o', 'limb'],
    'insitu': ['insitu', 'limb/spec.yaml', '-o', 'insitu'],
    'fleet': ['fleet', 'nights', 'gap', '-o', 'fleet']}
"""What each of them makes, one after the other."""

PAGES = {'calibration': 'calibration.html', 'diagnosis': 'gap/report.html',
         'insitu': 'insitu/report.html', 'fleet': 'fleet/fleet.html', 'live': 'live.html'}
"""Where the pages are."""

BIN_S, FRAME_S, SHOWN_S = 0.04, 0.8, 0.12
"""Of a row of the page; between two frames, in the recording and in the GIF [s]."""

SEQUENCES = ('calibrate', 'contact', 'diagnose')


def seen(page: Page, bottom: int) -> Image.Image:
    """Return what is seen down to a row, without a scroll bar."""
    image = Image.open(BytesIO(page.picture())).convert('RGB')
    return image.crop((0, 0, page.run('document.documentElement.clientWidth'), bottom))


def snapshots(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield what the server of the page would send, frame by frame."""
    recording = read_recording(folder / 'sample' / 'sound')
    assert recording.wrench is not None
    estimate = replay(recording, load(folder / 'calibration.yaml'))
    streams = [(recording.wrench.t, recording.wrench.values), (estimate.t, estimate.contact)]
    topics = {name: {'topic': topic, 'age': 0.0} for name, topic in (
        ('wrench', '/wrench'), ('contact', '/observer/contact_wrench'))}
    topics['inertial'] = {'topic': '/observer/inertial_wrench', 'age': None}
    topics |= {name: {'topic': topic, 'age': 0.4} for name, topic in (
        ('phase', '/sequencer/phase'), ('diagnostics', '/diagnostics'))}
    rows: list[list[Any]] = []
    for i in range(int(recording.wrench.t[-1] / BIN_S)):
        start = i * BIN_S
        phase = next((one.name for one in recording.phases if one.start <= start < one.end), 'idle')
        ends = []
        for t, values in streams:
            part = values[np.searchsorted(t, start):np.searchsorted(t, start + BIN_S)]
            part = part[np.isfinite(part).all(axis=1)]
            ends.append([part.min(axis=0).tolist(), part.max(axis=0).tolist()] if len(part)
                        else None)
        rows.append([i, phase, *ends, None])
        if i % round(FRAME_S / BIN_S) == 0:
            yield {'rows': rows, 'phase': phase, 'reason': '', 'answer': '', 'gap': None,
                   'late': 0, 'topics': topics, 'nodes': [
                       {'name': 'observer', 'level': 'ok', 'age': 0.2, 'message': 'estimating'}]}
            rows = []


def live(folder: Path) -> None:
    """Write live.gif."""
    (folder / 'live.html').write_text(render_page(
        'live.html.j2', 'Live', robot='the simulated robot', nonce='', token='-',  # noqa: S106
        sequences=SEQUENCES))
    film = []
    with browser(folder / 'browser') as page:
        page.size(1100, 860)
        page.open(f'file://{folder}/live.html')
        page.run('events.close(); buttons.forEach(button => { button.disabled = false; })')
        for now in snapshots(folder):
            page.run(f'show({json.dumps(now)})')
            page.until('!changed')
            film.append(seen(page, 812))
    sheet = Image.new('RGB', (film[0].width, 3 * film[0].height))
    for k, at in enumerate((len(film) // 3, len(film) // 2, -6)):  # weight, sweep, contact
        sheet.paste(film[at], (0, k * film[0].height))
    palette = sheet.quantize(64)
    small = [one.resize((one.width * 2 // 3, one.height * 2 // 3), Image.Resampling.LANCZOS)
             .quantize(palette=palette, dither=Image.Dither.NONE) for one in film]
    small[0].save(ROOT / 'docs' / 'live.gif', save_all=True, append_images=small[1:], loop=0,
                  duration=round(1000 * SHOWN_S), optimize=True)


def report(folder: Path) -> None:
    """Write report.png."""
    with browser(folder / 'browser') as page:
        page.size(960, 700)
        page.open(f'file://{folder}/gap/report.html')
        page.until('document.querySelectorAll(".live .main-svg").length > 0')
        bottom = page.run('document.querySelector(".said").getBoundingClientRect().bottom')
        seen(page, int(bottom) + 12).quantize(64).save(ROOT / 'docs' / 'report.png', optimize=True)


def nights(folder: Path) -> None:
    """Write calibrations of two robots, the tool of one of which changes."""
    whole, rng = load(folder / 'calibration.yaml'), np.random.default_rng(0)
    (folder / 'nights').mkdir(exist_ok=True)
    for robot, change in (('left', 0.02), ('right', 0.0)):
        for night in range(14):
            mass = float(whole.mass) + 0.001 * rng.normal() + change * (night > 9)
            (folder / 'nights' / f'{robot}_{night}.yaml').write_text(dump(replace(
                whole, mass=Estimate(mass, 0.001, 'kg'), source={
                    'recorded': f'2026-03-{night + 1:02d}T02:00:00+00:00', 'robot': robot})))


def pages(folder: Path) -> None:
    """Show every page on a screen and on a phone, light and dark, with all its parts open."""
    now = list(snapshots(folder))[20:60]
    (folder / 'pages').mkdir(exist_ok=True)
    with browser(folder / 'browser') as page:
        for name, path in PAGES.items():
            for width, dark in ((w, d) for w in (1280, 400) for d in (False, True)):
                page.size(width, 900, dark)
                page.open(f'file://{folder}/{path}')
                page.run('document.querySelectorAll("details").forEach(one => { one.open = true; })')
                if name == 'live':
                    page.run(f'events.close(); {json.dumps(now)}.forEach(show); '
                             'buttons.forEach(button => { button.disabled = false; })')
                    page.until('!changed')
                page.until('[...document.querySelectorAll(".live")].every('
                           'one => one.querySelector(".main-svg"))')
                page.size(width, page.run('document.documentElement.scrollHeight'), dark)
                (folder / 'pages' / f'{name}_{width}_{"dark" if dark else "light"}.png'
                 ).write_bytes(page.picture())


def main(folder: Path, *, keep: bool) -> None:
    """Make what is not there, then the pictures of it."""
    folder.mkdir(exist_ok=True)
    for name, arguments in COMMANDS.items():
        if name == 'fleet':
            nights(folder)
        if not (folder / name).exists():
            subprocess.run([sys.executable, '-m', 'forcecal_ros.cli.main', *arguments],
                           cwd=folder, check=True, stdout=subprocess.DEVNULL,
                           env={**os.environ, 'PYTHONPATH': str(ROOT)})
    live(folder)
    report(folder)
    if keep:
        pages(folder)


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as scratch:
        main(Path(sys.argv[1] if len(sys.argv) > 1 else scratch).resolve(), keep=len(sys.argv) > 1)
