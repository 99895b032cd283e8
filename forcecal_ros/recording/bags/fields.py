"""Which numbers of a message make the columns of a signal, by message type."""

from collections.abc import Mapping

from forcecal_ros.recording.topics import (
    ACCEL,
    CONTROLLER_STATE,
    IMU,
    INERTIA,
    JOINT_STATE,
    MULTI_ARRAY,
    POSE,
    VECTOR3,
    WRENCH,
)

FIELDS: Mapping[str, tuple[str, ...]] = {
    WRENCH: tuple(f'wrench.{part}.{axis}' for part in ('force', 'torque') for axis in 'xyz'),
    VECTOR3: tuple(f'vector.{axis}' for axis in 'xyz'),
    IMU: tuple(f'{part}.{axis}' for part in ('linear_acceleration', 'angular_velocity')
               for axis in 'xyz'),
    ACCEL: tuple(f'accel.linear.{axis}' for axis in 'xyz'),
    POSE: (*(f'pose.position.{axis}' for axis in 'xyz'),
           *(f'pose.orientation.{axis}' for axis in 'xyzw')),
    JOINT_STATE: ('position[optidrive]',),
    INERTIA: ('inertia.m', *(f'inertia.com.{axis}' for axis in 'xyz'),
              *(f'inertia.i{pair}' for pair in ('xx', 'xy', 'xz', 'yy', 'yz', 'zz'))),
}

JOINTS: Mapping[str, str] = {
    JOINT_STATE: 'position', CONTROLLER_STATE: 'reference.positions', MULTI_ARRAY: 'data'}
"""Which array of a message holds what joints are told."""

JOINT_NAMES: Mapping[str, str] = {JOINT_STATE: 'name', CONTROLLER_STATE: 'joint_names'}
"""Which array names them; other messages do not."""
