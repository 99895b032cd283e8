"""Impedance control with the observed contact force: a contact task, one command a period."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.parameters import Parameter, parameters_of, section_of
from forcecal_ros.impedance import law
from forcecal_ros.impedance.law import design, DesignSettings, TargetImpedance
from forcecal_ros.impedance.plant import load_plant
from forcecal_ros.impedance.session import Bounds, Session, Task
from forcecal_ros.motion.limits import check_workspace, Limits
from forcecal_ros.motion.monitor import WatchSettings
from forcecal_ros.motion.profiles import Pose, Setpoint
from forcecal_ros.nodes import inputs
from forcecal_ros.nodes.backends import TargetFrame
from forcecal_ros.nodes.motion_node import MotionNode
from forcecal_ros.nodes.runtime import EXECUTOR, run, SECOND
from forcecal_ros.nodes.runtime import live_parameter as _live
from geometry_msgs.msg import WrenchStamped
import numpy as np

_LIMITS = Limits()
_DESIGN = DesignSettings(latency=2)

WATCH = WatchSettings(pause_timeout=0.025, lost_timeout=0.029, frozen_timeout=0.03, max_age=0.03,
                      most_pauses=0)
"""With these the robot rests within 0.1 s after a topic falls silent: 29 ms until that is found,
62 ms of ``limits.stop_duration``."""

_DESCRIPTIONS = {
    'jerk': 'Largest jerk; the motion stops above limits.overspeed times this',
    'torque': 'Norm of the contact torque above which the motion stops',
}
"""Of limits that mean something else here, where nothing is planned before the start."""


PARAMETERS = (
    EXECUTOR,
    _live('task.cycles', 1, 'Number of cycles of free motion, contact and move back',
          '', 1, 100_000),
    *parameters_of('task', Task()),
    *parameters_of('impedance', TargetImpedance()),
    Parameter('plant', '', 'Model of robot and tool, a file of forcecal fit-rig --for impedance; '
              'empty: that of the nominal rig'),
    *parameters_of('design', _DESIGN, 'latency', 'effort'),
    _live('design.softest_wall', _DESIGN.wall_stiffness[0], 'Softest wall against which the loop '
          'must be stable to start', 'N/m', 0.1, 1e7),
    _live('design.stiffest_wall', _DESIGN.wall_stiffness[1], 'Stiffest wall against which the '
          'loop must be stable to start', 'N/m', 0.1, 1e7),
    _live('design.state_gain', [0.0], 'L of the control law; [0.0]: the optimal one'),
    *parameters_of('design', _DESIGN, 'force_gain', 'position_gain'),
    *parameters_of('limits', Bounds(), 'speed', 'acceleration', 'force', 'free_force', 'margin',
                   'deviation', 'stop_duration', 'retract', 'withdraw', 'touch'),
    *parameters_of('limits', _LIMITS, 'workspace_min', 'workspace_max', 'tip', 'tracking_error',
                   'tracking_angle', 'overspeed'),
    *(row._replace(description=_DESCRIPTIONS[row.name.partition('.')[2]])
      for row in parameters_of('limits', _LIMITS, *_DESCRIPTIONS)),
    *parameters_of('watch', WATCH, 'pause_timeout', 'lost_timeout', 'frozen_timeout', 'max_age',
                   'clock_timeout'),
    *inputs.POSE_PARAMETERS,
    *inputs.COMMAND_PARAMETERS,
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
    target: TargetImpedance
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
        section_of(TargetImpedance, value, 'impedance'), _design(value))


def _design(value: Mapping[str, Any]) -> DesignSettings:
    gain = tuple(value['design.state_gain'])
    return replace(
        section_of(DesignSettings, value, 'design'), state_gain=gain if any(gain) else None,
        wall_stiffness=(value['design.softest_wall'], value['design.stiffest_wall']))


class Impedance(MotionNode):
    """Runs one contact task at a time, from start to done or aborted."""

    _settings: ImpedanceSettings

    def __init__(self) -> None:
        super().__init__('impedance', PARAMETERS, settings_of)
        self._plant = load_plant(self.get_parameter('plant').value or None)
        self._law = design(self._plant, self._settings.target, self._settings.design).law
        self._session = Session(self._law.period)
        sensors = self._listen()
        self._serve(self._session, sensors, TargetFrame(self, self._inbox, sensors),
                    round(SECOND * self._law.period))

    def _listen(self) -> inputs.Sensors:
        topics = [
            inputs.plain_input('wrench', 'observer/contact_wrench', WrenchStamped),
            inputs.at_sensor(inputs.pose_source(self), inputs.mounting_parameter(self)),
            # a sensor that is stuck shows here only: the estimate of the observer goes on changing
            inputs.plain_input('sensor', 'wrench', WrenchStamped)]
        if joint := self.get_parameter('optidrive.joint').value:
            topics.append(inputs.optidrive_input(joint)._replace(watched=True))
        deadman = inputs.Deadman(self._inbox, self.get_parameter('motion.deadman_timeout').value)
        return inputs.Sensors(self._inbox, topics, deadman, self._settings.watch,
                              self._settings.limits)

    def _new_settings(self) -> ImpedanceSettings:
        before, settings = self._settings, settings_of(self._values())
        if (settings.target, settings.design) != (before.target, before.design):
            self._law = design(self._plant, settings.target, settings.design).law
        return settings

    def _begin(self) -> str:
        settings = self._settings
        self._home = self._sensors.measured_pose()
        self._axis: Array = self._home.R_base_sensor[:, 0]
        self._slide = self._sensors.newest('optidrive')[0]
        program = settings.task.program(settings.cycles)
        self._check_reach(program.farthest)
        self._session.start(program, settings.task.clearance, law.Regulator(self._law),
                            settings.bounds)
        return f'contact task started: {program.duration:.1f} s'

    def _check_reach(self, reach: tuple[float, float]) -> None:
        """Refuse a task whose reference takes sensor or tip out of the workspace."""
        limits, home = self._settings.limits, self._home
        positions = home.position + np.outer(reach, self._axis)
        check_workspace(positions, limits, 'the task: the sensor')
        # the tool stops at the wall, wherever the reference goes behind it
        at_wall = home.position + np.outer(
            np.minimum(reach, self._settings.task.clearance), self._axis)
        check_workspace(at_wall + home.R_base_sensor @ limits.tip, limits, 'the task: the tip')

    def _command(self) -> Setpoint | None:
        offset = self._session.step(self._measured())
        if offset is None:
            return None
        return Setpoint(Pose(self._home.position + offset * self._axis,
                             self._home.R_base_sensor), np.zeros(3), np.zeros(3))

    def _measured(self) -> law.Measurement:
        position = np.array(self._sensors.newest('pose')[:3])
        return law.Measurement(float((position - self._home.position) @ self._axis),
                               self._sensors.newest('optidrive')[0] - self._slide,
                               self._sensors.newest('wrench')[0])

    def _details(self) -> dict[str, object]:
        status = self._session.status
        return {'contacts': status.contacts, 'missed': status.missed}

    def _figures(self) -> dict[str, object]:
        return {**self._details(), 'commands held to the limits': self._session.status.limited}


main = partial(run, 'impedance', Impedance, PARAMETERS)
"""Runs the node; takes the arguments, by default those of the process, and returns the status."""


if __name__ == '__main__':
    raise SystemExit(main())
