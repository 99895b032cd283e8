"""Publish the contact wrench by a calibration that was saved before."""

from forcecal_ros.nodes.launching import describe, node, parameters_argument
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    """Describe the observer."""
    calibration = DeclareLaunchArgument(
        'calibration', description='calibration.yaml, as saved by the sequencer or the commands')
    gravity = DeclareLaunchArgument(
        'gravity_filter', default_value='none', choices=['none', 'ukf', 'ekf', 'static'],
        description='gravity compensation filter that replaces the observer')
    file = ParameterValue(LaunchConfiguration('calibration'), value_type=str)  # else read as YAML
    return LaunchDescription(describe(
        [node('observer', {'calibration.file': file,
                           'gravity.filter': LaunchConfiguration('gravity_filter')})],
        [calibration, gravity, parameters_argument('observer')]))
