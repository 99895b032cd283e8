"""A tool on a sensor that is carried along: what is known of both, and how well."""

from dataclasses import dataclass, fields, replace
from typing import Annotated

from forcecal_ros.calibration.model import Accelerometer, Calibration, Estimate
from forcecal_ros.diagnose.nuisances import possible, rows_of
from forcecal_ros.effects import named_effects, physical_rig
from forcecal_ros.effects.rig import AccelerometerModel, Rig, Spreads, Tool
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import Recording
from forcecal_ros.schema import Row
import numpy as np

UNKNOWN_DELAY = 0.01
"""Between two sensors whose calibration does not tell it, 1 sigma [s]; three are a slow driver."""

GYRATION = 0.05
"""Radius that the inertia of a tool is of, 1 sigma, where none is known: a gripper's [m]."""


@dataclass(frozen=True)
class BodySpreads(Spreads):
    """Nominal tolerances, and those of what a calibration may not know."""

    accel_behind: Annotated[float, Row('of accel_behind', 's', 0.0)] = 0.0
    own_inertia: Annotated[float, Row('absolute', 'kg m^2', 0.0)] = 0.0


@dataclass(frozen=True)
class Body(Rig):
    """A rig of which only tool and sensors count, and whose sensors' stamps may be apart."""

    spreads: Annotated[BodySpreads, Row('')]
    accel_behind: Annotated[float, Row(
        'how much later than the wrench the accelerometer shows the same instant', 's')] = 0.0

    @property
    def accelerometer_unit(self) -> str:
        """Of its accelerometer's readings: ``m/s^2`` where they need no gain."""
        return 'm/s^2' if set(self.accelerometer.model().gain) == {1.0} else 'V'


def body_of_rig(rig: Rig) -> Body:
    """Take tool and sensors of a rig; its sensors have one clock."""
    own = {f.name: getattr(rig, f.name) for f in fields(Rig)}
    tolerances = {f.name: getattr(rig.spreads, f.name) for f in fields(Spreads)}
    return Body(**{**own, 'spreads': BodySpreads(**tolerances)})


def body_of_calibration(calibration: Calibration, rig: Rig) -> Body:
    """
    Take tool and sensors as they were calibrated.

    Parameters
    ----------
    calibration : Calibration
    rig : Rig
        Gives the tolerances: a sensor's zero drifts also after it was calibrated.

    Returns
    -------
    Body
        Its accelerometer speaks m/s^2, see :func:`as_specific_force`.
    """
    c, a, tool = calibration, calibration.accelerometer, rig.tool
    inertia = np.zeros((3, 3)) if c.inertia is None else c.inertia.value
    changed: Tool = replace(tool, mass=float(c.mass), com=_three(c.com.value),
                            inertia=rows_of(possible(inertia)))
    body = body_of_rig(replace(rig, effects=(), optidrive=None))
    place = changed.com if a is None or a.position is None else _three(a.position.value)
    scale = AccelerometerModel((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0)
    return replace(
        body, tool=changed, gravity=(0.0, 0.0, -c.gravity), spreads=_tolerances(c, body.spreads),
        wrench_sensor=replace(rig.wrench_sensor, gain=(1.0,) * 6,
                              bias=tuple(c.wrench_bias.value.tolist())),
        accelerometer=replace(rig.accelerometer, mounted='acc1', acc1=scale, position=place),
        accel_behind=0.0 if a is None else float(a.delay))


def _tolerances(c: Calibration, usual: BodySpreads) -> BodySpreads:
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


def as_specific_force(recording: Recording, accelerometer: Accelerometer | None) -> Recording:
    """
    Bring an accelerometer's readings to m/s^2 along the axes of ft_sensor.

    Parameters
    ----------
    accelerometer : Accelerometer or None
        As calibrated; without, its readings are left out.

    Raises
    ------
    DataError
        It was calibrated in another unit.
    """
    stream = recording.accelerometer
    if stream is None or accelerometer is None:
        return replace(recording, accelerometer=None)
    if recording.accelerometer_unit != accelerometer.unit:
        raise DataError(f'the accelerometer speaks {recording.accelerometer_unit}, it was '
                        f'calibrated in {accelerometer.unit}; calibrate with this one')
    f = np.linalg.solve(accelerometer.matrix,
                        (stream.values - accelerometer.offset.value).T).T
    return replace(recording, accelerometer=replace(stream, values=f),
                   accelerometer_unit='m/s^2')


def patched(calibration: Calibration, body: Body, delay_std: float | None,
            inertia_std: tuple[float, float, float] | None = None) -> Calibration:
    """
    Give a calibration what was found: biases, mass, centre of mass, inertia, delay.

    Parameters
    ----------
    body : Body
        With what was recalibrated, and the effects.
    delay_std : float or None
        Standard error of the delay between the sensors [s]; None where nothing told it.
    inertia_std : tuple of 3 float or None
        The same of the inertia about each axis [kg m^2].
    """
    c, a, found = calibration, calibration.accelerometer, physical_rig(body)
    named = named_effects(body.effects)
    if a is not None:
        behind = (body.accel_behind + named.get('accel_delay', {}).get('delay', 0.0)
                  - named.get('wrench_delay', {}).get('delay', 0.0))
        bias = named.get('accel_bias', {})
        off = np.array(body.accelerometer.model().offset) + [bias.get(x, 0.0) for x in 'xyz']
        std = a.delay.std if delay_std is None else delay_std
        a = replace(a, delay=Estimate(behind if delay_std is not None else float(a.delay), std,
                                      's'),
                    offset=Estimate(a.offset.value + a.matrix @ off, a.offset.std,
                                    a.offset.unit))
    inertia = c.inertia
    if inertia_std is not None:
        std = np.array(inertia_std)
        inertia = Estimate(found.tool.inertia, np.sqrt(np.outer(std, std)), 'kg m^2')
    return replace(
        c, inertia=inertia, mass=Estimate(found.tool.mass, c.mass.std, 'kg'),
        com=Estimate(found.tool.com, c.com.std, 'm'), accelerometer=a,
        wrench_bias=Estimate(body.wrench_sensor.bias, c.wrench_bias.std, c.wrench_bias.unit))
