"""The life of a node: start, spin, transitions, services, diagnostics, stop on a signal."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from functools import partial
import gc
from itertools import pairwise
from math import copysign, isfinite
import os
from pathlib import Path
import signal
import sys
import tempfile
from textwrap import fill
from types import FrameType
from typing import Any, Protocol, runtime_checkable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from forcecal_ros.core.errors import ConfigError, ForcecalError, with_id
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.core.safe_yaml import load_yaml
from forcecal_ros.core.schema import yaml_value
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import (
    InvalidNodeNameException,
    InvalidTopicNameException,
    ParameterException,
)
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.time import Time
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger

SIGNAL_CHECK = 0.02
"""Period in which a spinning executor returns to check for signals: a delay that is not noticed
[s]."""

OUTPUT = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""QoS of commands and results: a reliable publisher serves any subscription."""

STREAM = QoSProfile(depth=200, reliability=ReliabilityPolicy.RELIABLE)
"""QoS of what is published at 1 kHz: a recorder may be late by 0.2 s and loses nothing."""

SENSOR = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
"""QoS of sensor topics: best effort, which any publisher serves; 0.2 s at 1 kHz."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of results, of which late subscriptions get the last one too."""

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
"""The clock of timeouts, which is never set."""

SYSTEM = Clock(clock_type=ClockType.SYSTEM_TIME)
"""The computer's clock, for any use_sim_time."""

RCLError = rclpy_implementation.RCLError

SECOND = 1_000_000_000
"""One second [ns]."""

EXECUTOR = Parameter(
    'executor', 'events',
    'Executor of the node; events needs at most half the processor time of single',
    choices=('events', 'single'))


@runtime_checkable
class Stoppable(Protocol):
    """A node that has to come to rest before it ends."""

    def come_to_rest(self, spin: Callable[[], object]) -> None:
        """Come to rest, handling what arrives by ``spin`` meanwhile."""

    def halt(self) -> None:
        """Come to rest now, after an error: no callback runs any more."""


class Interrupt:
    """
    Counts SIGINT, SIGTERM, SIGHUP, whose usual handlers would end the node's publishers at once.

    The second may be an impatient hand, or a launcher beside a terminal, and cuts no stop short;
    the third ends the process as it stands. A SIGHUP that is ignored, as under nohup, stays so.

    Attributes
    ----------
    running : bool
        False while the node is being made, which the first signal ends at once.
    """

    def __init__(self) -> None:
        self.count, self.running = 0, False
        self._before = {number: signal.signal(number, self._note)
                        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
                        if number != signal.SIGHUP
                        or signal.getsignal(number) is not signal.SIG_IGN}

    def restore(self) -> None:
        """Restore the handlers of before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
        if not self.running:
            raise KeyboardInterrupt
        if self.count > 2:
            sys.exit(1)


def run(name: str, make_node: Callable[[], Node], table: Sequence[Parameter] = (),
        arguments: Sequence[str] | None = None) -> int:
    """
    Run a node until a signal.

    Parameters
    ----------
    name : str
        For messages before there is a node.
    table : sequence of Parameter
        Those that ``--help`` lists.
    arguments : sequence of str, optional
        Command line, by default ``sys.argv``.

    Returns
    -------
    int
        Exit status: 0 after a signal or help, 1 after an error that the user can fix, 2 for wrong
        usage.
    """
    arguments = list(sys.argv if arguments is None else arguments)
    try:
        check_parameter_files(arguments)
        extra = remove_ros_args(arguments)[1:]
    except (ConfigError, RCLError) as error:
        return _refused(name, error, 2)
    except KeyboardInterrupt:
        return 0
    if extra and extra[0] in ('-h', '--help'):
        print(usage(name, table))
        return 0
    if extra:
        print(f'{name}: unknown argument {extra[0]}; give parameters after --ros-args, as '
              '-p name:=value or --params-file FILE', file=sys.stderr)
        return 2
    interrupt = Interrupt()
    try:
        with starting(name):
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            node = make_node()
        interrupt.running = True
        try:
            _spin(node, interrupt)
        finally:
            node.destroy_node()
    except (ForcecalError, InvalidNodeNameException, InvalidTopicNameException) as error:
        return _refused(name, error, 1)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        # rclpy's errors about a context that something else has shut down share no base class.
        if rclpy.ok() or not type(error).__module__.startswith('rclpy'):
            raise
        return 0
    finally:
        rclpy.try_shutdown()
        interrupt.restore()
    return 0


def _refused(name: str, error: Exception, status: int) -> int:
    """Print in one line why a node does not run; return the exit status."""
    line = with_id(error) if isinstance(error, ForcecalError) else ' '.join(str(error).split())
    print(f'{name}: {line}', file=sys.stderr)
    return status


def check_parameter_files(arguments: Sequence[str]) -> None:
    """
    Refuse parameter files that ROS 2 cannot read, or in which it would drop a value.

    Raises
    ------
    ConfigError
        With the file, and the line or the parameter.
    """
    for name in (after for flag, after in pairwise(arguments) if flag == '--params-file'):
        try:
            document = load_yaml(Path(name).read_bytes(), name, largest=1 << 24)
        except OSError as error:
            raise ConfigError(f'{name}: cannot be read ({error.strerror}); name an existing '
                              'parameter file') from error
        twice = [key for key, count in Counter(_keys(document)).items() if count > 1]
        if twice:
            raise ConfigError(f'{name}: {twice[0].partition("ros__parameters.")[2]} is given '
                              'twice, with a dot and in its group; keep one')


def _keys(document: Any, prefix: str = '') -> Iterator[str]:
    """Yield the keys of all values, those of the groups around them joined by dots."""
    if not isinstance(document, dict):
        yield prefix[1:]
        return
    for key, value in document.items():
        yield from _keys(value, f'{prefix}.{key}')


def usage(name: str, table: Sequence[Parameter]) -> str:
    """Return the help of a node: how it is called, and its parameters with their defaults."""
    return '\n'.join([
        (f'usage: {name} [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r TOPIC:=TOPIC] '
         '[-r __ns:=/NAME]]'), '', 'parameters:',
        *(f'  {row.name} (default {yaml_value(row.default)})\n'
          + fill(row.text, 95, initial_indent=' ' * 8, subsequent_indent=' ' * 8)
          for row in table)])


@contextmanager
def starting(name: str) -> Iterator[None]:
    """
    Start ROS 2 within this context, with a folder for its logs.

    Raises
    ------
    ConfigError
        ROS 2 does not start.
    """
    choose_log_folder(name)
    try:
        yield
    except RCLError as error:
        why = f'ROS 2 refuses to start: {error}'
        if os.environ.get('ROS_SECURITY_ENABLE') == 'true':
            why += '; ROS_SECURITY_ENABLE is true: it requires a DDS built with security, and keys'
        raise ConfigError(why) from error


def _spin(node: Node, interrupt: Interrupt) -> None:
    events = node.get_parameter(EXECUTOR.name).value == 'events'
    executor = EventsExecutor() if events else SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        executor.spin_until_future_complete(Future(), timeout_sec=SIGNAL_CHECK)

    # Objects that live until the end need not be searched in every garbage collection.
    gc.collect()
    gc.freeze()
    try:
        while not interrupt.count and rclpy.ok():
            spin()
        if rclpy.ok() and isinstance(node, Stoppable):
            node.come_to_rest(spin)
    except Exception:
        if rclpy.ok() and isinstance(node, Stoppable):
            node.halt()
        raise
    finally:
        executor.shutdown()


def choose_log_folder(name: str) -> None:
    """
    Set another folder where the usual one cannot be written to, and print a note.

    Parameters
    ----------
    name : str
        Of the program, for the note.
    """
    usual = Path(os.environ.get('ROS_LOG_DIR')
                 or Path(os.environ.get('ROS_HOME') or '~/.ros') / 'log')
    try:
        usual = usual.expanduser()
        usual.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=usual):
            return
    except (OSError, RuntimeError):  # the latter where the home is unknown
        os.environ['ROS_LOG_DIR'] = instead = tempfile.mkdtemp(prefix='ros_log_')
        print(f'{name}: note: {usual} cannot be written to; logs go to {instead}',
              file=sys.stderr)


class ManagedNode(LifecycleNode):
    """A LifecycleNode; in rclpy's own, such a request ends the process with RCLError."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = _refusing(service.callback)

    def end_publishers(self) -> None:
        """End all that publish only while the node is active."""
        for publisher in list(self.publishers):
            if isinstance(publisher, LifecyclePublisher):
                self.destroy_lifecycle_publisher(publisher)


def _refusing(change: Callable[..., Any]) -> Callable[..., Any]:
    def on_request(request: ChangeState.Request, response: ChangeState.Response
                   ) -> ChangeState.Response:
        try:
            change(request, response)
        except RCLError:
            response.success = False
        return response

    return on_request


def answering(act: Callable[[], str], refused: Callable[[str], None] | None = None
              ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    """
    Make the callback of a Trigger service of a function that returns a sentence, or raises.

    Parameters
    ----------
    refused : callable, optional
        Called with the sentence of a :class:`ForcecalError`.
    """
    def on_request(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = act(), True
        except ForcecalError as error:
            response.message, response.success = with_id(error), False
            if refused is not None:
                refused(response.message)
        return response

    return on_request


LEVELS = {'ok': DiagnosticStatus.OK, 'warn': DiagnosticStatus.WARN,
          'error': DiagnosticStatus.ERROR, 'stale': DiagnosticStatus.STALE}

NO_NAMESPACE = 'robot'
"""Hardware of a node without a namespace; in one, the namespace is the robot's name."""


def diagnostic_array(node: Node, part: str, level: str, message: str,
                     values: Mapping[str, object], stamp: Time | None = None) -> DiagnosticArray:
    """
    Build a DiagnosticArray of one status.

    Parameters
    ----------
    part : str
        Of the node, for the name of the status; empty for all of it.
    level : str
        ``ok``, ``warn``, ``error`` or ``stale``.
    values : mapping
        Published as text; floats with four significant digits.
    stamp : Time, optional
        By default now.
    """
    name = node.get_fully_qualified_name().lstrip('/') + (f': {part}' if part else '')
    status = DiagnosticStatus(
        level=LEVELS[level], name=name, message=message,
        hardware_id=node.get_namespace().strip('/') or NO_NAMESPACE,
        values=[KeyValue(key=key, value=f'{value:.4g}' if isinstance(value, float)
                         else str(value)) for key, value in values.items()])
    array = DiagnosticArray(status=[status])
    array.header.stamp = (stamp or node.get_clock().now()).to_msg()
    return array


class Waiting:
    """Logs what a node waits for, once, when it has waited from one call to the next."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._what, self._calls = '', 0

    def of(self, what: str) -> None:
        """Note what is waited for now; empty: nothing."""
        self._what, self._calls = what, self._calls + 1 if what == self._what else 1
        if what and self._calls == 2:
            self._node.get_logger().info(f'waiting for {what}')


live_parameter = partial(Parameter, live=True)
"""A parameter that may be set while the node runs."""


def declare(node: Node, table: Iterable[Parameter],
            check: Callable[[dict[str, Any]], object] | None = None) -> None:
    """
    Declare a table, so that ``ros2 param describe`` reads like a manual.

    Parameters
    ----------
    check : callable, optional
        As of :func:`refuse_changes`; called with changes that every row by itself allows.

    Raises
    ------
    ConfigError
        A value given at start is of another type, out of range or none of the choices, or it is
        of a parameter that the node does not have.
    """
    rows = {row.name: row for row in table}
    for row in rows.values():
        try:
            node.declare_parameter(row.name, row.default, _descriptor(row))
        except ParameterException as error:
            given = node._parameter_overrides[row.name].value  # noqa: SLF001 - as below
            raise ConfigError(_explain(row, given)) from error
        _check(row, node.get_parameter(row.name).value)
    _refuse_unknown(node, rows)

    def check_each(changes: dict[str, Any]) -> None:
        for name in changes.keys() & rows.keys():
            _check(rows[name], changes[name])
        if check is not None:
            check(changes)

    refuse_changes(node, check_each)


def values_of(node: Node, table: Iterable[Parameter]) -> dict[str, Any]:
    """Return the values of a declared table by name."""
    return {row.name: node.get_parameter(row.name).value for row in table}


def _refuse_unknown(node: Node, known: Iterable[str]) -> None:
    """Refuse what was given at start to a parameter that the node does not have."""
    given = node._parameter_overrides  # noqa: SLF001 - no public way in rclpy
    # those of qos_overrides are declared when publishers and subscriptions are made
    unknown = [name for name in given
               if not (node.has_parameter(name) or name.startswith('qos_overrides.'))]
    if unknown:
        close = get_close_matches(unknown[0], known, 1)
        raise ConfigError(
            f'unknown parameter {", ".join(unknown)}; '
            + (f'did you mean {close[0]}?' if close else
               f'config/{node.get_name()}.yaml lists all parameters of this node'))


def refuse_changes(node: Node, check: Callable[[dict[str, Any]], object]) -> None:
    """
    Refuse changes for which a function raises a ForcecalError.

    Parameters
    ----------
    check : callable
        Takes the new values, by name, of the parameters that change.
    """
    def on_set(changes: list[RosParameter]) -> SetParametersResult:
        try:
            check({change.name: change.value for change in changes})
        except ForcecalError as error:
            return SetParametersResult(successful=False, reason=with_id(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(on_set)


def _descriptor(row: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=row.text, read_only=not row.live)
    # of a range that is open on one side: beyond any value of a parameter
    low, high = (x if isfinite(x) else copysign(1e9, x) for x in (row.low, row.high))
    bounded = row.row.range()
    if bounded and isinstance(row.default, float):
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif bounded and isinstance(row.default, int):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor


def _check(row: Parameter, value: Any) -> None:
    if row.choices or isinstance(value, float):
        row.row.take(type(row.default), value, f'parameter {row.name}')


def _explain(row: Parameter, given: object) -> str:
    one = row.default[0] if isinstance(row.default, list) else row.default
    kind = 'list of ' * isinstance(row.default, list) + type(one).__name__
    more = [*(['with a decimal point'] if type(one) is float else []), row.row.range()]
    quotes = [f"; write '{word}' in quotes" for word in row.choices
              if word and load_yaml(word, row.name) is given]
    return ', '.join((f'parameter {row.name} is {given!r}, expected a {kind}',
                      *filter(None, more))) + ''.join(quotes)
