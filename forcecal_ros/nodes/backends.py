"""One generator of motion, three ways to tell a robot: the serialisers of the command stream."""

from collections import deque
from typing import Any

from builtin_interfaces.msg import Duration
from forcecal_ros.errors import ConfigError, DataError
from forcecal_ros.geometry import Array, matrix_from_quaternion, quaternion_of
from forcecal_ros.motion.joints import JointSetpoint
from forcecal_ros.motion.profiles import Pose, Setpoint, twist_towards
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.runtime import OUTPUT, SENSOR
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


class Backend:
    """
    A topic that commands go to, and an ear for others who command there.

    Parameters
    ----------
    node : Node
    inbox : Inbox
    topic : str
    message_type : type
    """

    def __init__(self, node: Node, inbox: Inbox, topic: str, message_type: Any) -> None:
        self.topic = topic
        self.foreign = 0
        self._own: deque[bytes] = deque(maxlen=REMEMBERED)
        self._publisher = node.create_publisher(message_type, topic, OUTPUT)
        inbox.subscribe(message_type, topic, self._on_command)

    def begin(self) -> None:
        """Make ready for a motion."""

    def astray(self, limit: float) -> str:
        """Say how far off the robot is by what only this back end hears; empty: within limit."""
        return ''

    def _on_command(self, raw: bytes) -> None:
        if raw not in self._own:
            self.foreign += 1

    def _publish(self, raw: bytes) -> None:
        self._own.appendleft(raw)
        self._publisher.publish(raw)


class TargetFrame(Backend):
    """Poses for cartesian_controllers: PoseStamped in the robot's base, small steps."""

    def __init__(self, node: Node, inbox: Inbox, frame: str) -> None:
        super().__init__(node, inbox, 'target_frame', PoseStamped)
        self._write = Writer(PoseStamped, frame)

    def send(self, stamp_ns: int, command: Setpoint, pose: tuple[float, ...]) -> None:
        """Send one command; ``pose`` is its x y z qx qy qz qw."""
        self._publish(self._write(stamp_ns, pose))


class TwistCommands(Backend):
    """Velocities for MoveIt Servo: TwistStamped with fresh stamps and zeros at the end."""

    def __init__(self, node: Node, inbox: Inbox, frame: str, gain: float) -> None:
        super().__init__(node, inbox, 'delta_twist_cmds', TwistStamped)
        self._write = Writer(TwistStamped, frame)
        self._gain = gain
        self.measured: tuple[float, ...] = ()

    def send(self, stamp_ns: int, command: Setpoint, pose: tuple[float, ...]) -> None:
        """Send one command, corrected by the pose measured last."""
        measured = command.pose
        if self.measured:
            measured = Pose(np.array(self.measured[:3]),
                            matrix_from_quaternion(self.measured[3:]))
        velocity, spin = twist_towards(command, measured, self._gain)
        self._publish(self._write(stamp_ns, (*velocity, *spin)))


class JointTrajectories(Backend):
    """Joint vectors for joint_trajectory_controller: every joint, each message ends at rest."""

    def __init__(self, node: Node, inbox: Inbox, names: list[str]) -> None:
        if not names or names == ['']:
            raise ConfigError('motion.backend joint_trajectory wants joints.names')
        super().__init__(node, inbox, 'joint_trajectory', JointTrajectory)
        self._names = names
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

    def begin(self) -> None:
        """Forget the commands of the motion before."""
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

    def send(self, command: JointSetpoint, period_ns: int) -> None:
        """
        Send where to be one period from now, and where to be at rest one period later.

        The controller stops at the last point by itself should the stream cease. The stamp stays
        zero, which means now: a controller refuses a trajectory that ended before it arrived.
        """
        self._sent.append(command.positions)
        message = JointTrajectory(joint_names=self._names)
        ahead = command.positions + command.velocities * (period_ns * 1e-9)
        message.points = [
            _point(command.positions, command.velocities, period_ns),
            _point(ahead, np.zeros(len(ahead)), 2 * period_ns)]
        self._publish(bytes(serialize_message(message)))


def _point(positions: Array, velocities: Array, after_ns: int) -> JointTrajectoryPoint:
    return JointTrajectoryPoint(
        positions=positions.tolist(), velocities=velocities.tolist(),
        time_from_start=Duration(sec=after_ns // 10**9, nanosec=after_ns % 10**9))


def pose_numbers(pose: Pose) -> tuple[float, ...]:
    """Return x y z qx qy qz qw of a pose."""
    return (*pose.position.tolist(), *quaternion_of(pose.R_base_sensor))
