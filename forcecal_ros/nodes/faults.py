"""Fault injection: parameters of the simulated rig's node that act at once while it runs."""

from collections.abc import Callable
from typing import Any

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.nodes.parameters import refuse_changes
from forcecal_ros.sim.rig.faults import (
    CLOCK_FAULTS,
    CLOCK_JUMP,
    FAULTS,
    ROBOT_FAULTS,
    RobotFault,
    SensorFault,
    SENSORS,
)
from forcecal_ros.sim.rig.simulator import Samples
from rclpy.node import Node

PREFIX = 'fault.'


def _row(name: str, what: str, kinds: dict[str, str]) -> Parameter:
    meaning = '; '.join(f'{word}: {meaning}' for word, meaning in kinds.items())
    return Parameter(PREFIX + name, 'none', f'Fault of {what}, at once. {meaning}',
                     choices=tuple(kinds), live=True)


PARAMETERS = (
    *(_row(sensor, f'the sensor {sensor}', FAULTS) for sensor in SENSORS),
    _row('robot', 'the robot', ROBOT_FAULTS),
    _row('clock', 'the clock that is published', CLOCK_FAULTS),
)


class Faults:
    """
    The injected faults of one simulated rig.

    Parameters
    ----------
    node : Node
        Has declared ``PARAMETERS``.
    seed : int or None
        Of garbage readings.
    jump : callable or None
        Makes the published clock jump [ns]; None where no clock is published.
    """

    def __init__(self, node: Node, seed: int | None, jump: Callable[[int], None] | None) -> None:
        self._sensors = {sensor: SensorFault(sensor, seed) for sensor in SENSORS}
        self._robot = RobotFault()
        self._jump = jump
        self._clock = 'none'
        refuse_changes(node, self._check)
        node.add_post_set_parameters_callback(
            lambda changes: self._set({change.name: change.value for change in changes}))
        start = {row.name: node.get_parameter(row.name).value for row in PARAMETERS}
        self._check(start)
        self._set(start)

    def _check(self, values: dict[str, Any]) -> None:
        if self._jump is None and values.get('fault.clock', 'none') != 'none':
            raise ConfigError('fault.clock wants a clock that this node publishes; set '
                              'clock.publish')

    def _set(self, values: dict[str, Any]) -> None:
        for name, kind in values.items():
            part = name.removeprefix(PREFIX)
            if not name.startswith(PREFIX):
                continue
            if part == 'clock':
                self._set_clock(kind)
            elif part == 'robot':
                self._robot.kind = kind
            else:
                self._sensors[part].kind = kind

    def _set_clock(self, kind: str) -> None:
        before, self._clock = self._clock, kind
        if self._jump is not None and kind != before and kind in ('forward', 'back'):
            self._jump(round(CLOCK_JUMP * 1e9) * (1 if kind == 'forward' else -1))

    @property
    def clock_stopped(self) -> bool:
        """Whether the published clock stands still."""
        return self._clock == 'stopped'

    @property
    def active(self) -> list[str]:
        """The faults that are switched on, such as ``wrench stuck``."""
        named = [*((s, f.kind) for s, f in self._sensors.items()), ('robot', self._robot.kind),
                 ('clock', self._clock)]
        return [f'{name} {kind}' for name, kind in named if kind != 'none']

    @property
    def runaway(self) -> bool:
        """Whether the robot moves without new commands."""
        return self._robot.kind == 'runaway'

    def command(self, position: Array, period: float) -> Array | None:
        """Return the command after faults of the robot, shape (3,) [m]; None: it is ignored."""
        return self._robot(position, period)

    def changed(self, samples: Samples) -> Samples:
        """Return the samples after faults of the sensors."""
        for fault in self._sensors.values():
            samples = fault(samples)
        return samples
