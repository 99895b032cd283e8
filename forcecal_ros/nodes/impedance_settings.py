"""Parameters of the impedance node, and the settings that follow from their values."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from forcecal_ros.core.parameters import Parameter, parameters_of, section_of
from forcecal_ros.impedance.program import Task
from forcecal_ros.impedance.session import Bounds
from forcecal_ros.impedance.settings import DesignSettings, Wanted
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import WatchSettings
from forcecal_ros.nodes.pose_source import POSE_PARAMETERS
from forcecal_ros.nodes.runtime import EXECUTOR

_LIMITS, _WANTED = Limits(), Wanted()
_DESIGN = DesignSettings()

WATCH = WatchSettings(pause_timeout=0.025, lost_timeout=0.029, frozen_timeout=0.03, max_age=0.03,
                      most_pauses=0)
"""With these the robot rests within 0.1 s after a topic falls silent: 29 ms until that is found,
62 ms of ``limits.stop_duration``."""

_DESCRIPTIONS = {
    'jerk': 'Largest jerk; a measured one above it times limits.overspeed stops',
    'workspace_min': 'Lower corner, in base, of the box that ft_sensor and the tip stay in',
    'torque': 'Norm of the contact torque above which the motion stops',
    'tracking_angle': 'Angle between measured and commanded orientation above which the motion '
                      'stops',
    'overspeed': 'Factor by which measured speed, acceleration and jerk may exceed the limits',
}
"""Of limits that mean something else here, where nothing is planned before the start."""


def _live(name: str, default: Any, description: str, unit: str = '', low: float | None = None,
          high: float | None = None) -> Parameter:
    """Return a parameter that takes effect at the next start."""
    return Parameter(name, default, description, unit, low, high, live=True)


PARAMETERS = (
    EXECUTOR,
    _live('task.cycles', 1, 'Number of cycles of free motion, contact and move back',
          '', 1, 100_000),
    *parameters_of('task', Task()),
    _live('impedance.mass', _WANTED.mass, 'Mass of the wanted impedance, about the reference',
          'kg', 0.1, 1e4),
    _live('impedance.damping', _WANTED.damping, 'Damping of the wanted impedance', 'N s/m',
          0.1, 1e6),
    _live('impedance.stiffness', _WANTED.stiffness, 'Stiffness of the wanted impedance', 'N/m',
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
    *parameters_of('limits', Bounds(), 'speed', 'acceleration', 'force', 'free_force', 'margin',
                   'deviation', 'stop_duration', 'retract', 'withdraw', 'touch'),
    *parameters_of('limits', _LIMITS, 'workspace_max', 'tip', 'tracking_error'),
    *(row._replace(description=_DESCRIPTIONS[row.name.partition('.')[2]])
      for row in parameters_of('limits', _LIMITS, *_DESCRIPTIONS)),
    _live('watch.pause_timeout', WATCH.pause_timeout, 'Silence of the observer, the pose or the '
          'displacement that makes the reference stand', 's', 0.008, 10.0),
    _live('watch.lost_timeout', WATCH.lost_timeout, 'Silence or lateness for that long stops',
          's', 0.01, 60.0),
    _live('watch.frozen_timeout', WATCH.frozen_timeout, 'Readings that repeat to the last bit '
          'for that long in motion stop; 0: not checked', 's', 0.0, 10.0),
    _live('watch.max_age', WATCH.max_age, 'Age of its newest header stamp above which a topic '
          'is late; 0: not checked, for clocks that are not synchronised', 's', 0.0, 10.0),
    _live('watch.clock_timeout', WATCH.clock_timeout, 'With use_sim_time, a clock that stands '
          'still for longer stops', 's', 0.02, 60.0),
    *POSE_PARAMETERS,
    Parameter('motion.frame', '', 'frame_id of commands: the robot base link; empty: that of '
              'current_pose, from which it may not differ'),
    Parameter('motion.deadman_timeout', 0.0, 'Silence of the topic deadman that stops a motion; '
              '0: no dead-man switch', 's', 0.0, 10.0),
    Parameter('optidrive.joint', 'optidrive', 'Name in the JointState of the compliant tool; '
              'empty: the tool is rigid'),
)


class ImpedanceSettings(NamedTuple):
    """Settings of one contact task."""

    task: Task
    cycles: int
    bounds: Bounds
    limits: Limits
    watch: WatchSettings
    wanted: Wanted
    design: DesignSettings


def settings_of(value: Mapping[str, Any]) -> ImpedanceSettings:
    """
    Make settings of the values of all ``PARAMETERS``, by name.

    Raises
    ------
    ConfigError
        Values contradict each other.
    """
    return ImpedanceSettings(
        section_of(Task, value, 'task'), value['task.cycles'], section_of(Bounds, value, 'limits'),
        section_of(Limits, value, 'limits'), section_of(WatchSettings, value, 'watch'),
        section_of(Wanted, value, 'impedance'), _design(value))


def _design(value: Mapping[str, Any]) -> DesignSettings:
    def given(name: str) -> float | None:
        return value[f'design.{name}'] or None

    gain = tuple(value['design.state_gain'])
    low, high = value['design.softest_wall'], value['design.stiffest_wall']
    return DesignSettings(
        effort=value['design.effort'], latency=value['design.latency'],
        wall_stiffness=(low, high), state_gain=gain if any(gain) else None,
        force_gain=given('force_gain'), position_gain=given('position_gain'))
