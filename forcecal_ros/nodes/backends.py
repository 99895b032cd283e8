"""Motion back ends: the command stream as poses, as twists or as joint trajectories."""

from abc import ABC, abstractmethod
from collections import deque
from typing import Any

from builtin_interfaces.msg import Duration
from forcecal_ros.core import geometry
from forcecal_ros.core.errors import above, ConfigError, DataError, MotionError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion, quaternion_of
from forcecal_ros.motion.monitor import FOLLOW
from forcecal_ros.motion.plan import Goal
from forcecal_ros.motion.profiles import JointSetpoint, Pose, Setpoint, twist_towards
from forcecal_ros.nodes.inputs import mounting_parameter, Sensors
from forcecal_ros.nodes.runtime import OUTPUT, SENSOR
from forcecal_ros.nodes.wire import Inbox, Writer
from geometry_msgs.msg import PoseStamped, TwistStamped
import numpy as np
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


class Backend(ABC):
    """
    A topic that commands are sent to, watched for commands of other nodes.

    Attributes
    ----------
    topic : str
    message_type : type
        Of the commands.
    commands_of_others : int
        Number of commands of other nodes.
    caveat : str
        Warning of a start whose plan is checked in part only; empty: all of it is checked.
    """

    caveat = ''
    topic: str
    message_type: Any

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors) -> None:
        self.commands_of_others = 0
        self._node, self._sensors = node, sensors
        self._own: deque[bytes] = deque(maxlen=128)
        self._publisher = node.create_publisher(self.message_type, self.topic, OUTPUT)
        inbox.subscribe(self.message_type, self.topic, self._on_command)

    def _value(self, name: str) -> Any:
        return self._node.get_parameter(name).value

    def prepare(self, period_ns: int) -> None:
        """
        Prepare for a motion of one command a period.

        Raises
        ------
        MotionError
            The frame of commands is not that of the measured poses.
        """
        self._period_ns = period_ns

    def require_controller(self) -> None:
        """
        Refuse to command a topic to which only this node subscribes.

        Raises
        ------
        MotionError
            With the name of the topic.
        """
        if self._publisher.get_subscription_count() < 2:
            raise MotionError(f'no other node subscribes to {self._publisher.topic_name}; start '
                              'the controller')

    def measured(self) -> Goal:
        """Return the measured pose, or joint vector, of the robot at rest: the first command."""
        return self._sensors.measured_pose()

    @abstractmethod
    def send(self, stamp_ns: int, command: Any) -> None:
        """Send one command: a setpoint of poses or of joints."""

    def tracking_fault(self, limit: float) -> str:
        """Check a tracking error that only this back end measures; empty: it is within limit."""
        return ''

    def _on_command(self, raw: bytes) -> None:
        if raw not in self._own:
            self.commands_of_others += 1

    def _publish(self, raw: bytes) -> None:
        self._own.appendleft(raw)
        self._publisher.publish(raw)


class CartesianBackend(Backend):
    """Commands of the frame whose pose is measured, in the frame that this pose is in."""

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors) -> None:
        super().__init__(node, inbox, sensors)
        self._frame = self._value('motion.frame')
        self._commanded_in_sensor = geometry.invert(mounting_parameter(node) or geometry.ITSELF)

    def prepare(self, period_ns: int) -> None:
        """Choose the frame of commands: that of the measured poses, unless another is set."""
        super().prepare(period_ns)
        measured = self._sensors.frames['pose']
        if not (measured or self._frame):
            raise MotionError('current_pose has no frame_id; set motion.frame to the robot base '
                              'link')
        if self._frame and measured and measured != self._frame:
            raise MotionError(f'current_pose is in {measured!r}, but motion.frame is '
                              f'{self._frame!r}; leave motion.frame empty')
        self._write = Writer(self.message_type, self._frame or measured)

    def send(self, stamp_ns: int, command: Setpoint) -> None:
        """Send one command, with which the monitor compares the measured poses."""
        position, R_base_sensor = command.pose
        pose = (*position.tolist(), *quaternion_of(R_base_sensor))
        self._sensors.commanded(stamp_ns, pose)
        self._publish(self._write(stamp_ns, self._numbers(command, pose)))

    @abstractmethod
    def _numbers(self, command: Setpoint, pose: tuple[float, ...]) -> tuple[float, ...]:
        """Return the numbers of the message; ``pose`` is that of ft_sensor, x y z qx qy qz qw."""


class TargetFrame(CartesianBackend):
    """Poses for cartesian_controllers: PoseStamped in the robot's base, in small steps."""

    topic, message_type = 'target_frame', PoseStamped

    def _numbers(self, command: Setpoint, pose: tuple[float, ...]) -> tuple[float, ...]:
        return geometry.combine(pose, self._commanded_in_sensor)


class TwistCommands(CartesianBackend):
    """Velocities for MoveIt Servo: TwistStamped with fresh stamps and zeros at the end."""

    topic, message_type = 'delta_twist_cmds', TwistStamped

    def _numbers(self, command: Setpoint, pose: tuple[float, ...]) -> tuple[float, ...]:
        measured = self._sensors.newest('pose')
        velocity, spin = twist_towards(
            command, Pose(np.array(measured[:3]), matrix_from_quaternion(measured[3:])),
            self._value('motion.twist_gain'))
        # the velocity of the commanded frame's origin, not of ft_sensor's
        origin = geometry.combine(measured, self._commanded_in_sensor)[:3]
        velocity = velocity + np.cross(spin, np.subtract(origin, measured[:3]))
        return (*velocity.tolist(), *spin.tolist())


class JointTrajectories(Backend):
    """Joint vectors for joint_trajectory_controller: every joint, each message ends at rest."""

    topic, message_type = 'joint_trajectory', JointTrajectory
    caveat = ('joint_trajectory is planned without kinematics: limits.workspace_*, speed, force '
              'and torque are checked while the robot moves, not in the plan')

    def __init__(self, node: Node, inbox: Inbox, sensors: Sensors) -> None:
        super().__init__(node, inbox, sensors)
        self._names: list[str] = self._value('joints.names')
        if not any(self._names):
            raise ConfigError('motion.backend joint_trajectory requires joints.names')
        self._positions: dict[str, float] = {}
        self._sent: deque[Array] = deque(maxlen=50)  # 0.2 s at 250 Hz
        node.create_subscription(JointState, 'joint_states', self._on_joints, SENSOR)

    def _on_joints(self, message: JointState) -> None:
        self._positions.update(zip(message.name, message.position))

    def measured(self) -> Array:
        """
        Return the measured joint positions, in the order of ``joints.names``.

        Raises
        ------
        DataError
            No position of some joint was received yet.
        """
        missing = [name for name in self._names if name not in self._positions]
        if missing:
            raise DataError(f'joint_states: no position of {", ".join(missing)} yet; start the '
                            'joint_state_broadcaster')
        return np.array([self._positions[name] for name in self._names])

    def prepare(self, period_ns: int) -> None:
        """Forget the commands of the motion before."""
        super().prepare(period_ns)
        self._sent.clear()

    def tracking_fault(self, limit: float) -> str:
        """Compare the measured joints with the newest commands; ``limit`` [rad] or [m]."""
        if not self._sent:
            return ''
        errors = np.abs(np.array(self._sent) - self.measured())
        nearest = errors[np.argmin(errors.max(axis=1))]
        joint = int(np.argmax(nearest))
        if nearest[joint] <= limit:
            return ''
        return (f'joint_states: {self._names[joint]} is {above(nearest[joint], limit)} rad from '
                f'the command, limits.tracking_angle is {limit:g} rad; {FOLLOW}')

    def send(self, stamp_ns: int, command: JointSetpoint) -> None:
        """
        Send the command for one period from now, and a point at rest for one period later.

        At that point the controller stops by itself should the stream end. The stamp stays zero,
        which means now: a controller refuses a trajectory that ended before it arrived.
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


BACKENDS: dict[str, type[Backend]] = {
    one.topic: one for one in (TargetFrame, JointTrajectories, TwistCommands)}
"""By the topic that the parameter ``motion.backend`` names."""
