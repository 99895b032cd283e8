"""``forcecal init``: a complete, commented parameter file for a robot."""

import argparse
from collections.abc import Mapping, Sequence
from math import nan
import shlex
from typing import Any

from forcecal_ros.cli import common

NO_POSE = ('No pose was received: poses.* assume that z of the sensor points down; set '
           'limits.workspace_*.')

TO_SET = ('limits.workspace_min', 'limits.workspace_max', 'limits.tip', 'limits.force',
          'limits.torque', 'poses.names', 'poses.values')
BACKEND = 'motion.backend'
"""Parameter by which the robot is moved, to be set where no preset of a controller has it."""

JOINTS_TO_SET = ('joints.names', 'joints.values', 'joints.away')
"""Parameters that depend on the cell, and those of poses as joint vectors."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(subparsers, 'init', json=False,
                               example='forcecal init --preset ur -o my_cell.yaml')
    parser.add_argument('--preset', metavar='NAME', type=common.preset, required=True,
                        help="topics and parameters of a robot's driver: ur, franka, kuka_fri, "
                             'broadcaster')
    parser.add_argument('--controller', metavar='NAME',
                        type=common.word('a controller', 'core.topics', 'CONTROLLERS'),
                        help='controller that moves the robot: moveit_servo, '
                             'joint_trajectory_controller, cartesian_controllers, '
                             'admittance_controller')
    common.add_namespace(parser)
    parser.add_argument('--offline', action='store_true',
                        help='do not read topics, frames, joints and present pose from a running '
                             'driver')
    parser.add_argument('--timeout', metavar='S', type=common.positive, default=5.0,
                        help='how long to wait for messages of the driver: discovery by DDS may '
                             'take 3 s')
    common.add_output(parser, '-o', '--output', kind='file', metavar='FILE',
                      default='my_cell.yaml',
                      help='parameter file to write, - for standard output')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.core.files import write_text

    with common.needs_ros():
        from forcecal_ros.nodes.config import TABLES
    from forcecal_ros.core.parameters import parameter_file
    from forcecal_ros.core.topics import read_preset

    names = [name for name in (args.preset, args.controller) if name]
    presets = [read_preset(name) for name in names]
    topics = {key: str(value) for one in presets for key, value in one['topics'].items()}
    given = {node: {key: value for one in presets for key, value in one.get(node, {}).items()}
             for node in ('sequencer', 'observer')}
    looked_for = ['wrench', 'joint_states', *['current_pose'] * (
        not given['sequencer'].get('pose.frame'))]  # else from /tf
    values, other, about = ({}, {}, NO_POSE) if args.offline else _driver(
        args, {key: topics.get(key, key) for key in looked_for})
    without_pose = {'limits.workspace_min': [nan] * 3, 'limits.workspace_max': [nan] * 3}
    given['sequencer'] = {**without_pose, **_poses((1.0, 0.0, 0.0, 0.0)), **values,
                          **given['sequencer']}
    if undriven := BACKEND not in given['sequencer']:
        common.warn('no controller is given: add --controller, e.g. moveit_servo '
                    f'or joint_trajectory_controller, or set {BACKEND}')
    launch = shlex.join((
        'ros2', 'launch', 'forcecal_ros', 'calibrate.launch.py',
        *([f'namespace:={args.namespace.strip("/")}'] if args.namespace else ()),
        f'robot:={args.preset}',
        *([f'controller:={args.controller}'] if args.controller else ()),
        *(f'{key}:={name}' for key, name in other.items()), f'sequencer_params:={args.output}'))
    named = ', '.join(f'{key} {name}' for key, name in {**topics, **other}.items())
    headings = {'observer': 'The observer.', 'sequencer': (
        f'Parameters for {" and ".join(names)}; start with {launch}. Topics: {named}. {about} '
        'Set the lines that end with # SET for your cell. Nothing moves before forcecal start.')}
    of_joints = given['sequencer'].get('motion.backend') == 'joint_trajectory'
    to_set = {'sequencer': TO_SET + JOINTS_TO_SET * of_joints + (BACKEND,) * undriven,
              'observer': ()}
    write_text(args.output, '\n'.join(parameter_file(
        node, [row._replace(default=values.get(row.name, row.default)) for row in TABLES[node][0]],
        headings[node], to_set[node]) for node, values in given.items()))
    if not common.stdout_is_taken(args):
        common.say(f'written to {args.output}; set the lines that end with # SET for your cell')
        common.say(f'next: {launch}')
    return 0


def _driver(args: argparse.Namespace, topics: Mapping[str, str]
            ) -> tuple[dict[str, Any], dict[str, str], str]:
    """Return parameters, topics that differ from the preset's and a comment, by a driver."""
    try:
        with common.needs_ros():
            from forcecal_ros.nodes.client import first_messages
    except Exception as error:  # noqa: BLE001 - the file is written without a driver, too
        common.warn(f'{error}; the file is written without a driver')
        return {}, {}, NO_POSE
    found, others = first_messages(args.namespace, topics, args.timeout)
    choices = ' '.join(f'Choose one of {", ".join(names)} by {key}:=NAME.'
                       for key, names in others.items() if len(names) > 1)
    if choices:
        common.warn(choices)
    if not found:
        common.warn('no message of a driver was received; start it with the same ROS_DOMAIN_ID, '
                    'or give --offline')
        return {}, {}, f'{choices} {NO_POSE}'.strip()
    values, poses = {}, NO_POSE
    if 'current_pose' in found:
        values = _around(found['current_pose'])
        poses = ('Poses and workspace are proposals around the present pose: check them with '
                 'forcecal preview.')
    if 'joint_states' in found:
        values['joints.names'] = list(found['joint_states'].name)
    frames = ', '.join(f'{key} in {message.header.frame_id or "an unnamed frame"}'
                       for key, message in found.items())
    return values, {key: names[0] for key, names in others.items() if key in found}, (
        f'{choices} Received: {frames}. {poses}').strip()


def _around(message: Any) -> dict[str, Any]:
    """Return poses tilted from the present one, a box around it and its frame as parameters."""
    # of the proposed workspace around the present position of the sensor
    margin, pose = 0.15, message.pose
    position = [getattr(pose.position, axis) for axis in 'xyz']
    return {**_poses([getattr(pose.orientation, axis) for axis in 'xyzw']),
            'motion.frame': message.header.frame_id,
            'limits.workspace_min': [round(x - margin, 3) for x in position],
            'limits.workspace_max': [round(x + margin, 3) for x in position]}


def _poses(orientation: Sequence[float]) -> dict[str, Any]:
    """Return an orientation, xyzw, and three tilts from it as poses at the present position."""
    from forcecal_ros.core.geometry import (
        matrix_from_quaternion,
        quaternion_from_matrix,
        rotation_from_vector,
    )
    import numpy as np

    # tilt: of the proposed poses from the present one: tilts about two axes separate mass, centre
    # of mass and biases, and most wrists reach them
    R, tilt = matrix_from_quaternion(np.array(orientation)), np.radians(40.0)
    tilts = {'upright': (0, 0, 0), 'tilt_x': (tilt, 0, 0), 'tilt_y': (0, tilt, 0),
             'tilt_back': (-tilt, 0, 0)}
    return {'poses.names': list(tilts), 'poses.values': [
        value for vector in tilts.values() for value in (nan, nan, nan, *quaternion_from_matrix(
            R @ rotation_from_vector(np.array(vector, dtype=float))).tolist())]}
