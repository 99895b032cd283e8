"""One generator of motion, three ways to tell a robot: the serialisers of the command stream."""

from abc import ABC, abstractmethod
from collections import deque
from typing import Any, Generic, TypeVar

from builtin_interfaces.msg import Duration
from forcecal_ros.errors import ConfigError, DataError, MotionError
from forcecal_ros.geometry import Array, matrix_from_quaternion, quaternion_of
from forcecal_ros.motion.joints import JointSetpoint
from forcecal_ros.motion.plan import Goal
from forcecal_ros.motion.profiles import Pose, Setpoint, twist_towards
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.runtime import OUTPUT, SENSOR
from forcecal_ros.nodes.sensors import Sensors
from forcecal_ros.nodes.wire import Writer
from geometry_msgs.msg import PoseStamped, TwistStamped
import numpy as np
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

BEHIND = 50
"""A robot that is where one of so many newest commands told it to be follows them."""

REMEMBERED = 128
"""So many of one's own messages are kept to tell foreign commands from one's own."""

UNSEEN = ('where joint vectors lead is not known beforehand: limits.workspace, speed, force and '
          'torque are held as measured, not as planned')

CommandT = TypeVar('CommandT', Setpoint, JointSetpoint)


class Backend(ABC, Generic[CommandT]):
    """
    A topic that commands go to, and an ear for others who command there.

    Attributes
    ----------
    topic : str
    foreign : int
        Commands heard that were not one's own.
    caveat : str
        What a start says of plans that are checked in part only; empty: they are checked.
    """

    caveat = ''

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors, topic: str, message_type: Any
                 ) -> None:
        self.topic = topic
        self.foreign = 0
        self._sensors = sensors
        self._own: deque[bytes] = deque(maxlen=REMEMBERED)
        self._publisher = node.create_publisher(message_type, topic, OUTPUT)
        inbox.subscribe(message_type, topic, self._on_command)

    def prepare(self, period_ns: int) -> None:
        """
        Make ready for a motion of one command a period.

        Raises
        ------
        MotionError
            Commands would be read in another frame than poses are measured in.
        """

    def where(self) -> Goal:
        """Return where the robot stands: the first command."""
        return self._sensors.where()

    @abstractmethod
    def send(self, stamp_ns: int, command: CommandT) -> None:
        """Send one command."""

    def astray(self, limit: float) -> str:
        """Say how far off the robot is by what only this back end hears; empty: within limit."""
        return ''

    def _on_command(self, raw: bytes) -> None:
        if raw not in self._own:
            self.foreign += 1

    def _publish(self, raw: bytes) -> None:
        self._own.appendleft(raw)
        self._publisher.publish(raw)


class CartesianBackend(Backend[Setpoint]):
    """Commands of the sensor's pose, in the frame that poses are measured in."""

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors, topic: str, message_type: Any,
                 frame: str) -> None:
        super().__init__(node, inbox, sensors, topic, message_type)
        self._message_type, self._frame = message_type, frame

    def prepare(self, period_ns: int) -> None:
        """Take the frame of commands: that of the measured poses, where none is asked for."""
        measured = self._sensors.frames['pose']
        if not (measured or self._frame):
            raise MotionError('current_pose has no frame_id; set motion.frame to the robot base '
                              'link')
        if self._frame and measured and measured != self._frame:
            raise MotionError(f'current_pose is in {measured!r}, commands would go out in '
                              f'{self._frame!r}, which is motion.frame; leave that empty, or '
                              'have the pose published in the same frame')
        self._write = Writer(self._message_type, self._frame or measured)

    def send(self, stamp_ns: int, command: Setpoint) -> None:
        """Send one command, and note it for the watch over the measured poses."""
        pose = pose_numbers(command.pose)
        self._sensors.commanded(stamp_ns, pose)
        self._publish(self._write(stamp_ns, self._numbers(command, pose)))

    @abstractmethod
    def _numbers(self, command: Setpoint, pose: tuple[float, ...]) -> tuple[float, ...]:
        """Return what the message says; ``pose`` is the command's x y z qx qy qz qw."""


class TargetFrame(CartesianBackend):
    """Poses for cartesian_controllers: PoseStamped in the robot's base, small steps."""

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors, frame: str) -> None:
        super().__init__(node, inbox, sensors, 'target_frame', PoseStamped, frame)

    def _numbers(self, command: Setpoint, pose: tuple[float, ...]) -> tuple[float, ...]:
        return pose


class TwistCommands(CartesianBackend):
    """
    Velocities for MoveIt Servo: TwistStamped with fresh stamps and zeros at the end.

    Parameters
    ----------
    gain : float
        Velocity for each metre or radian behind the command [1/s].
    """

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors, frame: str, gain: float
                 ) -> None:
        super().__init__(node, inbox, sensors, 'delta_twist_cmds', TwistStamped, frame)
        self._gain = gain

    def _numbers(self, command: Setpoint, pose: tuple[float, ...]) -> tuple[float, ...]:
        measured = self._sensors.newest('pose')
        velocity, spin = twist_towards(
            command, Pose(np.array(measured[:3]), matrix_from_quaternion(measured[3:])),
            self._gain)
        return (*velocity.tolist(), *spin.tolist())


class JointTrajectories(Backend[JointSetpoint]):
    """Joint vectors for joint_trajectory_controller: every joint, each message ends at rest."""

    caveat = UNSEEN

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors, names: list[str]) -> None:
        if not names or names == ['']:
            raise ConfigError('motion.backend joint_trajectory wants joints.names')
        super().__init__(node, inbox, sensors, 'joint_trajectory', JointTrajectory)
        self._names = names
        self._period_ns = 0
        self._positions: dict[str, float] = {}
        self._sent: deque[Array] = deque(maxlen=BEHIND)
        node.create_subscription(JointState, 'joint_states', self._on_joints, SENSOR)

    def _on_joints(self, message: JointState) -> None:
        self._positions.update(zip(message.name, message.position))

    def where(self) -> Array:
        """
        Return the joints' measured positions, in the order of ``joints.names``.

        Raises
        ------
        DataError
            A joint was never heard of.
        """
        missing = [name for name in self._names if name not in self._positions]
        if missing:
            raise DataError(f'joint_states: no position of {", ".join(missing)} yet; is the '
                            'broadcaster running?')
        return np.array([self._positions[name] for name in self._names])

    def prepare(self, period_ns: int) -> None:
        """Forget the commands of the motion before."""
        self._period_ns = period_ns
        self._sent.clear()

    def astray(self, limit: float) -> str:
        """Compare measured joints with the newest commands; ``limit`` [rad] or [m]."""
        if not self._sent:
            return ''
        off = np.abs(np.array(self._sent) - self.where())
        nearest = off[np.argmin(off.max(axis=1))]
        joint = int(np.argmax(nearest))
        if nearest[joint] <= limit:
            return ''
        return (f'joint_states: {self._names[joint]} is {nearest[joint]:.3f} rad from the '
                f'command, limits.tracking_angle is {limit:g} rad')

    def send(self, stamp_ns: int, command: JointSetpoint) -> None:
        """
        Send where to be one period from now, and where to be at rest one period later.

        The controller stops at the last point by itself should the stream cease. The stamp stays
        zero, which means now: a controller refuses a trajectory that ended before it arrived.
        """
        self._sensors.monitor.joints(stamp_ns * 1e-9, tuple(command.positions.tolist()))
        self._sent.append(command.positions)
        message = JointTrajectory(joint_names=self._names)
        period = self._period_ns
        ahead = command.positions + command.velocities * (period * 1e-9)
        message.points = [_point(command.positions, command.velocities, period),
                          _point(ahead, np.zeros(len(ahead)), 2 * period)]
        self._publish(bytes(serialize_message(message)))


def _point(positions: Array, velocities: Array, after_ns: int) -> JointTrajectoryPoint:
    return JointTrajectoryPoint(
        positions=positions.tolist(), velocities=velocities.tolist(),
        time_from_start=Duration(sec=after_ns // 10**9, nanosec=after_ns % 10**9))


def pose_numbers(pose: Pose) -> tuple[float, ...]:
    """Return x y z qx qy qz qw of a pose."""
    return (*pose.position.tolist(), *quaternion_of(pose.R_base_sensor))


def backend_of(node: Node, inbox: Inbox, sensors: Sensors) -> Backend[Any]:
    """Return the back end that the parameter ``motion.backend`` of a node asks for."""
    def value(name: str) -> Any:
        return node.get_parameter(name).value

    kind = value('motion.backend')
    if kind == 'joint_trajectory':
        return JointTrajectories(node, inbox, sensors, value('joints.names'))
    frame = value('motion.frame')
    if kind == 'delta_twist_cmds':
        return TwistCommands(node, inbox, sensors, frame, value('motion.twist_gain'))
    return TargetFrame(node, inbox, sensors, frame)
