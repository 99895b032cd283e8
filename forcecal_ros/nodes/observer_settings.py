"""Parameters of the observer, and the settings that follow from their values."""

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Any

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.parameters import Parameter, parameters_of, section_of
from forcecal_ros.nodes.inputs import ACCELEROMETERS, POSE_PARAMETERS, SENSOR_FROM_POSE
from forcecal_ros.nodes.runtime import EXECUTOR
from forcecal_ros.nodes.runtime import live_parameter as _live
from forcecal_ros.observe.payload import PayloadSettings
from forcecal_ros.observe.settings import FILTERS, MODES, ObserverSettings

TRACKED = 'tracked'
"""Value of the parameter ``tool``: the tool on ``observer/tool``, or by the node's own tracker."""

_DEFAULT = ObserverSettings()


PARAMETERS = (
    EXECUTOR,
    Parameter('autostart', True, 'Configure and activate at start; false: leave it to a '
              'lifecycle manager'),
    _live('calibration.file', '', 'calibration.yaml to load when configured; empty: wait for '
          'sequencer/calibration'),
    _live('calibration.max_age', 0.0, 'A file whose recording is older is refused; 0: of '
          'any age', 'd', 0.0, 36500.0),
    Parameter('calibration.follow', True, 'Use each calibration that the sequencer publishes '
              'while running'),
    Parameter('tools', '', 'Folder of calibrations of one sensor with one tool each, NAME.yaml'),
    _live('tool', '',
          'NAME in tools of the tool on the sensor; the bias stays at a change; '
          'empty: that of the calibration; tracked: that of observer/tool, or with payload.track '
          "the node's own estimate"),
    Parameter('payload.track',
              False, 'Estimate mass and centre of mass while the robot works, and '
              'publish observer/tool'),
    Parameter('payload.largest', 0.0, "Largest payload that is expected; 0: the tool's own mass",
              'kg', 0.0, 1e4),
    Parameter('payload.floor_force', PayloadSettings().floor[0], 'Residual force in free '
              'motion, averaged over 0.2 s', 'N', 0.0, 1e3),
    Parameter('payload.floor_torque', PayloadSettings().floor[1], 'The same for the torque', 'N m',
              0.0, 1e3),
    Parameter('accelerometer.source', 'auto', 'accelerometer/raw (volts), imu/data_raw or accel '
              '(m/s^2); auto: by the unit of the calibration',
              choices=('auto', *ACCELEROMETERS, 'none')),
    *POSE_PARAMETERS[:-1],
    SENSOR_FROM_POSE._replace(description='x y z [m] qx qy qz qw of ft_sensor in the frame whose '
                              'pose is measured; one number: as the calibration states'),
    Parameter('poll_rate', 0.0,
              'Rate at which topics are polled: half the load, and half a period '
              'more latency; 0: each message is taken at once', 'Hz', 0.0, 2000.0),
    Parameter('optidrive.joint', 'optidrive', 'Name in the JointState of the compliant tool; '
              'empty: no such sensor'),
    Parameter('publish.inertial_wrench', False, 'Publish observer/inertial_wrench, of the '
              "tool's weight and inertia"),
    Parameter('publish.innovation', False, 'Publish observer/innovation'),
    Parameter('publish.frames', [''],
              'Publish observer/contact_wrench/FRAME in each of these frames, '
              'about its origin'),
    Parameter('publish.frame_poses', [0.0], 'x y z [m] qx qy qz qw of each of them in ft_sensor; '
              'none for the last if it is the frame of current_pose'),
    Parameter('publish.marker_rate', 20.0,
              'Rate of observer/markers, which draws the contact force '
              'and its uncertainty for its subscribers; 0: never', 'Hz', 0.0, 100.0),
    Parameter('publish.transform', False, 'Publish ft_sensor on /tf by current_pose; requires '
              'tf2_msgs'),
    _live('observer.mode', '',
          'Observer that publishes; empty: as the calibration states', choices=('', *MODES)),
    *parameters_of('observer', _DEFAULT, 'bandwidth_hz', 'contact_walk', 'bandwidth_min_hz',
                   'bandwidth_max_hz', 'adaptive', 'offset', 'accelerometer_timeout',
                   'pose_timeout', 'skew'),
    _live('gravity.filter', 'none',
          'Filter that publishes instead: ukf and ekf estimate the biases, too, static '
          'filters nothing; none: the observer',
          choices=('none', *(name for name in FILTERS if name not in MODES))),
    _live('limits.force', 0.0, 'End of the force sensor range per axis; 0: unknown', 'N',
          0.0, 1e6),
    _live('limits.torque', 0.0, 'End of the torque range per axis; 0: unknown', 'N m', 0.0, 1e5),
    _live('limits.accelerometer', 0.0, 'End of the accelerometer range about zero, in its unit; '
          '0: unknown', '', 0.0, 1e5),
    _live('tare.duration', 0.5, 'Duration at rest over which a tare averages, at least 20 '
          'samples', 's', 0.1, 10.0),
    _live('takeover.duration', 0.5, 'Fade-in of a new calibration or setting',
          's', 0.01, 10.0),
    _live('stale_timeout', 0.5, 'Silence after which /diagnostics calls a sensor stale', 's',
          0.01, 60.0),
)


def settings_of(value: Mapping[str, Any]) -> ObserverSettings:
    """
    Make settings of the values of all ``PARAMETERS``, by name.

    Raises
    ------
    ConfigError
        A value is out of range.
    """
    force, torque = value['limits.force'], value['limits.torque']
    name = value['gravity.filter']
    return replace(
        section_of(ObserverSettings, value, 'observer'),
        filter=value['observer.mode'] or None if name == 'none' else name,
        wrench_limit=((force or inf,) * 3 + (torque or inf,) * 3 if force or torque else None),
        accelerometer_limit=value['limits.accelerometer'] or None)


def file_of(tool: str) -> str:
    """Return the name among ``tools`` that the parameter ``tool`` names; empty: none."""
    return '' if tool == TRACKED else tool


def payload_settings_of(value: Mapping[str, Any]) -> PayloadSettings:
    """Make settings of the payload's tracking of the values of all ``PARAMETERS``, by name."""
    return PayloadSettings(
        floor=(value['payload.floor_force'], value['payload.floor_torque']),
        largest=value['payload.largest'] or None)


def accelerometer_for(calibration: Calibration, chosen: str) -> str:
    """
    Return which of ``ACCELEROMETERS`` a calibration needs, or ``none``.

    Raises
    ------
    ConfigError
        The chosen one has another unit than the calibration is for.
    """
    needed = calibration.accelerometer
    if needed is None or chosen == 'none':
        return 'none'
    if chosen == 'auto':
        return 'raw' if needed.unit == 'V' else 'imu'
    if ACCELEROMETERS[chosen][2] != needed.unit:
        raise ConfigError(
            f'accelerometer.source {chosen} is in {ACCELEROMETERS[chosen][2]}, the calibration '
            f'is for {needed.unit}; calibrate with the same sensor')
    return chosen
