"""Publish the contact wrench by a calibration that was saved before."""

from forcecal_ros.nodes.launching import describe, node, parameters_argument
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration


def generate_launch_description():
    """Describe the observer."""
    calibration = DeclareLaunchArgument(
        'calibration', description='calibration.yaml, as saved by the sequencer or the commands')
    gravity = DeclareLaunchArgument(
        'gravity_filter', default_value='none', choices=['none', 'ukf', 'ekf', 'static'],
        description='filter of gravity compensation that publishes instead of the observer')
    return LaunchDescription(describe(
        [node('observer', {'calibration.file': LaunchConfiguration('calibration'),
                           'gravity.filter': LaunchConfiguration('gravity_filter')})],
        [calibration, gravity, parameters_argument('observer')]))
