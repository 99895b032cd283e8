"""A real browser without a window, asked over its own pipe."""

import base64
from contextlib import contextmanager
from fcntl import F_DUPFD, fcntl
import json
import os
import select
import shutil
import subprocess
import time

import pytest

PATIENCE = 30.0
"""For an answer; a loaded machine is slow [s]."""

CHROMIUM = next(filter(None, map(shutil.which, (
    'chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable'))), None)

NEEDED = pytest.mark.skipif(not CHROMIUM,
                            reason='requires Chromium or Chrome, which is not installed')
"""Of tests that show a page."""

CUT = """[...document.querySelectorAll(
    'p, td, dd, pre span, caption, img, canvas, svg[role], button, figure, summary')]
    .filter(e => !e.closest('.live'))  // a plot fits by itself, its hidden parts need not
    .map(e => [e, e.getBoundingClientRect()])
    .filter(([e, r]) => r.width && (r.right > innerWidth || r.left < 0
        || parseFloat(getComputedStyle(e).fontSize) < 11 || e.naturalWidth > 1.7 * r.width))
    .map(([e]) => e.tagName + ' ' + e.textContent.slice(0, 30))"""
"""What is beyond the edges of the window, or too small to read; pictures are drawn for 575 px."""


class Page:
    """One page of a browser."""

    def __init__(self, write, read):
        self._write, self._read, self._left, self._count = write, read, b'', 0
        self._session = None
        target = self._ask('Target.createTarget', url='about:blank')['targetId']
        self._session = self._ask('Target.attachToTarget', targetId=target,
                                  flatten=True)['sessionId']

    def open(self, address):
        self._ask('Page.navigate', url=address)
        self.until('document.readyState === "complete"')

    def run(self, script):
        """Return what a script says, plain values."""
        found = self._ask('Runtime.evaluate', expression=script, returnByValue=True)
        assert 'exceptionDetails' not in found, found
        return found['result'].get('value')

    def until(self, script, timeout=PATIENCE):
        """Wait until a script says something true, and return it."""
        end = time.monotonic() + timeout
        while not (value := self.run(script)):
            assert time.monotonic() < end, (
                f'{script}: not within {timeout} s; {self.run("document.body.innerText")}')
            time.sleep(0.05)
        return value

    def size(self, width, height=900, dark=False):
        self._ask('Emulation.setDeviceMetricsOverride', width=width, height=height,
                  deviceScaleFactor=1, mobile=False)
        self._ask('Emulation.setEmulatedMedia', features=[
            {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}])

    def mouse(self, kind, x, y, **more):
        """Move the mouse, or press or release its left button."""
        self._ask('Input.dispatchMouseEvent', type=f'mouse{kind}', x=x, y=y, **(
            {} if kind == 'Moved' else {'button': 'left', 'clickCount': 1}), **more)

    def drag(self, start, end):
        """Press at one place, and release at another."""
        self.mouse('Moved', *start)
        self.mouse('Pressed', *start)
        self.mouse('Moved', *end, buttons=1)
        self.mouse('Released', *end)

    def click(self, x, y):
        self.drag((x, y), (x, y))

    def picture(self, whole=False):
        """Return what is seen as PNG."""
        return base64.b64decode(self._ask(
            'Page.captureScreenshot', captureBeyondViewport=whole)['data'])

    def _ask(self, method, **parameters):
        self._count += 1
        message = {'id': self._count, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._write, json.dumps(message).encode() + b'\0')
        while True:
            answer = self._next()
            if answer.get('id') == self._count:
                assert 'error' not in answer, answer
                return answer['result']

    def _next(self):
        end = time.monotonic() + PATIENCE
        while b'\0' not in self._left:
            assert select.select([self._read], [], [], end - time.monotonic())[0], 'no answer'
            self._left += os.read(self._read, 1 << 20)
        message, _, self._left = self._left.partition(b'\0')
        return json.loads(message)


def cut_on_a_phone(path, folder):
    """Return what of a page is cut on a phone, light and dark, with all its parts open."""
    found = []
    with browser(folder) as page:
        for dark in (False, True):
            page.size(400, 900, dark)
            page.open(f'file://{path}')
            page.run('document.querySelectorAll("details").forEach(one => { one.open = true; })')
            page.until('[...document.querySelectorAll(".live")].every(one => one.matches('
                       '".zooms *") && one.querySelector(".main-svg").getBoundingClientRect()'
                       '.right <= innerWidth)')
            found += page.run(CUT)
            found += ['the page'] * page.run('document.documentElement.scrollWidth > 400')
    return found


def _moved(descriptor):
    moved = fcntl(descriptor, F_DUPFD, 10)
    os.close(descriptor)
    return moved


@contextmanager
def browser(folder):
    """Run Chromium with its files in ``folder``, and give a page of it."""
    theirs, write = os.pipe()
    read, answers = os.pipe()
    # out of the way of 3 and 4, where the browser looks for them
    theirs, answers = (_moved(one) for one in (theirs, answers))
    command = (f'exec {CHROMIUM} --headless --no-sandbox --disable-gpu --user-data-dir={folder} '
               f'--no-first-run --disable-background-networking --remote-debugging-pipe '
               f'3<&{theirs} 4>&{answers}')
    process = subprocess.Popen(['bash', '-c', command], pass_fds=(theirs, answers),
                               stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL)
    os.close(theirs)
    os.close(answers)
    try:
        yield Page(write, read)
    finally:
        os.close(write)
        process.terminate()
        process.wait()
        os.close(read)
