"""What a person wants to see of running nodes: wrenches, phase, each node's word, gap by stage."""

from collections import deque
from collections.abc import Callable
from functools import partial
from math import isfinite
from struct import error as StructError
from threading import Lock
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from forcecal_ros.diagnose.dataset import CHANNELS, STAGES
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.runtime import OUTPUT, SECOND, STEADY
from forcecal_ros.nodes.temporary_node import NODES, WORDS
from forcecal_ros.nodes.wire import Reader
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

SHOWN = {'wrench': 'wrench', 'contact': 'observer/contact_wrench',
         'inertial': 'observer/inertial_wrench'}
"""Name in a row, and topic; the first may be called otherwise."""

BIN = 0.04
"""Of what arrives within this time the least and the greatest are shown [s]: 25 pictures a second
are a film."""

KEPT = 750
"""Bins that a page may ask for: half a minute, as long as a person remembers what it looked
like."""

SILENT = 5.0
"""A node that speaks once a second and has not for so long is silent [s], not just late."""

SEQUENCES = ('calibrate', 'contact', 'diagnose')

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
        self._asked: deque[str] = deque(maxlen=1)
        self._samples: dict[str, list[tuple[float, ...]]] = {name: [] for name in SHOWN}
        self._rows: deque[list[Any]] = deque(maxlen=KEPT)
        self._count, self._phase, self._reason, self._answer = 0, '', '', ''
        self._said: dict[str, tuple[int, DiagnosticStatus]] = {}
        for name, topic in {**SHOWN, 'wrench': wrench}.items():
            self._inbox.subscribe(WrenchStamped, self._named(topic), partial(
                self._take, Reader(WrenchStamped), self._samples[name]))
        node.create_subscription(DiagnosticArray, self._named('sequencer/phase'), self._on_phase,
                                 OUTPUT)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, OUTPUT)
        node.create_timer(BIN, self._on_bin, clock=STEADY)
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
            the least and the greatest of six numbers [N, N m], or None.
        """
        with self._lock:
            now = STEADY.now().nanoseconds
            nodes = [{'name': name, 'level': WORDS[status.level], 'message': status.message}
                     if now - at < SILENT * SECOND else
                     {'name': name, 'level': 'stale', 'message': f'{name} has fallen silent'}
                     for name, (at, status) in self._said.items()]
            return {'rows': [row for row in self._rows if row[0] > since], 'count': self._count,
                    'phase': self._phase, 'reason': self._reason, 'answer': self._answer,
                    'nodes': sorted(nodes, key=lambda one: NODES.index(one['name'])),
                    'gap': self._gap(), 'late': self._late()}

    def ask(self, what: str) -> bool:
        """Note a wish of a reader, a sequence or ``abort``; False: there is no such wish."""
        known = self.simulated and what in (*SEQUENCES, 'abort')
        if known:
            self._asked.append(what)
        return known

    def _named(self, topic: str) -> str:
        return topic if topic.startswith('/') else f'{self._prefix}/{topic}'

    def _take(self, read: Reader, into: list[tuple[float, ...]], raw: bytes) -> None:
        try:
            into.append(read(raw).values)
        except StructError:
            return

    def _on_bin(self) -> None:
        self._inbox.drain()
        with self._lock:
            self._count += 1
            self._rows.append([self._count, self._phase, *map(_extremes, self._samples.values())])
        for samples in self._samples.values():
            samples.clear()
        if self._asked:
            self._begin(self._asked.pop())

    def _on_phase(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        with self._lock:
            self._phase = status.message
            self._reason = next((p.value for p in status.values if p.key == 'reason'), '')

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        with self._lock:
            for status in message.status:
                place, _, name = f'/{status.name}'.rpartition('/')
                if place == self._prefix and name in NODES:
                    self._said[name] = STEADY.now().nanoseconds, status

    def _gap(self) -> dict[str, Any] | None:
        """Return the gap node's word: excess by stage and channel [noise RMS]; None: no node."""
        if 'gap' not in self._said:
            return None
        values = {pair.key: pair.value for pair in self._said['gap'][1].values}
        stages: dict[str, dict[str, float]] = {stage: {} for stage in STAGES}
        for channel in CHANNELS:
            excess = _finite(values.get(f'{channel.name} [noise RMS]', ''))
            if excess is not None:
                stages[channel.stage][channel.name] = excess
        return {'stage': values.get('stage', ''), 'first': values.get('first stage', ''),
                'stages': {stage: found for stage, found in stages.items() if found}}

    def _late(self) -> float:
        """Return how many commands came late to a simulated rig."""
        values = self._said['sim'][1].values if 'sim' in self._said else ()
        return next((_finite(p.value) or 0.0 for p in values if p.key == 'commands late'), 0.0)

    def _begin(self, what: str) -> None:
        """Ask the sequencer; its answer is shown."""
        if what == 'abort':
            self._call(self._move['abort'], Trigger.Request(), lambda done: None)
            return
        value = Parameter('sequence', value=what).get_parameter_value()
        self._call(self._set, SetParameters.Request(
            parameters=[ParameterMessage(name='sequence', value=value)]), self._chosen)

    def _chosen(self, response: SetParameters.Response) -> None:
        if response.results[0].successful:
            self._call(self._move['start'], Trigger.Request(), lambda done: None)

    def _call(self, client: Any, request: object, then: Callable[[Any], None]) -> None:
        def answered(future: Future) -> None:
            response = future.result()
            result = response.results[0] if client is self._set else response
            self._answer = getattr(result, 'message', '') or getattr(result, 'reason', '')
            then(response)

        if client.service_is_ready():
            client.call_async(request).add_done_callback(answered)
        else:
            self._answer = 'the sequencer is not up yet; try again in a moment'


def _extremes(samples: list[tuple[float, ...]]) -> Extremes:
    """Return the least and the greatest of each number, to what a picture shows; None: none."""
    columns = [[x for x in column if isfinite(x)] for column in zip(*samples)]
    if not columns or not all(columns):
        return None
    return [round(min(c), 4) for c in columns], [round(max(c), 4) for c in columns]


def _finite(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if isfinite(value) else None
