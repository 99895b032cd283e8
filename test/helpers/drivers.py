"""Other sides of the wire: what drivers say, and what controllers make of commands."""

from forcecal_ros.core.geometry import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_from_vector,
)
from forcecal_ros.nodes.inputs import STATIC
from forcecal_ros.nodes.runtime import OUTPUT
from geometry_msgs.msg import TransformStamped, TwistStamped
import numpy as np
from rclpy.time import Time
from scipy.spatial.transform import RigidTransform, Rotation
from sensor_msgs.msg import JointState

NAMES = ['x', 'y', 'z', 'yaw', 'pitch', 'roll']
TOOL = Rotation.from_euler('xyz', [np.pi, 0.0, 0.5])
"""Far from a pitch of 90 deg at the poses of the rig, where yaw and roll are one."""

MOUNT = RigidTransform.from_components([0.0, 0.02, 0.11], Rotation.from_rotvec([0.3, -0.2, 1.0]))
"""Of the sensor in the link of /tf that carries it."""


def gantry(base='base', sensor='ft_sensor'):
    """Return the URDF of three slides and three turns; the sensor is fixed to the last."""
    parents = [base, *NAMES]
    joints = ''.join(
        f'<joint name="{name}" type="{"prismatic" if k < 3 else "continuous"}">'
        f'<parent link="{parents[k]}"/><child link="{name}"/>'
        f'<axis xyz="{" ".join("1" if i == (k if k < 3 else 5 - k) else "0" for i in range(3))}"/>'
        '</joint>' for k, name in enumerate(NAMES))
    r, p, y = TOOL.as_euler('xyz')
    return (f'<robot name="gantry">{joints}<joint name="mount" type="fixed"><parent link="roll"/>'
            f'<child link="{sensor}"/><origin rpy="{float(r)!r} {float(p)!r} {float(y)!r}"/>'
            '</joint></robot>')


def joints_at(pose):
    """Return the positions of the gantry's joints at x y z qx qy qz qw of its sensor."""
    angles = (Rotation.from_quat(pose[3:]) * TOOL.inv()).as_euler('ZYX')
    return [*map(float, pose[:3]), *map(float, angles)]


def states(stamp, positions, names=NAMES):
    message = JointState(name=list(names), position=list(positions))
    message.header.stamp = Time(nanoseconds=int(stamp)).to_msg()
    return message


class FrameTransforms:
    """What robot_state_publisher says of a sensor fixed to a link that moves."""

    def __init__(self, live, base, sensor):
        from tf2_msgs.msg import TFMessage
        self._message, self._base = TFMessage, base
        self._out = live.node.create_publisher(TFMessage, '/tf', OUTPUT)
        static = live.node.create_publisher(TFMessage, '/tf_static', STATIC)
        static.publish(TFMessage(transforms=[_transform(0, 'wrist', sensor, MOUNT)]))

    def say(self, stamp, pose):
        wrist = RigidTransform.from_components(
            pose[:3], Rotation.from_quat(pose[3:])) * MOUNT.inv()
        self._out.publish(self._message(transforms=[
            _transform(stamp, self._base, 'wrist', wrist)]))


def _transform(stamp, parent, child, transform):
    one = TransformStamped(child_frame_id=child)
    one.header.frame_id, one.header.stamp = parent, Time(nanoseconds=int(stamp)).to_msg()
    for part, axes, values in (
            (one.transform.translation, 'xyz', transform.translation),
            (one.transform.rotation, 'xyzw', transform.rotation.as_quat())):
        for axis, value in zip(axes, values):
            setattr(part, axis, float(value))
    return one


class Servo:
    """MoveIt Servo: turns fresh velocities into motion, and stands when they are stale."""

    message_type = TwistStamped

    def __init__(self, live, robot, topic='delta_twist_cmds'):
        self.robot = robot
        self.live = live
        self.heard = []
        self.visited = []
        self.twist = np.zeros(6)
        live.hear(TwistStamped, topic, self._on_twist)
        self.before = live.node.get_clock().now()
        live.node.create_timer(0.004, self._move)

    def _on_twist(self, stamp, values):
        now = self.live.node.get_clock().now().nanoseconds
        self.heard.append((stamp, (now - stamp) * 1e-9, values))
        self.twist = np.array(values)

    def _move(self):
        now = self.live.node.get_clock().now()
        dt = min((now - self.before).nanoseconds * 1e-9, LONGEST_STEP)
        self.before = now
        if not self.heard or now - Time(nanoseconds=self.heard[-1][0],
                                        clock_type=now.clock_type) > STALE:
            return
        position = np.array(self.robot.pose[:3]) + self.twist[:3] * dt
        R = rotation_from_vector(self.twist[3:] * dt) @ matrix_from_quaternion(self.robot.pose[3:])
        self.robot.pose = (*position, *quaternion_from_matrix(R))
        self.visited.append((position, R))


STALE = Time(nanoseconds=500_000_000) - Time()
"""After which a velocity counts no more; Servo's own 0.1 s is what the test asks of the median."""

LONGEST_STEP = 0.02
"""A test that was kept waiting goes on where it was: a robot does not jump [s]."""
