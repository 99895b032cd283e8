"""The topics that a motion depends on: sensors for monitor and recording, the dead-man switch."""

from collections.abc import Callable, Iterable
from functools import partial
from struct import error as StructError
from typing import Any, NamedTuple, TypeAlias

from forcecal_ros.core.geometry import matrix_from_quaternion
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import Monitor, WatchSettings
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.pose_source import PoseSource
from forcecal_ros.nodes.runtime import SECOND, STEADY
from forcecal_ros.nodes.wire import frame_of, Sample
from geometry_msgs.msg import AccelStamped, Vector3Stamped
from sensor_msgs.msg import Imu
from std_msgs.msg import Header


class Deadman:
    """
    Monitor of the topic ``deadman``.

    Parameters
    ----------
    timeout : float
        Silence that stops a motion [s]; 0: there is no switch.
    """

    def __init__(self, inbox: Inbox, timeout: float) -> None:
        self._received = 0
        self._timeout = round(timeout * SECOND)
        if self._timeout:
            inbox.subscribe(Header, 'deadman', self._on_deadman)

    def _on_deadman(self, raw: bytes) -> None:
        self._received = STEADY.now().nanoseconds

    def fault(self, steady_ns: int) -> str:
        """Return why to stop, at a time on the steady clock [ns]; empty: there is no reason."""
        silent = steady_ns - self._received
        if not 0 < self._timeout < silent:
            return ''
        if not self._received:
            return 'deadman: nothing received; press the switch'
        return f'deadman: silent for {silent / SECOND:.3f} s'


ACCELEROMETERS: dict[str, tuple[str, Any, str]] = {
    'raw': ('accelerometer/raw', Vector3Stamped, 'V'),
    'imu': ('imu/data_raw', Imu, 'm/s^2'),
    'accel': ('accel', AccelStamped, 'm/s^2'),
}
"""Topic, type and unit of each choice of ``accelerometer.source``."""

Record: TypeAlias = Callable[[str, int, tuple[float, ...]], None]
"""Called with channel, stamp [ns] and values of every sample and command."""


class Input(NamedTuple):
    """
    One topic.

    Attributes
    ----------
    watched : bool
        Whether its silence and its readings may end a motion.
    name : str
        What messages call it; empty: its topic.
    frame_of : callable
        Returns the frame of its readings, of a serialised message.
    """

    channel: str
    topic: str
    message_type: Any
    read: Callable[[bytes], Sample | None]
    watched: bool = True
    name: str = ''
    frame_of: Callable[[bytes], str] = frame_of

    @classmethod
    def of_pose(cls, source: PoseSource) -> 'Input':
        """Return the topic of the pose."""
        return cls('pose', source.topic, source.message_type, source.read, name=source.name,
                   frame_of=source.frame_of)


class Sensors:
    """The topics that a motion depends on, with monitor and dead-man switch."""

    def __init__(self, inbox: Inbox, inputs: Iterable[Input], deadman: Deadman,
                 watch: WatchSettings, limits: Limits, record: Record | None = None) -> None:
        inputs = tuple(inputs)
        self.deadman = deadman
        self.monitor = Monitor(watch, limits, {
            one.channel: one.name or one.topic for one in inputs if one.watched})
        self._record = record
        self._raw: dict[str, bytes] = {}
        self._stamps: dict[str, int] = {}
        self._frame_of = {one.channel: one.frame_of for one in inputs}
        for one in inputs:
            inbox.subscribe(one.message_type, one.topic, self._taker(one))

    def _taker(self, one: Input) -> Callable[[bytes], None]:
        channel, read, record, newest = one.channel, one.read, self._record, self._raw
        stamps = self._stamps
        watch = self._watch_of(channel) if one.watched else None

        def take(raw: bytes) -> None:
            try:
                sample = read(raw)
            except StructError:
                return
            if sample is None:
                return
            stamp_ns, values = sample
            newest[channel], stamps[channel] = raw, stamp_ns
            if watch is not None:
                watch(stamp_ns * 1e-9, values)
            if record is not None:
                record(channel, stamp_ns, values)

        return take

    def _watch_of(self, channel: str) -> Callable[[float, tuple[float, ...]], None]:
        monitor = self.monitor
        return {'wrench': monitor.wrench, 'pose': monitor.pose}.get(
            channel, partial(monitor.other, channel))

    def commanded(self, stamp_ns: int, pose: tuple[float, ...]) -> None:
        """Note a command, x y z [m] qx qy qz qw, with which measured poses are compared."""
        self.monitor.command(stamp_ns * 1e-9, pose)
        if self._record is not None:
            self._record('target', stamp_ns, pose)

    def newest(self, channel: str) -> tuple[float, ...]:
        """Return the newest values of a channel; zero where there is no such channel."""
        found = self.monitor.channels.get(channel)
        return found.values if found is not None else (0.0,)

    def measured_pose(self) -> Pose:
        """Return the pose of a robot at rest, its position averaged over the newest poses."""
        return Pose(self.monitor.mean('pose'), matrix_from_quaternion(self.newest('pose')[3:]))

    @property
    def pose_stamp_ns(self) -> int:
        """Header stamp of the newest pose [ns]."""
        return self._stamps['pose']

    @property
    def frames(self) -> dict[str, str]:
        """The frame_id of the newest message, by channel."""
        return {channel: self._frame_of[channel](raw) for channel, raw in self._raw.items()}
