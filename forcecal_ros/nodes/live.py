"""The page of ``forcecal live``: what nodes measure, estimate and do, in a browser.

It listens on 127.0.0.1. A page of another origin in the same browser can send requests there, but
can neither read an answer nor know the token without which no sequence starts. A page that gives
its own name the address 127.0.0.1 is refused by that name.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import json
from math import isfinite
import secrets
from threading import Event, Lock, Thread
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from forcecal_ros.core.errors import ConfigError, ForcecalError
from forcecal_ros.core.extras import program
from forcecal_ros.core.quantity import quantity
from forcecal_ros.diagnose.dataset import CHANNELS, STAGES
from forcecal_ros.io.calibration_file import parse
from forcecal_ros.motion.plan import SEQUENCES
from forcecal_ros.nodes.client import NODES, sequence_request, WORDS
from forcecal_ros.nodes.inputs import plain_input
from forcecal_ros.nodes.runtime import LATCHED, OUTPUT, SECOND, STEADY
from forcecal_ros.nodes.wire import Inbox, Sample
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

SHOWN = {'wrench': 'wrench', 'contact': 'observer/contact_wrench',
         'inertial': 'observer/inertial_wrench'}
"""Name in a row, and topic; the first may be called otherwise."""

Extremes = tuple[list[float], list[float]] | None


class LiveView:
    """
    Follows the nodes of one robot, for readers in other threads.

    Parameters
    ----------
    namespace : str
        Of the robot's nodes and topics.
    wrench : str
        Topic of the raw wrench, in that namespace if relative.
    simulated : bool
        The robot is the simulated rig, which :meth:`ask` may move.
    """

    def __init__(self, node: Node, namespace: str, wrench: str, simulated: bool) -> None:
        self.simulated = simulated
        self._prefix = f'/{namespace.strip("/")}'.rstrip('/')
        self._node, self._inbox, self._lock = node, Inbox(node), Lock()
        self._requested: deque[str] = deque(maxlen=1)
        self._samples: dict[str, list[Sample]] = {name: [] for name in SHOWN}
        self._last: dict[str, int] = {}
        self._topics: dict[str, str] = {}
        # bins that a page may ask for: half a minute, as long as a person
        # remembers what it looked like
        self._rows: deque[list[Any]] = deque(maxlen=750)
        self._count, self._phase, self._reason, self._answer, self._result = 0, '', '', '', ''
        self._states: dict[str, tuple[int, DiagnosticStatus]] = {}
        for name, topic in {**SHOWN, 'wrench': wrench}.items():
            self._topics[name] = self._named(topic)
            one = plain_input(name, self._topics[name], WrenchStamped)
            self._inbox.subscribe(WrenchStamped, one.topic, one.taker(self._samples[name].append))
        for name, topic, take in (('phase', 'sequencer/phase', self._on_phase),
                                  ('diagnostics', '/diagnostics', self._on_diagnostics)):
            self._topics[name] = self._named(topic)
            node.create_subscription(DiagnosticArray, self._topics[name], take, OUTPUT)
        node.create_subscription(
            String, self._named('sequencer/calibration'), self._on_calibration, LATCHED)
        # bin: of what arrives within this time the least and the greatest are shown [s]: 25
        # pictures a second are a film
        node.create_timer(0.04, self._on_bin, clock=STEADY)
        if simulated:
            self._set = node.create_client(SetParameters, 'sequencer/set_parameters')
            self._move = {verb: node.create_client(Trigger, f'sequencer/{verb}')
                          for verb in ('start', 'abort')}

    def close(self) -> None:
        """Free what the node does not know of."""
        self._inbox.close()

    def snapshot(self, since: int) -> dict[str, Any]:
        """
        Return what is so now, and the bins after number ``since``.

        Returns
        -------
        dict
            ``rows``: of each bin its number, the phase, and of raw, contact and inertial wrench
            the least and the greatest of six numbers [N, N m], or None. ``topics``: name and age
            of the newest message [s], None before the first. ``nodes``: name, level, message and
            age of the newest report.
        """
        with self._lock:
            now = STEADY.now().nanoseconds
            # a node that reports once a second and has not for 5 s is silent, not just late
            nodes = [{'name': name, 'age': round((now - at) / SECOND, 1), **(
                {'level': WORDS[status.level], 'message': status.message}
                if now - at < 5.0 * SECOND else
                {'level': 'stale', 'message': f'{name} is silent'})}
                     for name, (at, status) in self._states.items()]
            topics = {name: {'topic': topic, 'age': None if name not in self._last else round(
                (now - self._last[name]) / SECOND, 1)} for name, topic in self._topics.items()}
            return {'rows': [row for row in self._rows if row[0] > since], 'count': self._count,
                    'topics': topics, 'phase': self._phase,
                    'reason': self._reason or self._result * (self._phase == 'done'),
                    'answer': self._answer,
                    'nodes': sorted(nodes, key=lambda one: NODES.index(one['name'])),
                    'gap': self._gap(), 'late': self._late()}

    def ask(self, what: str) -> bool:
        """Note a wish of a reader, a sequence or ``abort``; False: there is no such wish."""
        known = self.simulated and what in (*SEQUENCES, 'abort')
        if known:
            self._requested.append(what)
        return known

    def _named(self, topic: str) -> str:
        return topic if topic.startswith('/') else f'{self._prefix}/{topic}'

    def _on_bin(self) -> None:
        self._inbox.drain()
        with self._lock:
            self._count += 1
            self._rows.append([self._count, self._phase, *map(_extremes, self._samples.values())])
            now = STEADY.now().nanoseconds
            self._last |= {name: now for name, samples in self._samples.items() if samples}
        for samples in self._samples.values():
            samples.clear()
        if self._requested:
            self._begin(self._requested.pop())

    def _on_phase(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        with self._lock:
            self._last['phase'] = STEADY.now().nanoseconds
            self._phase = status.message
            self._reason = next((p.value for p in status.values if p.key == 'reason'), '')

    def _on_calibration(self, message: String) -> None:
        with suppress(ForcecalError):  # of another version
            mass = parse(message.data, 'sequencer/calibration').mass
            self._result = (f'Calibrated: mass {quantity(float(mass), float(mass.std), "kg")}'
                            + f'; keep it with {program()} save' * (not self.simulated))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        with self._lock:
            self._last['diagnostics'] = STEADY.now().nanoseconds
            for status in message.status:
                place, _, name = f'/{status.name}'.rpartition('/')
                if place == self._prefix and name in NODES:
                    self._states[name] = STEADY.now().nanoseconds, status

    def _gap(self) -> dict[str, Any] | None:
        """Return the gap node's word: excess by stage and channel [noise RMS]; None: no node."""
        if 'gap' not in self._states:
            return None
        values = {pair.key: pair.value for pair in self._states['gap'][1].values}
        stages: dict[str, dict[str, float]] = {stage: {} for stage in STAGES}
        for channel in CHANNELS:
            excess = _finite(values.get(f'{channel.name} [noise RMS]', ''))
            if excess is not None:
                stages[channel.stage][channel.name] = excess
        return {'stage': values.get('stage', ''), 'first': values.get('first stage', ''),
                'stages': {stage: found for stage, found in stages.items() if found}}

    def _late(self) -> float:
        """Return how many commands came late to a simulated rig."""
        values = self._states['sim'][1].values if 'sim' in self._states else ()
        return next((_finite(p.value) or 0.0 for p in values if p.key == 'commands late'), 0.0)

    def _begin(self, what: str) -> None:
        """Ask the sequencer; its answer is shown."""
        if what == 'abort':
            self._call(self._move['abort'], Trigger.Request())
        else:
            self._call(self._set, sequence_request(what))

    def _call(self, client: Any, request: object) -> None:
        def answered(future: Future) -> None:
            response = future.result()
            if client is self._set:
                response = response.results[0]
                if response.successful:
                    self._call(self._move['start'], Trigger.Request())
            self._answer = getattr(response, 'message', '') or getattr(response, 'reason', '')

        if client.service_is_ready():
            client.call_async(request).add_done_callback(answered)
        else:
            self._answer = 'the sequencer is not up yet; try again in a moment'


def _extremes(samples: list[Sample]) -> Extremes:
    """Return the least and the greatest of each number, to what a picture shows; None: none."""
    columns = [[x for x in column if isfinite(x)] for column in zip(*(
        sample.values for sample in samples))]
    if not columns or not all(columns):
        return None
    return [round(min(c), 4) for c in columns], [round(max(c), 4) for c in columns]


def _finite(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if isfinite(value) else None


HERE = '127.0.0.1'

NAMES = (HERE, 'localhost')
"""What a browser of this machine calls it, with any port: one may have been forwarded by ssh."""

PERIOD = 0.1
"""Between two messages to a page [s]: a delay that a person hardly notices."""


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
        self.ended = Event()
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
    timeout = 30.0  # a browser that takes nothing for so long has gone [s]

    def do_GET(self) -> None:
        """Answer with the page, or with events for as long as it is open."""
        if not self._own():
            self._end(HTTPStatus.FORBIDDEN)
        elif self.path == '/':
            self._begin(HTTPStatus.OK, 'text/html; charset=utf-8')
            self.wfile.write(self.server.page)
        elif self.path == '/events':
            with suppress(OSError):  # of a browser that went away
                self._tell()
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
        """Return whether the browser requested this machine by its name."""
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
