"""What every node's main does alike: start, spin, stop on a signal, say what went wrong."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import gc
import os
import signal
import sys
from types import FrameType
from typing import Protocol, runtime_checkable

from forcecal_ros.errors import ConfigError, ForcecalError
from forcecal_ros.nodes.log_folder import choose_log_folder
from forcecal_ros.schema import Parameter
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidNodeNameException, InvalidTopicNameException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

TURN = 0.02
"""The executor comes back that often to look for signals [s]."""

GRACE = 0.5
"""How long a node may take to come to rest after the first signal [s]."""

OUTPUT = QoSProfile(depth=10, history=HistoryPolicy.KEEP_LAST,
                    reliability=ReliabilityPolicy.RELIABLE)
SENSOR = QoSProfile(depth=200, history=HistoryPolicy.KEEP_LAST,
                    reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, history=HistoryPolicy.KEEP_LAST,
                     reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)

STEADY = Clock(clock_type=ClockType.STEADY_TIME)

RCLError = rclpy_implementation.RCLError

SECOND = 1_000_000_000
"""One second [ns]."""

EXECUTOR = Parameter(
    'executor', 'events',
    'Executor: events is two to three times cheaper a message, single is the plain one',
    choices=('events', 'single'))


@runtime_checkable
class Stoppable(Protocol):
    """A node that wants to come to rest before it goes."""

    def stop(self) -> None:
        """Begin to come to rest."""

    @property
    def at_rest(self) -> bool:
        """Whether it may go."""


class Interrupt:
    """
    Counts SIGINT and SIGTERM instead of tearing the node's publishers down at once.

    Attributes
    ----------
    count : int
    running : bool
        False while the node is being made, which the first signal ends there and then.
    """

    def __init__(self) -> None:
        self.count, self.running = 0, False
        self._before = {number: signal.signal(number, self._note)
                        for number in (signal.SIGINT, signal.SIGTERM)}

    def restore(self) -> None:
        """Give the signals back to whom they were."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
        if not self.running:
            raise KeyboardInterrupt
        if self.count > 2:
            sys.exit(1)


def run(name: str, make_node: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """
    Run a node until a signal.

    Parameters
    ----------
    name : str
        For messages before there is a node.
    make_node : callable
    arguments : sequence of str, optional
        Command line; ``sys.argv`` where none is given.

    Returns
    -------
    int
        Exit status: 0 after a signal, 1 after an error the user can mend, 2 for wrong usage.
    """
    arguments = list(sys.argv if arguments is None else arguments)
    try:
        extra = remove_ros_args(arguments)[1:]
    except RCLError as error:
        print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr)
        return 2
    if extra:
        print(f'{name}: unknown argument {extra[0]}; parameters go behind --ros-args, as '
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
    except ForcecalError as error:
        print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr)
        return 1
    except (InvalidNodeNameException, InvalidTopicNameException) as error:
        print(f'{name}: {" ".join(str(error).split())}', file=sys.stderr)
        return 1
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        # rclpy's errors about a context that was shut down behind its back share no base class.
        if rclpy.ok() or not type(error).__module__.startswith('rclpy'):
            raise
        return 0
    finally:
        rclpy.try_shutdown()
        interrupt.restore()
    return 0


@contextmanager
def starting(name: str) -> Iterator[None]:
    """
    Start ROS 2 with a folder for its logs.

    Raises
    ------
    ConfigError
        It refuses.
    """
    choose_log_folder(name)
    try:
        yield
    except RCLError as error:
        why = f'ROS 2 refuses to start: {error}'
        if os.environ.get('ROS_SECURITY_ENABLE') == 'true':
            why += '; ROS_SECURITY_ENABLE is true, which wants a DDS built with security, and keys'
        raise ConfigError(why) from error


def _executor(node: Node) -> Executor:
    if node.get_parameter(EXECUTOR.name).value == 'events':
        return EventsExecutor()
    return SingleThreadedExecutor()


def _spin(node: Node, interrupt: Interrupt) -> None:
    executor = _executor(node)
    executor.add_node(node)
    # What lives until the end need not be walked by every collection.
    gc.collect()
    gc.freeze()
    try:
        while not interrupt.count and rclpy.ok():
            executor.spin_until_future_complete(Future(), timeout_sec=TURN)
        if rclpy.ok() and isinstance(node, Stoppable):
            _come_to_rest(node, executor, interrupt)
    finally:
        executor.shutdown()


def _come_to_rest(node: Stoppable, executor: Executor, interrupt: Interrupt) -> None:
    node.stop()
    end = STEADY.now().nanoseconds + int(GRACE * 1e9)
    while not node.at_rest and interrupt.count < 2 and STEADY.now().nanoseconds < end:
        executor.spin_until_future_complete(Future(), timeout_sec=TURN)
