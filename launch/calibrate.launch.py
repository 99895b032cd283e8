"""
Calibrate on a robot's topics, or with ``sim:=true`` on the simulated rig.

Nothing moves before the service ``sequencer/start`` is called.
"""

from forcecal_ros.nodes.launching import describe, node, parameters_argument
from launch import LaunchDescription


def generate_launch_description():
    """Describe sequencer and observer."""
    return LaunchDescription(describe(
        [node('sequencer'), node('observer')],
        [parameters_argument('sequencer'), parameters_argument('observer')]))
