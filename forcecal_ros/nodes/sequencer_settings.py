"""Parameters of the sequencer, and the settings that follow from their values."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.calibrate.settings import (
    COMPLIANCES,
    COUPLINGS,
    DESIGNS,
    IdentificationSettings,
    MODES,
)
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, POSE_LENGTH, STANDARD_GRAVITY
from forcecal_ros.core.parameters import Parameter, parameters_of, section_of
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import WatchSettings
from forcecal_ros.motion.plan import Goal, SEQUENCES, Timing
from forcecal_ros.motion.profiles import (
    anchor,
    flatten_poses,
    nominal_poses,
    Pace,
    Pose,
    read_poses,
    step_goal,
)
from forcecal_ros.motion.sequence import StreamSettings
from forcecal_ros.nodes.inputs import (
    ACCELEROMETER_SOURCE,
    COMMAND_PARAMETERS,
    POSE_PARAMETERS,
    WRENCH_SIGN,
)
from forcecal_ros.nodes.runtime import EXECUTOR
from forcecal_ros.nodes.runtime import live_parameter as _live
import numpy as np

_WATCH = WatchSettings()


PARAMETERS = (
    EXECUTOR,
    _live('sequence', 'calibrate', 'Sequence that a start runs', choices=tuple(SEQUENCES)),
    _live('motion.sequence', 'poses', 'How calibrate moves. poses: to each pose, at rest in it, '
          'and a step; continuous: 10 s of smooth motion in all axes about the present pose',
          choices=('poses', 'continuous')),
    _live('poses.names', list(nominal_poses()), 'Names of the poses in their order; the step is '
          'made in the first'),
    _live('poses.values', flatten_poses(nominal_poses()),
          'x y z [m] qx qy qz qw of each pose of ft_sensor in base, one after the other; '
          '.nan keeps the present position')._replace(per_line=POSE_LENGTH),
    *parameters_of('timing', Timing()),
    *parameters_of('pace', Pace()),
    *parameters_of('limits', Limits()),
    *parameters_of('watch', _WATCH, 'pause_timeout', 'most_pauses', 'lost_timeout',
                   'frozen_timeout', 'max_age', 'clock_timeout'),
    *parameters_of('settle', _WATCH, 'window', 'factor', 'force_floor', 'torque_floor',
                   'position_floor'),
    _live('settle.timeout', StreamSettings().settle_timeout, 'Time after a move in which the '
          'tool must become still', 's', 0.5, 120.0),
    Parameter('motion.backend', 'target_frame', 'Topic and type of the commands',
              choices=('target_frame', 'joint_trajectory', 'delta_twist_cmds')),
    Parameter('motion.rate', 250.0, 'Rate of the commands', 'Hz', 100.0, 250.0),
    *COMMAND_PARAMETERS,
    _live('motion.require_preview', False, 'Refuse a start without a sequencer/preview of these '
          'parameters from the present pose'),
    Parameter('motion.twist_gain', 5.0, 'delta_twist_cmds: gain from the pose error to the '
              'velocity', '1/s', 0.0, 50.0),
    Parameter('joints.names', [''], 'joint_trajectory: names of all joints of the controller'),
    _live('joints.values', [0.0], 'joint_trajectory: joint vectors of the poses', 'rad'),
    _live('joints.away', [0.0], 'joint_trajectory: joint vector at the end of the step', 'rad'),
    *POSE_PARAMETERS,
    WRENCH_SIGN,
    Parameter('wrench.matrix_file', '', 'calibration.yaml of forcecal insitu, whose matrix '
              'converts raw channels to a wrench; empty: wrench is one'),
    ACCELEROMETER_SOURCE,
    _live('accelerometer.coupling', 'dc', 'ac for a sensor that does not measure a constant '
          'acceleration', choices=COUPLINGS),
    _live('accelerometer.cutoff', 0.0,
          'Cut-off frequency of an ac sensor; 0: estimated', 'Hz', 0.0, 10.0),
    Parameter('optidrive.joint', 'optidrive', 'Name in the JointState of the compliant tool'),
    _live('identify.gravity', STANDARD_GRAVITY, 'Magnitude of gravity at the robot',
          'm/s^2', 9.7, 9.9),
    _live('identify.gravity_direction', [0.0, 0.0, -1.0],
          'Direction of gravity in base, of any length'),
    _live('identify.sensor_rotation', [0.0, 0.0, 0.0],
          "Rotation vector of the wrench's axes in the frame of current_pose", 'rad'),
    _live('identify.tool_compliance', 'auto', 'Whether the tool is compliant along x of ft_sensor',
          choices=COMPLIANCES),
    _live('observer.mode', 'kalman', 'Observer that publishes the contact wrench', choices=MODES),
    _live('observer.design', 'kalman', "Design of the paper's gain", choices=DESIGNS),
    _live('observer.poles', [-30.0, -40.0], "Poles of the observer's error with the design poles",
          '1/s'),
    _live('save.path', 'calibration.yaml', 'File that save_calibration writes; an existing one is '
          'kept with a ~'),
    _live('save.automatic', False, 'Whether every calibration is written at once'),
)


class SequencerSettings(NamedTuple):
    """Settings of one sequence."""

    sequence: str
    poses: dict[str, Pose]
    joints: dict[str, Array]
    joints_away: Array
    timing: Timing
    pace: Pace
    limits: Limits
    watch: WatchSettings
    stream: StreamSettings
    identification: IdentificationSettings
    continuous: bool = False

    def goals(self, start: Goal) -> tuple[dict[str, Goal], Goal]:
        """Return goals and the goal of the step, as poses or joint vectors like ``start``."""
        if isinstance(start, Pose):
            poses = anchor(self.poses, start.position)
            home = next(iter(poses.values()))
            return dict(poses), step_goal(home, SEQUENCES[self.sequence].distance(self.timing))
        return dict(self.joints), self.joints_away


def settings_of(value: Mapping[str, Any]) -> SequencerSettings:
    """
    Make settings of the values of all ``PARAMETERS``, by name.

    Raises
    ------
    ConfigError
        Values contradict each other, or the file of poses cannot be read.
    """
    limits = section_of(Limits, value, 'limits')
    watch = replace(section_of(WatchSettings, value, 'watch'), **{
        name: value[f'settle.{name}'] for name in (
            'window', 'factor', 'force_floor', 'torque_floor', 'position_floor')})
    # latency that sensors may have: settling lasts that much longer than the window of stillness,
    # so that all readings in it were taken at rest [s]
    stream = StreamSettings(
        rate=value['motion.rate'], stop_duration=limits.stop_duration,
        settle_minimum=watch.window + 0.05, settle_timeout=value['settle.timeout'])
    poses = read_poses(value['poses.names'], value['poses.values'])
    joints, away = _joint_vectors(list(poses), value)
    return SequencerSettings(
        value['sequence'], poses, joints, away, section_of(Timing, value, 'timing'),
        section_of(Pace, value, 'pace'), limits, watch, stream, _identification(value),
        value['sequence'] == 'calibrate' and value['motion.sequence'] == 'continuous')


def _identification(value: Mapping[str, Any]) -> IdentificationSettings:
    return IdentificationSettings(
        gravity=value['identify.gravity'],
        gravity_direction=tuple(value['identify.gravity_direction']),
        sensor_rotation=tuple(value['identify.sensor_rotation']),
        coupling=value['accelerometer.coupling'],
        cutoff=value['accelerometer.cutoff'] or None,
        tool_compliance=value['identify.tool_compliance'],
        observer_mode=value['observer.mode'], observer_design=value['observer.design'],
        observer_poles=tuple(value['observer.poles']), source={'by': 'sequencer'})


def _joint_vectors(names: list[str], value: Mapping[str, Any]
                   ) -> tuple[dict[str, Array], Array]:
    if value['motion.backend'] != 'joint_trajectory':
        return {}, np.zeros(0)
    joints = value['joints.names']
    vectors = np.array(value['joints.values'], dtype=float)
    away = np.array(value['joints.away'], dtype=float)
    if len(vectors) != len(joints) * len(names) or len(away) != len(joints):
        raise ConfigError(
            f'{len(joints)} joints and {len(names)} poses require {len(joints) * len(names)} '
            f'numbers in joints.values and {len(joints)} in joints.away, got {len(vectors)} and '
            f'{len(away)}')
    if not (np.isfinite(vectors).all() and np.isfinite(away).all()):
        raise ConfigError('joints.values or joints.away holds a number that is not finite')
    return dict(zip(names, vectors.reshape(len(names), -1))), away
