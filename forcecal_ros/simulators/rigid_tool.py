"""A rigid tool and its sensors, whatever carries them: what is known of both, and how well."""

from dataclasses import dataclass, fields, replace
from typing import Annotated

from forcecal_ros.calibration.model import Calibration, Estimate
from forcecal_ros.effects.nuisances import possible, rows_of
from forcecal_ros.effects.rig import AccelerometerModel, NominalTolerances, Rig, Tool
from forcecal_ros.geometry import Array
from forcecal_ros.schema import Row
import numpy as np

UNKNOWN_DELAY = 0.01
"""Delay between two sensors that no calibration tells, 1 sigma [s]; three are a slow driver."""

GYRATION = 0.05
"""Radius of gyration of a tool whose inertia is not known, 1 sigma: a gripper's [m]."""


@dataclass(frozen=True)
class RigidToolSpreads(NominalTolerances):
    """Nominal tolerances, and those of what a calibration may not know."""

    accel_behind: Annotated[float, Row('of accel_behind', 's', 0.0)] = 0.0
    own_inertia: Annotated[float, Row('absolute', 'kg m^2', 0.0)] = 0.0


@dataclass(frozen=True)
class RigidTool(Rig):
    """A rig of which only tool and sensors count, and whose sensors' stamps may be apart."""

    spreads: Annotated[RigidToolSpreads, Row('')]
    accel_behind: Annotated[float, Row(
        'how much later than the wrench the accelerometer shows the same instant', 's')] = 0.0

    @property
    def accelerometer_unit(self) -> str:
        """Of its accelerometer's readings: ``m/s^2`` where they need no gain."""
        return 'm/s^2' if set(self.accelerometer.model().gain) == {1.0} else 'V'


def rigid_tool_of_rig(rig: Rig) -> RigidTool:
    """Take tool and sensors of a rig; its sensors have one clock."""
    own = {f.name: getattr(rig, f.name) for f in fields(Rig)}
    tolerances = {f.name: getattr(rig.spreads, f.name) for f in fields(NominalTolerances)}
    return RigidTool(**{**own, 'spreads': RigidToolSpreads(**tolerances)})


def rigid_tool_of_calibration(calibration: Calibration, rig: Rig) -> RigidTool:
    """
    Take tool and sensors as they were calibrated.

    Parameters
    ----------
    rig : Rig
        Gives the tolerances: a sensor's zero drifts also after it was calibrated.

    Returns
    -------
    RigidTool
        Its accelerometer speaks m/s^2 along the axes of ft_sensor.
    """
    c, a, tool = calibration, calibration.accelerometer, rig.tool
    inertia = np.zeros((3, 3)) if c.inertia is None else c.inertia.value
    changed: Tool = replace(tool, mass=float(c.mass), com=_three(c.com.value),
                            inertia=rows_of(possible(inertia)))
    rigid_tool = rigid_tool_of_rig(replace(rig, effects=(), optidrive=None))
    place = changed.com if a is None or a.position is None else _three(a.position.value)
    scale = AccelerometerModel((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0)
    return replace(rigid_tool, tool=changed, gravity=(0.0, 0.0, -c.gravity),
                   spreads=_tolerances(c, rigid_tool.spreads),
                   wrench_sensor=replace(rig.wrench_sensor, gain=(1.0,) * 6,
                                         bias=tuple(c.wrench_bias.value.tolist())),
                   accelerometer=replace(rig.accelerometer, mounted='acc1', acc1=scale,
                                         position=place),
                   accel_behind=0.0 if a is None else float(a.delay))


def _tolerances(c: Calibration, usual: RigidToolSpreads) -> RigidToolSpreads:
    """Add what the calibration does not know to what changes from day to day."""
    mass, a = float(c.mass), c.accelerometer
    bias = _known(c.wrench_bias)
    late = np.inf if a is None else float(a.delay.std)
    offset = 0.0 if a is None else float(np.abs(
        np.linalg.solve(a.matrix, np.nan_to_num(a.offset.std))).max())
    gyration = mass * GYRATION ** 2
    return replace(
        usual, mass=float(np.hypot(usual.mass, _known(c.mass).max() / mass)),
        com=float(np.hypot(usual.com, _known(c.com).max())),
        force_bias=float(np.hypot(usual.force_bias, bias[:3].max())),
        torque_bias=float(np.hypot(usual.torque_bias, bias[3:].max())),
        accelerometer_offset=float(np.hypot(usual.accelerometer_offset, offset)),
        accel_behind=late if np.isfinite(late) else UNKNOWN_DELAY,
        own_inertia=gyration if c.inertia is None else min(gyration, _known(c.inertia).max()))


def _known(estimate: Estimate) -> Array:
    return np.nan_to_num(np.atleast_1d(estimate.std))


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
