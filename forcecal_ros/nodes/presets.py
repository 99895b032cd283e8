"""Presets: topics and parameters that fit the packages of a robot or of a controller."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from forcecal_ros.core.safe_yaml import load_yaml
from forcecal_ros.core.topics import ROLES

ROBOTS = ('broadcaster', 'franka', 'kuka_fri', 'ur')
CONTROLLERS = ('admittance_controller', 'cartesian_controllers', 'joint_trajectory_controller',
               'moveit_servo')


def preset_file(name: str) -> Path:
    """Return the parameter file of a preset, which nodes take as it is."""
    return Path(str(files('forcecal_ros') / 'config' / 'presets' / f'{name}.yaml'))


def read_preset(name: str) -> Mapping[str, dict[str, Any]]:
    """Return parameters by node; next to ``topics``, names of topics by launch argument."""
    document = load_yaml(preset_file(name).read_text(), name)
    return {node.removeprefix('/**/'): parameters['ros__parameters']
            for node, parameters in document.items()}


def topic_of(argument: str, usual: str, robot: str, controller: str) -> str:
    """
    Return the name of a topic by its launch argument, as presets say.

    The controller counts before the robot, except for joints: a robot that names their topics has
    its controllers in a namespace of its own.
    """
    for name in (robot, controller) if argument.startswith('joint_') else (controller, robot):
        if name and argument in (topics := read_preset(name)['topics']):
            return str(topics[argument])
    return usual


def topics_by_role(robot: str) -> dict[str, str]:
    """Return the names of a robot's topics by the roles of a recording."""
    preset, roles = read_preset(robot), {'current_pose': 'pose', 'target_frame': 'target'}
    names = {roles.get(argument, argument): str(name)
             for argument, name in preset['topics'].items()
             if roles.get(argument, argument) in ROLES}
    if frame := preset['sequencer'].get('pose.frame'):
        names['pose'] = f'tf:{preset["sequencer"]["pose.base"]}:{frame}'
    return names
