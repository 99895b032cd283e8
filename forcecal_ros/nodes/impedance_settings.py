"""The impedance node's parameters: the table, and what its values mean to the numerics."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

from forcecal_ros.impedance.program import Task
from forcecal_ros.impedance.session import Bounds
from forcecal_ros.impedance.settings import DesignSettings, Wanted
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import WatchSettings
from forcecal_ros.nodes.runtime import EXECUTOR
from forcecal_ros.schema import Parameter

_BOUNDS, _LIMITS, _TASK, _WANTED = Bounds(), Limits(), Task(), Wanted()
_DESIGN = DesignSettings()

WATCH = WatchSettings(pause_timeout=0.025, lost_timeout=0.029, frozen_timeout=0.03, max_age=0.03,
                      most_pauses=0)
"""Silence is at rest within 0.1 s: found, and stopped in the time of ``limits.stop_duration``."""


def _live(name: str, default: Any, description: str, unit: str = '', low: float | None = None,
          high: float | None = None) -> Parameter:
    """Return a parameter that takes effect at the next start."""
    return Parameter(name, default, description, unit, low, high, live=True)


PARAMETERS = (
    EXECUTOR,
    _live('task.cycles', 1, 'How often free movement, contact and way back follow one another',
          '', 1, 100_000),
    _live('task.swing', _TASK.swing, 'Way of each free move, back and forth, away from the wall',
          'm', 0.0, 0.5),
    _live('task.swing_duration', _TASK.swing_duration, 'Duration of each of them', 's',
          0.05, 10.0),
    _live('task.swings', _TASK.swings, 'How often back and forth', '', 0, 1000),
    _live('task.clearance', _TASK.clearance, 'From where the tool stands at start to the wall, '
          'along x of ft_sensor', 'm', 0.0, 1.0),
    _live('task.depth', _TASK.depth, 'How far behind the wall the reference goes, which presses',
          'm', 0.0, 0.2),
    _live('task.approach', _TASK.approach, 'Duration of the way there, and of the way back', 's',
          0.1, 60.0),
    _live('task.sweep', _TASK.sweep, 'In contact the reference moves by that much to and fro',
          'm', 0.0, 0.1),
    _live('task.hold', _TASK.hold, 'Each of the three holds in contact', 's', 0.1, 600.0),
    _live('task.rest', _TASK.rest, 'Between the moves in free space', 's', 0.01, 60.0),
    _live('task.settle', _TASK.settle, 'After the way back, for the tool to arrive', 's',
          0.01, 60.0),
    _live('impedance.mass', _WANTED.mass, 'The tool shall give way to a force as this mass',
          'kg', 0.1, 1e4),
    _live('impedance.damping', _WANTED.damping, 'with this damper', 'N s/m', 0.1, 1e6),
    _live('impedance.stiffness', _WANTED.stiffness, 'and this spring to the reference', 'N/m',
          0.1, 1e6),
    Parameter('plant', '', 'File of forcecal identify-robot with the models of robot and tool; '
              'empty: those of the nominal rig'),
    _live('design.latency', 2, "Control periods that a command takes beyond the robot's own "
          'delay, transport of the sensors included', '', 0, 50),
    _live('design.effort', _DESIGN.effort, 'What a command off its steady value costs, as a '
          'force per distance', 'N/m', 1e-3, 1e6),
    _live('design.softest_wall', _DESIGN.wall_stiffness[0], 'Softest wall against which the loop '
          'has to be stable to be started', 'N/m', 0.1, 1e7),
    _live('design.stiffest_wall', _DESIGN.wall_stiffness[1], 'Stiffest wall against which the '
          'loop has to be stable to be started', 'N/m', 0.1, 1e7),
    _live('design.state_gain', [0.0], 'L of the control law in the place of the optimal one; '
          'zeros: the optimal one'),
    _live('design.force_gain', 0.0, 'c of the control law in the place of the one that makes '
          'the steady state right; 0: that one', 'm/N', -1.0, 1.0),
    _live('design.position_gain', 0.0, 'l_r likewise', '', -1e3, 1e3),
    _live('limits.speed', _BOUNDS.speed, 'Commands are held to it; a measured speed above it '
          'times limits.overspeed stops', 'm/s', 0.001, 2.0),
    _live('limits.acceleration', _BOUNDS.acceleration, 'Commands are held to it likewise',
          'm/s^2', 0.01, 50.0),
    _live('limits.jerk', _LIMITS.jerk, 'A measured jerk above it times limits.overspeed stops',
          'm/s^3', 1.0, 1e5),
    _live('limits.workspace_min', _LIMITS.workspace_min.tolist(), 'Lower corner, in base, of the '
          'box that ft_sensor and the tip stay in', 'm'),
    _live('limits.workspace_max', _LIMITS.workspace_max.tolist(), 'Upper corner of that box', 'm'),
    _live('limits.tip', _LIMITS.tip.tolist(), "The tool's foremost point in ft_sensor", 'm'),
    _live('limits.force', _BOUNDS.force, 'Contact force that stops, wherever it occurs', 'N',
          0.5, 1e5),
    _live('limits.free_force', _BOUNDS.free_force, 'Contact force that stops where no wall is '
          'expected', 'N', 0.5, 1e5),
    _live('limits.margin', _BOUNDS.margin, 'So much before task.clearance the wall is expected '
          'already', 'm', 0.0005, 1.0),
    _live('limits.torque', _LIMITS.torque, 'Norm of the contact torque that stops', 'N m',
          0.1, 1e4),
    _live('limits.deviation', _BOUNDS.deviation, 'Command from the reference, beyond which the '
          'loop counts as unstable', 'm', 0.001, 1.0),
    _live('limits.tracking_error', _LIMITS.tracking_error, 'Measured against commanded position',
          'm', 0.0005, 1.0),
    _live('limits.tracking_angle', _LIMITS.tracking_angle,
          'Measured against commanded orientation', 'rad', 0.005, 3.0),
    _live('limits.overspeed', _LIMITS.overspeed, 'Measured speed, acceleration and jerk may '
          'exceed the limits by this factor', '', 1.0, 10.0),
    _live('limits.stop_duration', _BOUNDS.stop_duration, 'From the first command of a stop to '
          'rest', 's', 0.01, 0.5),
    _live('limits.retract', _BOUNDS.retract, 'How far a stop at the wall takes the tool back '
          'within that time', 'm', 0.0005, 0.1),
    _live('limits.withdraw', _BOUNDS.withdraw, 'How far it goes on from there, slowly, where it '
          'still presses', 'm', 0.0005, 0.5),
    _live('limits.touch', _BOUNDS.touch, 'Contact force above which the tool touches', 'N',
          0.05, 1e3),
    _live('watch.pause_timeout', WATCH.pause_timeout, 'Silence of the observer, the pose or the '
          'displacement that makes the reference stand', 's', 0.008, 10.0),
    _live('watch.lost_timeout', WATCH.lost_timeout, 'Silence or lateness for that long stops',
          's', 0.01, 60.0),
    _live('watch.frozen_timeout', WATCH.frozen_timeout, 'Readings that repeat to the last bit '
          'for that long in motion stop; 0: not looked at', 's', 0.0, 10.0),
    _live('watch.max_age', WATCH.max_age, 'Age of its newest header stamp above which a topic '
          'is late; 0: not looked at, for clocks that are not in step', 's', 0.0, 10.0),
    _live('watch.clock_timeout', WATCH.clock_timeout, 'With use_sim_time, a clock that stands '
          'for longer stops', 's', 0.02, 60.0),
    Parameter('motion.frame', '', 'frame_id of commands: the robot base link; empty: that of '
              'current_pose, from which it may not differ'),
    Parameter('motion.deadman_timeout', 0.0, 'Silence of the topic deadman that stops a motion; '
              '0: no dead-man switch', 's', 0.0, 10.0),
    Parameter('optidrive.joint', 'optidrive', 'Name in the JointState of the compliant tool; '
              'empty: the tool is rigid'),
)


class Settings(NamedTuple):
    """What one start runs with."""

    task: Task
    cycles: int
    bounds: Bounds
    limits: Limits
    watch: WatchSettings
    wanted: Wanted
    design: DesignSettings


def settings_of(value: Mapping[str, Any]) -> Settings:
    """
    Make settings of parameter values.

    Parameters
    ----------
    value : mapping
        Every parameter of ``PARAMETERS`` by name.

    Returns
    -------
    Settings

    Raises
    ------
    ConfigError
        Values contradict each other.
    """
    def group(kind: type, prefix: str) -> dict[str, Any]:
        return {field.name: value[f'{prefix}.{field.name}'] for field in fields(kind)
                if f'{prefix}.{field.name}' in value}

    return Settings(Task(**group(Task, 'task')), value['task.cycles'],
                    Bounds(**group(Bounds, 'limits')), Limits(**group(Limits, 'limits')),
                    WatchSettings(**group(WatchSettings, 'watch')),
                    Wanted(**group(Wanted, 'impedance')), _design(value))


def _design(value: Mapping[str, Any]) -> DesignSettings:
    def given(name: str) -> float | None:
        return value[f'design.{name}'] or None

    gain = tuple(value['design.state_gain'])
    low, high = value['design.softest_wall'], value['design.stiffest_wall']
    return DesignSettings(
        effort=value['design.effort'], latency=value['design.latency'],
        wall_stiffness=(low, high), state_gain=gain if any(gain) else None,
        force_gain=given('force_gain'), position_gain=given('position_gain'))
