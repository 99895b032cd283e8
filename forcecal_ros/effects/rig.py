"""The rig as data: every number of the simulated robot, tool, environment and sensors.

The rows are those of the rig file, see :mod:`forcecal_ros.sim.rig.file`. To change a
number, ``dataclasses.replace`` the section and the rig; arrays are taken and kept as tuples, so
that rigs compare and hash.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
import math
from typing import Annotated, Any

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion, rotation_from_vector
from forcecal_ros.core.schema import Matrix3, Row, Section, Vector3, Vector4, Vector6
from forcecal_ros.effects.library import (
    Chosen,
    chosen_effects,
    Effect,
    named_effects,
    SLIDE_ONLY,
    Values,
)
import numpy as np


class _Effects(Row):
    """Row of the effects; their own rows are those of the library."""

    def take(self, kind: Any, value: Any, where: str) -> Chosen:
        """Check the effects of a rig."""
        return chosen_effects(value)


def _check_equation(where: str, feedback: Vector3, feedforward: Vector3) -> None:
    """Refuse a difference equation that is unstable or rests elsewhere than commanded."""
    poles = np.roots([1.0, *(-c for c in feedback)])
    if np.abs(poles).max(initial=0.0) >= 1.0:
        raise ConfigError(f'{where}.feedback: unstable, a pole of magnitude '
                          f'{np.abs(poles).max():.4f}; all must be below 1')
    gain = sum(feedforward) / (1.0 - sum(feedback))
    if abs(gain - 1.0) > 1e-6:
        raise ConfigError(f'{where}.feedforward: static gain {gain:.6f}, expected 1, so that the '
                          'robot reaches its command')


Directions = tuple[Vector6, Vector6, Vector6, Vector6, Vector6]
"""Of six numbers of which one follows from the others."""


@dataclass(frozen=True)
class Axis(Section, name='robot'):
    """How position along one axis of base follows; commands are delayed, then filtered."""

    delay: Annotated[float, Row('of the commands', 's', 0.0, 1.0)]
    feedback: Annotated[Vector3, Row('of y at k-1, k-2, k-3', '1')]
    feedforward: Annotated[Vector3, Row('of the delayed command at k, k-1, k-2', '1')]
    tolerance: Annotated[Directions | None, Row(
        'independent 1-sigma changes of these six', '1', omit=True)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_equation(self.section, self.feedback, self.feedforward)


@dataclass(frozen=True)
class Unexplained(Section):
    """What the model of the robot leaves of a motion that it was not fitted to, beyond noise."""

    position: Annotated[float, Row('RMS', 'm', 0.0)]
    orientation: Annotated[float, Row('RMS', 'rad', 0.0)]
    position_offset: Annotated[float, Row('mean, in addition to the RMS', 'm', 0.0)] = 0.0
    orientation_offset: Annotated[float, Row('mean, in addition to the RMS', 'rad', 0.0)] = 0.0

    def beyond(self, sensor: 'PoseSensor') -> bool:
        """Whether that shows in single poses: half of their noise is a quarter of its power."""
        return (max(self.position, self.position_offset) > 0.5 * sensor.position_noise or
                max(self.orientation, self.orientation_offset) > 0.5 * sensor.orientation_noise)


@dataclass(frozen=True)
class Robot(Section):
    """One model per Cartesian axis, [Gamez2005] Eq. 28 as difference equation."""

    period: Annotated[float, Row('of Eq. 28 and of the commands', 's', above=0.0)]
    feedback: Annotated[Vector3, Row('of y at k-1, k-2, k-3', '1')]
    feedforward: Annotated[Vector3, Row('of the command at k-1, k-2, k-3', '1')]
    x: Annotated[Axis | None, Row('replaces Eq. 28', omit=True)] = None
    y: Annotated[Axis | None, Row('replaces Eq. 28', omit=True)] = None
    z: Annotated[Axis | None, Row('replaces Eq. 28', omit=True)] = None
    unexplained: Annotated[Unexplained | None, Row(
        'RMS of measured minus simulated motion, without noise', omit=True)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_equation('robot', self.feedback, self.feedforward)

    @property
    def axes(self) -> tuple[Axis | None, Axis | None, Axis | None]:
        """Models of the axes that have one of their own."""
        return self.x, self.y, self.z


@dataclass(frozen=True)
class Servo(Section):
    """What follows the interpolated output of the robot model."""

    position_bandwidth: Annotated[float, Row('third order, critically damped', 'rad/s', above=0.0)]
    orientation_bandwidth: Annotated[float, Row(
        'second order on SO(3), critically damped', 'rad/s', above=0.0)]
    orientation_damping: Annotated[float | None, Row(
        'damping ratio; absent: 1', '1', above=0.0, omit=True)] = None
    orientation_delay: Annotated[float | None, Row(
        'delay of the commanded orientations; absent: 0', 's', 0.0, 1.0, omit=True)] = None
    orientation_tolerance: Annotated[Matrix3 | None, Row(
        'independent 1-sigma changes of bandwidth, damping, delay', omit=True)] = None


@dataclass(frozen=True)
class Tool(Section):
    """What the sensor carries; in ft_sensor, without displacement."""

    mass: Annotated[float, Row('', 'kg', above=0.0)]
    com: Annotated[Vector3, Row('centre of mass', 'm')]
    inertia: Annotated[Matrix3, Row('about the CoM', 'kg m^2')]
    tip: Annotated[Vector3, Row('point that touches the wall', 'm')]

    def __post_init__(self) -> None:
        super().__post_init__()
        inertia = np.array(self.inertia)
        if not np.allclose(inertia, inertia.T) or np.linalg.eigvalsh(inertia)[0] < 0.0:
            raise ConfigError('tool.inertia: expected a symmetric matrix without negative '
                              f'eigenvalues, got {self.inertia}; check the off-diagonal signs')


@dataclass(frozen=True)
class Optidrive(Section):
    """The compliance along x of ft_sensor, [Gamez2005] Eq. 29."""

    stiffness: Annotated[float, Row('', 'N/m', above=0.0)]
    damping: Annotated[float, Row('', 'N s/m', 0.0)]
    rate: Annotated[float, Row('of the displacement signal', 'Hz', above=0.0)]
    noise: Annotated[float, Row('1 sigma, white', 'm', 0.0)]


@dataclass(frozen=True)
class Wall(Section):
    """Unilateral screen, normal to X of base, in front of the tip."""

    position: Annotated[float, Row('X of base', 'm')]
    stiffness: Annotated[float, Row('', 'N/m', 0.0)]
    damping: Annotated[float, Row('', 'N s/m', 0.0)]


@dataclass(frozen=True)
class WrenchSensor(Section, name='wrench_sensor'):
    """wire = gain * (wrench of the environment on the tool) + bias + noise."""

    rate: Annotated[float, Row('', 'Hz', above=0.0)]
    gain: Annotated[Vector6, Row('fx fy fz tx ty tz', '1')]
    bias: Annotated[Vector6, Row('', 'N, N m')]
    force_noise: Annotated[float, Row('1 sigma, white', 'N', 0.0)]
    torque_noise: Annotated[float, Row('1 sigma, white', 'N m', 0.0)]


@dataclass(frozen=True)
class AccelerometerModel(Section):
    """V = gain f + offset + noise, f high-passed first if the sensor is AC-coupled."""

    gain: Annotated[Vector3, Row('x y z', 'V/(m/s^2)')]
    offset: Annotated[Vector3, Row('', 'V')]
    highpass: Annotated[float, Row('first order; 0: DC response', 'Hz', 0.0)]

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0.0 in self.gain:
            raise self.wrong('gain', 'non-zero gains')


@dataclass(frozen=True)
class Accelerometer(Section):
    """Rides on the tool, axes along ft_sensor; V = gain f + offset + noise."""

    mounted: Annotated[str, Row('sensor that is used', words=('acc1', 'acc2'))]
    position: Annotated[Vector3, Row('in ft_sensor, without displacement', 'm')]
    rate: Annotated[float, Row('', 'Hz', above=0.0)]
    noise: Annotated[float, Row('1 sigma, white', 'V', 0.0)]
    acc1: Annotated[AccelerometerModel, Row('PCB, capacitive, DC')]
    acc2: Annotated[AccelerometerModel, Row('AD, MEMS, high-passed before gain and offset')]

    def model(self, name: str | None = None) -> AccelerometerModel:
        """
        Return one of the two.

        Parameters
        ----------
        name : str, optional
            ``acc1`` or ``acc2``; the mounted one where none is given.

        Raises
        ------
        ConfigError
            Another name.
        """
        models = {'acc1': self.acc1, 'acc2': self.acc2}
        if (name or self.mounted) not in models:
            raise ConfigError(f'accelerometer {name!r}: expected one of {", ".join(models)}')
        return models[name or self.mounted]


@dataclass(frozen=True)
class PoseSensor(Section, name='pose_sensor'):
    """The measured pose of ft_sensor in base."""

    rate: Annotated[float, Row('', 'Hz', above=0.0)]
    position_noise: Annotated[float, Row('1 sigma, white, per axis', 'm', 0.0)]
    orientation_noise: Annotated[float, Row(
        '1 sigma, white, rotation vector in S, per axis', 'rad', 0.0)]


@dataclass(frozen=True)
class NominalTolerances(Section):
    """Nominal tolerances: how far a healthy rig departs from its file, 1 sigma."""

    mass: Annotated[float, Row('relative', '1', 0.0)]
    com: Annotated[float, Row('', 'm', 0.0)]
    inertia: Annotated[float, Row('relative', '1', 0.0)]
    stiffness: Annotated[float, Row('relative, of the compliance', '1', 0.0)]
    damping: Annotated[float, Row('relative, of the compliance', '1', 0.0)]
    wall_position: Annotated[float, Row('', 'm', 0.0)]
    wall_stiffness: Annotated[float, Row('relative', '1', 0.0)]
    wall_damping: Annotated[float, Row('relative', '1', 0.0)]
    force_bias: Annotated[float, Row('', 'N', 0.0)]
    torque_bias: Annotated[float, Row('', 'N m', 0.0)]
    wrench_gain: Annotated[float, Row('relative', '1', 0.0)]
    accelerometer_gain: Annotated[float, Row('relative', '1', 0.0)]
    accelerometer_offset: Annotated[float, Row('', 'V', 0.0)]
    noise_factor: Annotated[float, Row('factor of noise levels, up or down', '1', 1.0)]


@dataclass(frozen=True)
class Home(Section):
    """Where ft_sensor starts, in base; Rot(X, pi) has x_S along X and z_S down."""

    position: Annotated[Vector3, Row('', 'm')]
    orientation_xyzw: Annotated[Vector4, Row('quaternion x y z w', '1')]

    def __post_init__(self) -> None:
        super().__post_init__()
        norm = math.hypot(*self.orientation_xyzw)
        if abs(norm - 1.0) > 1e-3:
            raise ConfigError(f'home.orientation_xyzw: expected a unit quaternion, got norm '
                              f'{norm:.4f}; divide by it')

    @property
    def R_base_sensor(self) -> Array:
        """Rotation matrix, shape (3, 3)."""
        return matrix_from_quaternion(self.orientation_xyzw)


@dataclass(frozen=True)
class Step(Section):
    """The default step: a quintic (minimum-jerk) profile."""

    distance: Annotated[float, Row('', 'm')]
    duration: Annotated[float, Row('', 's', above=0.0)]


@dataclass(frozen=True)
class Rig(Section):
    """
    The whole rig.

    Without ``optidrive`` the tool is rigid: its displacement is 0 and there is no such signal.
    ``effects`` are in what it differs from the other numbers, see
    :func:`~forcecal_ros.effects.with_effects`.
    """

    robot: Robot
    servo: Servo
    tool: Tool
    optidrive: Annotated[Optidrive | None, Row(
        'Compliance of the tool along x of ft_sensor; null: a rigid tool')]
    wall: Wall
    wrench_sensor: WrenchSensor
    accelerometer: Accelerometer
    pose_sensor: PoseSensor
    spreads: NominalTolerances
    gravity: Annotated[Vector3, Row('in base', 'm/s^2')]
    home: Home
    step: Step
    effects: Annotated[Chosen, _Effects()] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, _ in self.effects:
            if name in SLIDE_ONLY and self.optidrive is None:
                raise ConfigError(f'effects: {name} requires an optidrive, but the rig has none; '
                                  'remove the effect')
        for name in ('wrench_sensor', 'accelerometer', 'optidrive', 'pose_sensor'):
            section = getattr(self, name)
            if section is None:
                continue
            samples = section.rate * self.robot.period
            if samples < 0.5 or abs(samples - round(samples)) > 1e-6:
                raise ConfigError(f'{name}.rate: {section.rate:g} Hz is not an integer multiple '
                                  f'of {1.0 / self.robot.period:g} Hz, the rate of robot.period')

    def samples_per_period(self, sensor: str) -> int:
        """Return how many samples a sensor, named as its section, gives in one robot period."""
        return round(float(getattr(self, sensor).rate) * self.robot.period)


Named = Mapping[str, float]


def scaled(section: str, name: str, index: int | None = None) -> Callable[[Rig, float], Rig]:
    """Change a number of a section, or one of a vector, by a relative amount."""
    return _changed(section, name, index, lambda value, x: value * (1 + x))


def shifted(section: str, name: str, index: int | None = None) -> Callable[[Rig, float], Rig]:
    """Change a number of a section, or one of a vector, by a difference; '': of the rig itself."""
    return _changed(section, name, index, lambda value, x: value + x)


def _changed(section: str, name: str, index: int | None, by: Callable[[float, float], float]
             ) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        part: Any = getattr(rig, section) if section else rig
        old = getattr(part, name)
        new = by(old, x) if index is None else with_entry(old, index, by(old[index], x))
        part = replace(part, **{name: new})
        return replace(rig, **{section: part}) if section else part
    return apply


def with_entry(values: Any, index: int, value: float) -> Any:
    """Return a vector of a section with another number at one place."""
    return (*values[:index], float(value), *values[index + 1:])


def _by(*changes: tuple[str, Callable[[Rig, float], Rig]]) -> Callable[[Rig, Named], Rig]:
    """Change a rig by parameters of an effect, each by what it does."""
    def apply(rig: Rig, v: Named) -> Rig:
        for parameter, change in changes:
            rig = change(rig, v[parameter])
        return rig
    return apply


def _base_tilt(rig: Rig, v: Named) -> Rig:
    """Gravity in a base that is tilted by a rotation vector about its X and Y."""
    R_level_base = rotation_from_vector(np.array([v['x'], v['y'], 0.0]))
    x, y, z = R_level_base.T @ rig.gravity
    return replace(rig, gravity=(x, y, z))


NUMBERS: Mapping[str, Callable[[Rig, Named], Rig]] = {
    'tool_mass': _by(('change', scaled('tool', 'mass'))),
    'tool_com': _by(*((axis, shifted('tool', 'com', i)) for i, axis in enumerate('xyz'))),
    'tool_stiffness': _by(('change', scaled('optidrive', 'stiffness'))),
    'tool_damping': _by(('change', scaled('optidrive', 'damping'))),
    'contact_stiffness': _by(('change', scaled('wall', 'stiffness'))),
    'contact_damping': _by(('change', scaled('wall', 'damping'))),
    'wall_position': _by(('shift', shifted('wall', 'position'))), 'base_tilt': _base_tilt,
}
"""Name of the effect -> the rig with its numbers."""


def physical_rig(rig: Rig) -> Rig:
    """
    Apply the effects that change numbers of the rig.

    Returns
    -------
    Rig
        Without these effects, with the others.
    """
    others = tuple(one for one in rig.effects if one[0] not in NUMBERS)
    for name, values in named_effects(rig.effects).items():
        if name in NUMBERS:
            rig = NUMBERS[name](rig, values)
    return rig if others == rig.effects else replace(rig, effects=others)


def applicable(effect: Effect, rig: Rig) -> bool:
    """Say whether a rig can have an effect at all: a rigid tool has none of a slide."""
    return rig.optidrive is not None or effect.name not in SLIDE_ONLY


def with_effects(rig: Rig, effects: Values) -> Rig:
    """
    Add effects to a rig; one that it has already gets the new values.

    Parameters
    ----------
    effects : mapping of str to mapping of str to float
        Parameters that are not named stay at their nominal value.

    Raises
    ------
    ConfigError
        No such effect or parameter, a value outside its limits, an effect that this rig cannot
        have.
    """
    together = {**named_effects(rig.effects), **named_effects(chosen_effects(effects))}
    return replace(rig, effects=chosen_effects(together))
