"""What the sequencer hears: every sample goes to its watch, and into the recording of a run."""

from collections.abc import Callable
from struct import error as StructError
from typing import Any

from forcecal_ros.calibration.sensor_matrix import corrected, SixAxis
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import Monitor, WatchSettings
from forcecal_ros.nodes.collector import Collector
from forcecal_ros.nodes.deadman import Deadman
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.wire import frame_of, JointReader, Reader, Sample, stamp_of
from geometry_msgs.msg import AccelStamped, PoseStamped, Vector3Stamped, WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

ACCELEROMETERS: dict[str, tuple[str, Any, str]] = {
    'raw': ('accelerometer/raw', Vector3Stamped, 'V'),
    'imu': ('imu/data_raw', Imu, 'm/s^2'),
    'accel': ('accel', AccelStamped, 'm/s^2'),
}
"""Topic, type and unit of each source of acceleration."""


def _wrench_reader(six_axis: SixAxis | None) -> Callable[[bytes], Sample]:
    read = Reader(WrenchStamped)
    if six_axis is None:
        return read

    def read_raw(raw: bytes) -> Sample:
        stamp_ns, (fx, fy, fz, nx, ny, nz) = read(raw)
        return Sample(stamp_ns, corrected((fx, fy, fz, nx, ny, nz), six_axis))

    return read_raw


class Sensors:
    """
    The sequencer's sensors.

    Parameters
    ----------
    node : Node
        With the sequencer's parameters.
    inbox : Inbox
    watch, limits : WatchSettings, Limits
    recording : callable
        Says whether samples are to be kept.
    six_axis : SixAxis or None
        Turns the raw channels of the wrench topic into a wrench.

    Attributes
    ----------
    monitor : Monitor
    collector : Collector
    deadman : Deadman
    """

    def __init__(self, node: Node, inbox: Inbox, watch: WatchSettings, limits: Limits,
                 recording: Callable[[], bool], six_axis: SixAxis | None) -> None:
        self._inbox = inbox
        self._recording = recording
        self._heard: dict[str, bytes] = {}
        source = node.get_parameter('accelerometer.source').value
        topics = {'wrench': 'wrench', 'pose': 'current_pose'}
        if source in ACCELEROMETERS:
            topics['accelerometer'] = ACCELEROMETERS[source][0]
        self.collector = Collector(ACCELEROMETERS.get(source, ACCELEROMETERS['raw'])[2],
                                   node.get_parameter('wrench.sign').value)
        self.monitor = Monitor(watch, limits, topics)
        self._hear('wrench', 'wrench', WrenchStamped, _wrench_reader(six_axis),
                   self.monitor.wrench)
        self._hear('pose', 'current_pose', PoseStamped, Reader(PoseStamped), self.monitor.pose)
        if source in ACCELEROMETERS:
            topic, kind, _ = ACCELEROMETERS[source]
            self._hear('accelerometer', topic, kind, Reader(kind), self._on_accelerometer)
        self._hear('optidrive', 'optidrive', JointState,
                   JointReader(node.get_parameter('optidrive.joint').value), None)
        self.deadman = Deadman(inbox, node.get_parameter('motion.deadman_timeout').value)

    def _hear(self, channel: str, topic: str, message_type: Any, read: Any, watch: Any) -> None:
        add, recording, heard = self.collector.add, self._recording, self._heard

        def on_sample(raw: bytes) -> None:
            try:
                sample = read(raw)
            except StructError:
                return
            if sample is None:
                return
            stamp_ns, values = sample
            heard[channel] = raw
            if watch is not None:
                watch(stamp_ns * 1e-9, values)
            if recording():
                add(channel, stamp_ns, values)

        self._inbox.subscribe(message_type, topic, on_sample)

    def _on_accelerometer(self, stamp: float, values: tuple[float, ...]) -> None:
        self.monitor.other('accelerometer', stamp, values)

    def begin_recording(self) -> None:
        """Forget what was recorded; the frames of the newest messages count."""
        self.collector.clear()
        for channel, raw in self._heard.items():
            self.collector.frames[channel] = frame_of(raw)

    @property
    def pose_stamp_ns(self) -> int:
        """Header stamp of the newest pose."""
        return stamp_of(self._heard['pose'])

    @property
    def pose(self) -> tuple[float, ...]:
        """The newest pose, x y z [m] qx qy qz qw."""
        return self.monitor.channels['pose'].values
