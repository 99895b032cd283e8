"""Impedance control with the observer's force: a contact task, one command every 4 ms."""

from collections.abc import Sequence

from forcecal_ros.core.geometry import Array
from forcecal_ros.impedance.design import stable_law
from forcecal_ros.impedance.law import Measurement, Regulator
from forcecal_ros.impedance.plant import load_plant
from forcecal_ros.impedance.session import Session
from forcecal_ros.motion.limits import check_workspace
from forcecal_ros.motion.profiles import Pose, Setpoint
from forcecal_ros.nodes.backends import TargetFrame
from forcecal_ros.nodes.impedance_settings import ImpedanceSettings, PARAMETERS, settings_of
from forcecal_ros.nodes.motion_node import MotionNode
from forcecal_ros.nodes.pose_source import at_sensor, mounting_parameter, pose_source
from forcecal_ros.nodes.runtime import run, SECOND
from forcecal_ros.nodes.sensors import Deadman, Input, Sensors
from forcecal_ros.nodes.wire import JointReader, Reader
from geometry_msgs.msg import WrenchStamped
import numpy as np
from sensor_msgs.msg import JointState


class Impedance(MotionNode[ImpedanceSettings]):
    """Runs one contact task at a time, from start to done or aborted."""

    def __init__(self) -> None:
        super().__init__('impedance', PARAMETERS, settings_of)
        self._plant = load_plant(self.get_parameter('plant').value or None)
        self._law = stable_law(self._plant, self._settings.wanted, self._settings.design)
        self._session = Session(self._law.period)
        sensors = self._listen()
        self._serve(self._session, sensors, TargetFrame(self, self._inbox, sensors),
                    round(SECOND * self._law.period))

    def _listen(self) -> Sensors:
        poses = pose_source(self)
        inputs = [
            Input('wrench', 'observer/contact_wrench', WrenchStamped, Reader(WrenchStamped)),
            Input.of_pose(poses._replace(read=at_sensor(poses.read, mounting_parameter(self)))),
            # a sensor that is stuck shows here only: the estimate of the observer goes on changing
            Input('sensor', 'wrench', WrenchStamped, Reader(WrenchStamped))]
        if joint := self.get_parameter('optidrive.joint').value:
            inputs.append(Input('optidrive', 'optidrive', JointState, JointReader(joint)))
        deadman = Deadman(self._inbox, self.get_parameter('motion.deadman_timeout').value)
        return Sensors(self._inbox, inputs, deadman, self._settings.watch, self._settings.limits)

    def _new_settings(self) -> ImpedanceSettings:
        before, settings = self._settings, super()._new_settings()
        if (settings.wanted, settings.design) != (before.wanted, before.design):
            self._law = stable_law(self._plant, settings.wanted, settings.design)
        return settings

    def _begin(self) -> str:
        settings = self._settings
        self._home = self._sensors.measured_pose()
        self._axis: Array = self._home.R_base_sensor[:, 0]
        self._slide = self._sensors.newest('optidrive')[0]
        program = settings.task.program(settings.cycles)
        self._check_reach(program.farthest)
        self._session.start(program, settings.task.clearance, Regulator(self._law),
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

    def _measured(self) -> Measurement:
        position = np.array(self._sensors.newest('pose')[:3])
        return Measurement(float((position - self._home.position) @ self._axis),
                           self._sensors.newest('optidrive')[0] - self._slide,
                           self._sensors.newest('wrench')[0])

    def _details(self) -> dict[str, object]:
        status = self._session.status
        return {'contacts': status.contacts, 'missed': status.missed}

    def _figures(self) -> dict[str, object]:
        return {**self._details(), 'commands held to the limits': self._session.status.limited}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('impedance', Impedance, arguments)


if __name__ == '__main__':
    raise SystemExit(main())
