"""Launch files: arguments, topics and nodes that they share."""

from collections.abc import Sequence

from forcecal_ros.core.topics import CONTROLLERS, preset_file, ROBOTS, topic_of
from launch import LaunchContext, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitution import Substitution
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
    'joint_states': ('joint_states', 'JointState of the robot'),
    'joint_trajectory': ('joint_trajectory', 'JointTrajectory that the robot follows'),
    'delta_twist_cmds': ('delta_twist_cmds', 'TwistStamped that the robot follows'),
    'contact_wrench': ('observer/contact_wrench', 'WrenchStamped that the observer publishes'),
}
"""Launch argument: the name of the topic in the node, and its message."""


def preset_arguments() -> list[LaunchDescriptionEntity]:
    """Return the arguments that name presets, which others default to."""
    return [
        DeclareLaunchArgument('robot', default_value='', choices=['', *ROBOTS],
                              description='preset of topics and parameters'),
        DeclareLaunchArgument('controller', default_value='', choices=['', *CONTROLLERS],
                              description='preset of the controller that moves the robot')]


def common_arguments() -> list[LaunchDescriptionEntity]:
    """Return the arguments of every launch file: topics, namespace, clock, simulated rig."""
    return [
        *(DeclareLaunchArgument(name, default_value=PresetTopic(name, topic),
                                description=f'topic: {what}')
          for name, (topic, what) in TOPICS.items()),
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of all nodes and relative topics'),
        DeclareLaunchArgument('use_sim_time', default_value='false', choices=['true', 'false'],
                              description='use the time of /clock, which the simulated rig '
                                          'publishes if it runs'),
        DeclareLaunchArgument('sim', default_value='false', choices=['true', 'false'],
                              description='run the simulated rig in place of a robot'),
        parameters_argument('sim'),
    ]


class PresetTopic(Substitution):  # type: ignore[misc]
    """The name of a topic: that of the presets of robot and controller, or the usual one."""

    def __init__(self, argument: str, usual: str) -> None:
        super().__init__()
        self._argument, self._usual = argument, usual

    def describe(self) -> str:
        """Return what ``--show-args`` shows."""
        return f"'{self._usual}', or that of robot or controller"

    def perform(self, context: LaunchContext) -> str:
        """Return the name."""
        given = context.launch_configurations
        return topic_of(self._argument, self._usual, given['robot'], given['controller'])


class PresetFile(Substitution):  # type: ignore[misc]
    """The parameter file of the first preset that is named, or that of a node's defaults."""

    def __init__(self, node: str, *arguments: str) -> None:
        super().__init__()
        self._defaults = PathJoinSubstitution(
            [FindPackageShare(PACKAGE), 'config', f'{node}.yaml'])
        self._arguments = arguments

    def describe(self) -> str:
        """Return what ``--show-args`` shows."""
        return f'that of {" or ".join(self._arguments)}, or {self._defaults.describe()}'

    def perform(self, context: LaunchContext) -> str:
        """Return the path."""
        name = next(filter(None, map(context.launch_configurations.get, self._arguments)), '')
        return str(preset_file(name) if name else self._defaults.perform(context))


def parameters_argument(node: str) -> DeclareLaunchArgument:
    """Return the argument that names a node's parameter file."""
    return DeclareLaunchArgument(
        f'{node}_params',
        default_value=PresetFile(node, 'controller', 'robot'),
        description=f'parameter file of {node}; overrides controller, which overrides robot')


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
        # as a parameter, launch_ros leaves out a file that is not there; the node refuses it
        ros_arguments=['--params-file', PresetFile(name, 'robot'),
                       '--params-file', PresetFile(name, 'controller', 'robot'),
                       '--params-file', LaunchConfiguration(f'{name}_params')],
        parameters=[{'use_sim_time': LaunchConfiguration('use_sim_time')}, *parameters],
        remappings=[(topic, LaunchConfiguration(key)) for key, (topic, _) in TOPICS.items()],
        condition=IfCondition(LaunchConfiguration(only_if)) if only_if else None,
        output='screen')


def describe(nodes: Sequence[Node], arguments: Sequence[LaunchDescriptionEntity] = ()
             ) -> list[LaunchDescriptionEntity]:
    """Combine own and common arguments, the simulated rig and other nodes."""
    clock = {'clock.publish': LaunchConfiguration('use_sim_time')}
    return [*preset_arguments(), *arguments, *common_arguments(),
            node('sim', clock, only_if='sim'), *nodes]
