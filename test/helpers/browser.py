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

PATIENCE = 30.0
"""For an answer; a loaded machine is slow [s]."""

CHROMIUM = next(filter(None, map(shutil.which, (
    'chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable'))), None)


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
