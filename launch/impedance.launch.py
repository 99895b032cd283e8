"""
Impedance control in contact: observer and controller, with ``sim:=true`` on the simulated rig.

Nothing moves before the service ``impedance/start`` is called.
"""

from forcecal_ros.nodes.launching import describe, node, parameters_argument
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    """Describe observer and controller."""
    calibration = DeclareLaunchArgument(
        'calibration', description='calibration.yaml, as saved by the sequencer or the commands')
    file = ParameterValue(LaunchConfiguration('calibration'), value_type=str)  # else read as YAML
    return LaunchDescription(describe(
        [node('observer', {'calibration.file': file}),
         node('impedance')],
        [calibration, parameters_argument('observer'), parameters_argument('impedance')]))
