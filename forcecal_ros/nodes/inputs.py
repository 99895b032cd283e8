"""Topics that nodes read, and their watch: accelerometers, poses by a topic, /tf or joints."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from struct import error as StructError
from typing import Any, NamedTuple, TypeAlias

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import combine, matrix_from_quaternion
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.io.urdf import Description
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import Monitor, WatchSettings
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.nodes.runtime import LATCHED, SECOND, STEADY
from forcecal_ros.nodes.wire import Inbox, JointsReader, Reader, Sample
from forcecal_ros.observe.frames import Mounting, mounting_of
from forcecal_ros.observe.pose_sources import JointPose, TransformPose
from geometry_msgs.msg import AccelStamped, PoseStamped, Vector3Stamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header

SENSOR_FROM_POSE = Parameter(
    'sensor.from_pose', [0.0], 'x y z [m] qx qy qz qw of ft_sensor in the frame whose pose is '
    'measured and commanded, e.g. a flange or TCP; [0.0]: that frame is ft_sensor')

ACCELEROMETER_SOURCE = Parameter(
    'accelerometer.source', 'raw', 'Topic of the accelerometer: accelerometer/raw in volts, '
    'imu/data_raw or accel in m/s^2', choices=('raw', 'imu', 'accel', 'none'))

WRENCH_SIGN = Parameter('wrench.sign', 1, '-1 for a driver that reports the wrench of the tool on '
                        'its environment', low=-1, high=1)

COMMAND_PARAMETERS = (
    Parameter('motion.frame', '',
              'frame_id of commands, the same as of current_pose; empty: copied from it'),
    Parameter('motion.deadman_timeout', 0.0, 'Timeout of the topic deadman that stops a motion; '
              '0: no dead-man switch', 's', 0.0, 10.0))

POSE_PARAMETERS = (
    Parameter('pose.base', '',
              'Base frame of poses from /tf or pose.urdf, with pose.frame; both empty: '
              'poses are those of current_pose'),
    Parameter('pose.frame', '',
              'Frame whose pose is read, from /tf at the rate of the slowest moving '
              'transform; if it is not ft_sensor, set sensor.from_pose'),
    Parameter('pose.urdf', '',
              'URDF of the robot, a file or its text, for poses from joint_states; '
              'empty: poses from /tf'),
    SENSOR_FROM_POSE)

STATIC = QoSProfile(depth=100, reliability=LATCHED.reliability, durability=LATCHED.durability)
"""QoS of /tf_static: as many transforms as a robot has fixed joints and broadcasters."""

REMIND = 5.0
"""Time between two warnings that the frames are not there, or not connected [s]."""

Read = Callable[[bytes], Sample | None]


class Input(NamedTuple):
    """
    One topic.

    Attributes
    ----------
    channel : str
        ``wrench``, ``pose``, ``accelerometer``, ``optidrive`` or another name of its samples.
    read : callable
        Returns stamp and values of a serialised message; None where it completes no sample.
    watched : bool
        Whether its silence and its readings may end a motion.
    name : str
        What messages to the user call it; empty: its topic.
    static : Subscription or None
        Additional, which ends with the node.
    """

    channel: str
    topic: str
    message_type: Any
    read: Read
    watched: bool = True
    name: str = ''
    static: Subscription | None = None

    def taker(self, use: Callable[[Sample], None]) -> Callable[[bytes], None]:
        """Return a callback for messages that passes the sample in each, if any, on."""
        read = self.read

        def take(raw: bytes) -> None:
            try:
                sample = read(raw)
            except StructError:
                return
            if sample is not None:
                use(sample)

        return take


def plain_input(channel: str, topic: str, message_type: Any) -> Input:
    """Return a topic of a type that :class:`forcecal_ros.nodes.wire.Reader` reads."""
    return Input(channel, topic, message_type, Reader(message_type))


def optidrive_input(joint: str) -> Input:
    """Return the topic of the displacement of a compliant tool, which no motion depends on."""
    joints = JointsReader([joint])

    def read(raw: bytes) -> Sample | None:
        stamp_ns, (position,) = joints(raw)
        return None if position is None else Sample(stamp_ns, (position,))

    return Input('optidrive', 'optidrive', JointState, read, watched=False)


def pose_source(node: Node) -> Input:
    """
    Return where a node that has ``POSE_PARAMETERS`` takes poses from.

    Raises
    ------
    ConfigError
        A frame is missing, tf2_msgs is, or the URDF leads from none of the frames to the other.
    """
    base, frame, urdf = (str(node.get_parameter(f'pose.{name}').value)
                         for name in ('base', 'frame', 'urdf'))
    if not (base or frame or urdf):
        return plain_input('pose', 'current_pose', PoseStamped)
    if not (base and frame):
        empty, other = ('frame', 'base') if base else ('base', 'frame')
        given = 'pose.urdf is given' if urdf else f'pose.{other} is {base or frame!r}'
        raise ConfigError(f'pose.{empty} is empty, but {given}; set pose.base and pose.frame to '
                          f'{"links of the URDF" if urdf else "frames of /tf"}')
    if urdf:
        return _of_joints(node, base, frame, urdf)
    message_type = transform_type('pose.base and pose.frame take poses from /tf',
                                  ', or have a PoseStamped published on current_pose')
    poses = TransformPose(base, frame)

    def take_static(raw: bytes) -> None:
        with suppress(StructError):
            poses.take_static(raw)

    static = node.create_subscription(message_type, '/tf_static', take_static, STATIC, raw=True)
    return _posed(node, '/tf', message_type, base, frame, poses.take, lambda: poses.why_not,
                  static)


def _posed(node: Node, topic: str, message_type: Any, base: str, frame: str,
           take: Callable[[bytes], Any], why_not: Callable[[], str],
           static: Subscription | None = None) -> Input:
    """Return poses of a frame in a base, which ``take`` makes of messages, or says why not."""
    def read(raw: bytes) -> Sample | None:
        found = take(raw)
        if found is None and (reason := why_not()):
            node.get_logger().warning(f'{topic}: {reason}', throttle_duration_sec=REMIND,
                                      skip_first=True)
        return None if found is None else Sample(found.stamp_ns, found.values, base)

    return Input('pose', topic, message_type, read, name=f'{topic} ({base} to {frame})',
                 static=static)


def _of_joints(node: Node, base: str, frame: str, urdf: str) -> Input:
    source = 'the text of pose.urdf' if urdf.lstrip().startswith('<') else urdf
    try:
        text = urdf.encode() if source != urdf else Path(urdf).read_bytes()
        poses = JointPose(Description(text, source), base, frame, 'pose', source)
    except OSError as error:
        raise ConfigError(f'pose.urdf {urdf}: cannot be read ({error.strerror}); name an '
                          'existing URDF') from error
    except DataError as error:
        raise ConfigError(f'pose.urdf: {error}') from error
    joints = JointsReader(poses.drivers)
    return _posed(node, 'joint_states', JointState, base, frame,
                  lambda raw: poses.take(*joints(raw)),
                  lambda: poses.why_not and f'{poses.why_not}; joints of the newest message are '
                                            f'{", ".join(joints.names) or "none"}')


def transform_type(why: str, otherwise: str = '') -> Any:
    """
    Return the type of /tf, which no package index has: the one place that requires tf2_msgs.

    Raises
    ------
    ConfigError
        It is missing; with ``why`` it is required, and what to do ``otherwise``.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError as error:
        raise ConfigError(
            f'{why}, which requires tf2_msgs: apt install ros-jazzy-tf2-msgs{otherwise}'
        ) from error
    return TFMessage


def mounting_parameter(node: Node) -> Mounting | None:
    """
    Return the mounting that ``sensor.from_pose`` states.

    Raises
    ------
    ConfigError
        It is no pose.
    """
    name = SENSOR_FROM_POSE.name
    return mounting_of(node.get_parameter(name).value, f'parameter {name}')


def at_sensor(poses: Input, mounting: Mounting | None) -> Input:
    """Return a topic of poses as those of ft_sensor."""
    if mounting is None:
        return poses

    def read(raw: bytes) -> Sample | None:
        sample = poses.read(raw)
        return sample and sample._replace(values=combine(sample.values, mounting))

    return poses._replace(read=read)


ACCELEROMETERS: dict[str, tuple[str, Any, str]] = {
    'raw': ('accelerometer/raw', Vector3Stamped, 'V'),
    'imu': ('imu/data_raw', Imu, 'm/s^2'),
    'accel': ('accel', AccelStamped, 'm/s^2'),
}
"""Topic, type and unit of each choice of ``accelerometer.source``."""


def accelerometer_input(source: str) -> tuple[Input | None, str]:
    """Return the topic of a choice of ``accelerometer.source``, if any, and its unit."""
    if source not in ACCELEROMETERS:
        return None, 'V'
    topic, message_type, unit = ACCELEROMETERS[source]
    return plain_input('accelerometer', topic, message_type), unit


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


Record: TypeAlias = Callable[[str, int, tuple[float, ...]], None]
"""Called with channel, stamp [ns] and values of every sample and command."""


class Sensors:
    """The topics that a motion depends on, with monitor and dead-man switch."""

    def __init__(self, inbox: Inbox, inputs: Iterable[Input], deadman: Deadman,
                 watch: WatchSettings, limits: Limits,
                 record: Record = lambda channel, stamp_ns, values: None) -> None:
        inputs = tuple(inputs)
        self.deadman = deadman
        self.monitor = Monitor(watch, limits, {
            one.channel: one.name or one.topic for one in inputs if one.watched})
        self._record = record
        self._samples: dict[str, Sample] = {}
        for one in inputs:
            inbox.subscribe(one.message_type, one.topic, one.taker(self._user(one)))

    def _user(self, one: Input) -> Callable[[Sample], None]:
        channel, monitor = one.channel, self.monitor
        watch = {'wrench': monitor.wrench, 'pose': monitor.pose}.get(
            channel, partial(monitor.other, channel)) if one.watched else None

        def use(sample: Sample) -> None:
            self._samples[channel] = sample
            if watch is not None:
                watch(sample.stamp_ns * 1e-9, sample.values)
            self._record(channel, sample.stamp_ns, sample.values)

        return use

    def commanded(self, stamp_ns: int, pose: tuple[float, ...]) -> None:
        """Note a command, x y z [m] qx qy qz qw, with which measured poses are compared."""
        self.monitor.command(stamp_ns * 1e-9, pose)
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
        return self._samples['pose'].stamp_ns

    @property
    def frames(self) -> dict[str, str]:
        """The frame_id of the newest message, by channel."""
        return {channel: sample.frame for channel, sample in self._samples.items()}
