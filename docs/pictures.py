"""Make the pictures of the README in a real browser: ``python docs/pictures.py [live | report]``.

live.gif: the page of ``forcecal live`` while the simulated rig is calibrated and touches a wall.
report.png: the first screen of a diagnosis. Requires Chromium or Chrome, and pillow.
"""

from contextlib import ExitStack
from io import BytesIO
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))

from browser import browser, Page  # noqa: E402
from PIL import Image  # noqa: E402

FORCECAL = [sys.executable, '-m', 'forcecal_ros.cli.main']
WIDTH, HEIGHT = 960, 700
"""Size of the window [pixels]."""

FRAME_S, SHOWN_S = 0.5, 0.12
"""Time between two frames as recorded, and as the GIF shows it."""

COLOURS = 24
"""Of the GIF; more make it larger than 1 MB."""


def seen(page: Page, bottom: int = HEIGHT) -> Image.Image:
    """Return what is seen, without a scroll bar."""
    image = Image.open(BytesIO(page.picture())).convert('RGB')
    return image.crop((0, 0, page.run('document.documentElement.clientWidth'), bottom))


def frames(page: Page, sequence: str) -> list[Image.Image]:
    """Start a sequence on the page and return what is seen until it is done."""
    end, taken, begun = time.monotonic() + 60.0, [], False
    while time.monotonic() < end:
        phase = page.run('document.getElementById("phase").textContent')
        if not begun and phase in ('idle', 'done'):
            page.run(f'document.querySelector("[data-ask={sequence}]").click()')
        begun = begun or phase not in ('idle', 'done')
        taken.append(seen(page))
        if begun and phase in ('done', 'aborted'):
            return taken
        time.sleep(FRAME_S)
    raise SystemExit(f'{sequence} was not done within a minute')


def live(folder: Path) -> None:
    """Write live.gif."""
    with ExitStack() as stack:
        process = stack.enter_context(subprocess.Popen(
            [*FORCECAL, 'live', '--sim', '--port', '0'], stdout=subprocess.PIPE, text=True))
        stack.callback(process.send_signal, signal.SIGINT)
        assert process.stdout is not None
        address = re.search(r'http://\S+', process.stdout.readline())
        page = stack.enter_context(browser(folder / 'browser'))
        page.size(WIDTH, HEIGHT)
        assert address is not None
        page.open(address[0])
        page.until('document.getElementById("wrench.2").textContent > 100', 300.0)
        time.sleep(3.0)  # the sequencer compares noise with that at rest
        film = frames(page, 'calibrate')
        time.sleep(3.0)
        film += frames(page, 'contact')
    palette = film[-1].quantize(COLOURS)
    film = [one.resize((one.width * 3 // 4, one.height * 3 // 4)).quantize(
        COLOURS, palette=palette, dither=Image.Dither.NONE) for one in film]
    film[0].save(ROOT / 'docs' / 'live.gif', save_all=True, append_images=film[1:], loop=0,
                 duration=round(1000 * SHOWN_S), optimize=True)


def report(folder: Path) -> None:
    """Write report.png."""
    for arguments in (['sample', 'rig', '-o', 'sample'],
                      ['diagnose', 'sample/late', '--rig', 'nominal', '-o', 'gap', '--quiet']):
        subprocess.run([*FORCECAL, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    with browser(folder / 'browser') as page:
        page.size(WIDTH, HEIGHT)
        page.open(f'file://{folder}/gap/report.html')
        page.until('document.querySelectorAll(".live .main-svg").length > 0')
        bottom = page.run('document.querySelector(".said").getBoundingClientRect().bottom')
        image = seen(page, int(bottom) + 12)
    image.quantize(64).save(ROOT / 'docs' / 'report.png', optimize=True)


if __name__ == '__main__':
    for make in {'live': [live], 'report': [report]}.get(''.join(sys.argv[1:]), [live, report]):
        with tempfile.TemporaryDirectory() as place:
            make(Path(place))
