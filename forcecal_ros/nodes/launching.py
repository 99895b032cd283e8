"""Arguments, topics and nodes that the launch files of this package share."""

from collections.abc import Sequence

from launch import LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'forcecal_ros'
TOPICS = {
    'wrench': ('wrench', 'WrenchStamped of the force/torque sensor'),
    'current_pose': ('current_pose', 'PoseStamped of the sensor in the base of the robot'),
    'target_frame': ('target_frame', 'PoseStamped that the robot follows'),
    'accelerometer': ('accelerometer/raw', 'Vector3Stamped of the accelerometer, volts'),
    'imu': ('imu/data_raw', 'Imu, specific force'),
    'accel': ('accel', 'AccelStamped, specific force'),
    'optidrive': ('optidrive', 'JointState of a compliant tool'),
}
"""Launch argument: the name of the topic in the node, and its message."""


def common_arguments() -> list[LaunchDescriptionEntity]:
    """Return the arguments of every launch file: topics, namespace, clock, simulated rig."""
    topics = [DeclareLaunchArgument(name, default_value=topic, description=f'topic: {what}')
              for name, (topic, what) in TOPICS.items()]
    return [
        *topics,
        DeclareLaunchArgument('namespace', default_value='',
                              description='of all nodes, and of the topics that are relative'),
        DeclareLaunchArgument('use_sim_time', default_value='false', choices=['true', 'false'],
                              description='take the time from /clock, which the simulated rig '
                                          'publishes where there is one'),
        DeclareLaunchArgument('sim', default_value='false', choices=['true', 'false'],
                              description='run the simulated rig in place of a robot'),
        parameters_argument('sim'),
    ]


def parameters_argument(node: str) -> DeclareLaunchArgument:
    """Return the argument that names a node's parameter file."""
    return DeclareLaunchArgument(
        f'{node}_params',
        default_value=PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', f'{node}.yaml']),
        description=f'parameter file of {node}')


def node(name: str, *parameters: dict[str, object], only_if: str = '') -> Node:
    """
    Describe one of this package's nodes, on the topics and in the namespace of the arguments.

    Parameters
    ----------
    name : str
        Of executable, node and parameter file.
    *parameters : dict
        Override those of the file.
    only_if : str
        Launch argument that has to be true for the node to run; empty: it always does.
    """
    return Node(
        package=PACKAGE, executable=name, namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration(f'{name}_params'),
                    {'use_sim_time': LaunchConfiguration('use_sim_time')}, *parameters],
        remappings=[(topic, LaunchConfiguration(argument))
                    for argument, (topic, _) in TOPICS.items()],
        condition=IfCondition(LaunchConfiguration(only_if)) if only_if else None,
        output='screen')


def describe(nodes: Sequence[Node], arguments: Sequence[LaunchDescriptionEntity] = ()
             ) -> list[LaunchDescriptionEntity]:
    """Combine own and common arguments, the simulated rig and other nodes."""
    clock = {'clock.publish': LaunchConfiguration('use_sim_time')}
    return [*arguments, *common_arguments(), node('sim', clock, only_if='sim'), *nodes]
