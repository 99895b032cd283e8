"""Serves the page of ``forcecal live`` to browsers of this machine.

It listens on 127.0.0.1. A page of somebody else that is open in the same browser can send requests
there, too, but neither read an answer nor know the token without which nothing is begun; one that
gives its own name the address 127.0.0.1 is told by that name, and refused.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import json
import secrets
from threading import Event, Semaphore, Thread

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.nodes.live_view import LiveView

HERE = '127.0.0.1'

NAMES = (HERE, 'localhost')
"""What a browser of this machine calls it, with any port: one may have been forwarded by ssh."""

PERIOD = 0.1
"""Between two messages to a page [s]: a delay that a person hardly notices."""

READERS = 16
"""Pages that may be open at once; each costs a thread."""

SLOW = 30.0
"""A browser that takes nothing for so long has gone [s]."""


class LivePage(ThreadingHTTPServer):
    """
    Serves the page, and what changes on it as server-sent events.

    Parameters
    ----------
    port : int
        0: any that is free.

    Attributes
    ----------
    token, nonce : str
        Who knows the token may begin a sequence; what bears the nonce may run on the page.

    Raises
    ------
    ConfigError
        The port is taken, or not for this user.
    """

    daemon_threads = True

    def __init__(self, port: int) -> None:
        self.token, self.nonce = secrets.token_urlsafe(), secrets.token_urlsafe()
        self.view: LiveView | None = None
        self.page = b''
        self.ended, self.readers = Event(), Semaphore(READERS)
        try:
            super().__init__((HERE, port), _Reader)
        except OSError as error:
            raise ConfigError(f'port {port} of {HERE} cannot be listened on ({error.strerror}); '
                              '--port 0 takes any that is free') from error

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f'http://{HERE}:{self.server_port}/'

    @contextmanager
    def showing(self, view: LiveView, page: str) -> Iterator[None]:
        """Serve within this context; the scripts of the page bear ``nonce``."""
        self.view, self.page = view, page.encode()
        thread = Thread(target=self.serve_forever, kwargs={'poll_interval': PERIOD}, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self.ended.set()
            self.shutdown()
            thread.join()

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a browser that went away."""


class _Reader(BaseHTTPRequestHandler):
    """One connection of a browser."""

    server: LivePage
    timeout = SLOW

    def do_GET(self) -> None:
        """Answer with the page, or with events for as long as it is open."""
        if not self._own():
            self._end(HTTPStatus.FORBIDDEN)
        elif self.path == '/':
            self._begin(HTTPStatus.OK, 'text/html; charset=utf-8')
            self.wfile.write(self.server.page)
        elif self.path == '/events' and self.server.readers.acquire(blocking=False):
            try:
                self._tell()
            except OSError:
                return
            finally:
                self.server.readers.release()
        elif self.path == '/events':
            self._end(HTTPStatus.SERVICE_UNAVAILABLE)
        else:
            self._end(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Begin a sequence of the simulated rig, or end it, for who has the page's token."""
        given = self.headers.get('X-Token', '').encode()
        if not self._own() or not secrets.compare_digest(given, self.server.token.encode()):
            self._end(HTTPStatus.FORBIDDEN)
        elif self.server.view is not None and self.server.view.ask(self.path.strip('/')):
            self._end(HTTPStatus.NO_CONTENT)
        else:
            self._end(HTTPStatus.NOT_FOUND)

    def log_message(self, *args: object) -> None:
        """Print nothing for each request."""

    def _own(self) -> bool:
        """Tell whether the browser asked for this machine by its name."""
        return self.headers.get('Host', '').rpartition(':')[0] in NAMES

    def _begin(self, status: HTTPStatus, kind: str) -> None:
        self.send_response(status)
        self.send_header('Content-Type', kind)
        self.send_header('Cache-Control', 'no-store')
        self.send_header('X-Content-Type-Options', 'nosniff')
        self.send_header('Content-Security-Policy', (
            "default-src 'none'; frame-ancestors 'none'; connect-src 'self'; style-src "
            f"'unsafe-inline'; script-src 'nonce-{self.server.nonce}'"))
        self.end_headers()

    def _end(self, status: HTTPStatus) -> None:
        self._begin(status, 'text/plain')

    def _tell(self) -> None:
        self._begin(HTTPStatus.OK, 'text/event-stream')
        last = self.headers.get('Last-Event-ID', '')
        since = int(last) if last.isdigit() else 0
        while self.server.view is not None:
            now = self.server.view.snapshot(since)
            since = now['count']
            self.wfile.write(f'id: {since}\ndata: {json.dumps(now)}\n\n'.encode())
            if self.server.ended.wait(PERIOD):
                return
