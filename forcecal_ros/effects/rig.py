"""The rig as data: every number of the simulated robot, tool, environment and sensors.

The fields carry their unit, shape and limits as metadata, which the checks, the loader and the
dump in :mod:`forcecal_ros.simulators.rig.file` all read. To change a number,
``dataclasses.replace`` the section and the rig; arrays are taken and kept as tuples, so that rigs
compare and hash.
"""

from dataclasses import dataclass, field, fields
import math

from forcecal_ros.effects.chosen import Chosen, chosen_effects
from forcecal_ros.effects.library import SLIDE_ONLY
from forcecal_ros.effects.quantity import checked, choice, quantity
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array, matrix_from_quaternion
import numpy as np

Vector3 = tuple[float, float, float]
Vector4 = tuple[float, float, float, float]
Vector6 = tuple[float, float, float, float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]

_RATE_TOLERANCE = 1e-6
"""Largest deviation of a sensor's samples per period from a whole number that is rounding."""

_GAIN_TOLERANCE = 1e-6
"""Largest deviation of the robot's static gain from 1 that counts as rounding."""


@dataclass(frozen=True)
class Section:
    """A group of keys of the rig file; checks itself whenever it is made."""

    def __post_init__(self) -> None:
        for f in fields(self):
            if f.metadata:
                name = f'{type(self).__name__}.{f.name}'
                object.__setattr__(self, f.name, checked(name, getattr(self, f.name), f.metadata))


@dataclass(frozen=True)
class Robot(Section):
    """Commanded to reached position per Cartesian axis, [Gamez2005] Eq. 28."""

    period: float = field(metadata=quantity('s', 'of Eq. 28 and of the commands', positive=True))
    feedback: Vector3 = field(metadata=quantity('1', 'of y at k-1, k-2, k-3', (3,)))
    feedforward: Vector3 = field(metadata=quantity('1', 'of the command at k-1, k-2, k-3', (3,)))

    def __post_init__(self) -> None:
        super().__post_init__()
        poles = np.roots([1.0, *(-c for c in self.feedback)])
        if np.abs(poles).max() >= 1.0:
            raise ConfigError(f'robot.feedback: unstable, a pole of magnitude '
                              f'{np.abs(poles).max():.4f}; all must lie below 1')
        gain = sum(self.feedforward) / (1.0 - sum(self.feedback))
        if abs(gain - 1.0) > _GAIN_TOLERANCE:
            raise ConfigError(f'robot.feedforward: static gain {gain:.6f}; it must be 1, so that '
                              'the robot rests where it is told to')


@dataclass(frozen=True)
class Servo(Section):
    """What follows the interpolated output of the robot model."""

    position_bandwidth: float = field(metadata=quantity(
        'rad/s', 'third order, critically damped', positive=True))
    orientation_bandwidth: float = field(metadata=quantity(
        'rad/s', 'second order on SO(3), critically damped', positive=True))


@dataclass(frozen=True)
class Tool(Section):
    """What the sensor carries; in ft_sensor, the Optidrive undisplaced."""

    mass: float = field(metadata=quantity('kg', positive=True))
    com: Vector3 = field(metadata=quantity('m', 'centre of mass', (3,)))
    inertia: Matrix3 = field(metadata=quantity('kg m^2', 'about the CoM', (3, 3)))
    tip: Vector3 = field(metadata=quantity('m', 'the point that meets the wall', (3,)))

    def __post_init__(self) -> None:
        super().__post_init__()
        inertia = np.array(self.inertia)
        if not np.allclose(inertia, inertia.T) or np.linalg.eigvalsh(inertia)[0] < 0.0:
            raise ConfigError(f'tool.inertia: expected a symmetric matrix without negative '
                              f'eigenvalues, got {self.inertia}; mind the signs of the products')


@dataclass(frozen=True)
class Optidrive(Section):
    """The compliance along x of ft_sensor, [Gamez2005] Eq. 29."""

    stiffness: float = field(metadata=quantity('N/m', positive=True))
    damping: float = field(metadata=quantity('N s/m', least=0.0))
    rate: float = field(metadata=quantity('Hz', 'of the displacement signal', positive=True))
    noise: float = field(metadata=quantity('m', '1 sigma, white', least=0.0))


@dataclass(frozen=True)
class Wall(Section):
    """Unilateral screen, normal to X of base."""

    position: float = field(metadata=quantity('m', 'X of base'))
    stiffness: float = field(metadata=quantity('N/m', least=0.0))
    damping: float = field(metadata=quantity('N s/m', least=0.0))


@dataclass(frozen=True)
class WrenchSensor(Section):
    """wire = gain * (wrench of the environment on the tool) + bias + noise."""

    rate: float = field(metadata=quantity('Hz', positive=True))
    gain: Vector6 = field(metadata=quantity('1', 'fx fy fz tx ty tz', (6,)))
    bias: Vector6 = field(metadata=quantity('N, N m', '', (6,)))
    force_noise: float = field(metadata=quantity('N', '1 sigma, white', least=0.0))
    torque_noise: float = field(metadata=quantity('N m', '1 sigma, white', least=0.0))


@dataclass(frozen=True)
class AccelerometerModel(Section):
    """V = gain f + offset + noise, f high-passed where the sensor is AC-coupled."""

    gain: Vector3 = field(metadata=quantity('V/(m/s^2)', 'x y z', (3,)))
    offset: Vector3 = field(metadata=quantity('V', '', (3,)))
    highpass: float = field(metadata=quantity('Hz', 'first order; 0: DC response', least=0.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0.0 in self.gain:
            raise ConfigError(f'accelerometer: a gain of 0 measures nothing, got {self.gain}')


@dataclass(frozen=True)
class Accelerometer(Section):
    """The accelerometer on the tool, its axes along ft_sensor."""

    mounted: str = field(metadata=choice('which of the two below', ('acc1', 'acc2')))
    position: Vector3 = field(metadata=quantity(
        'm', 'in ft_sensor, the Optidrive undisplaced', (3,)))
    rate: float = field(metadata=quantity('Hz', positive=True))
    noise: float = field(metadata=quantity('V', '1 sigma, white', least=0.0))
    acc1: AccelerometerModel
    acc2: AccelerometerModel

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
class PoseSensor(Section):
    """The measured pose of ft_sensor in base."""

    rate: float = field(metadata=quantity('Hz', positive=True))
    position_noise: float = field(metadata=quantity('m', '1 sigma, white, per axis', least=0.0))
    orientation_noise: float = field(metadata=quantity(
        'rad', '1 sigma, white, rotation vector in S, per axis', least=0.0))


@dataclass(frozen=True)
class Spreads(Section):
    """Nominal tolerances: how far a healthy rig departs from its file, 1 sigma."""

    mass: float = field(metadata=quantity('1', 'relative', least=0.0))
    com: float = field(metadata=quantity('m', least=0.0))
    inertia: float = field(metadata=quantity('1', 'relative', least=0.0))
    stiffness: float = field(metadata=quantity('1', 'relative, of the Optidrive', least=0.0))
    damping: float = field(metadata=quantity('1', 'relative, of the Optidrive', least=0.0))
    wall_position: float = field(metadata=quantity('m', least=0.0))
    wall_stiffness: float = field(metadata=quantity('1', 'relative', least=0.0))
    wall_damping: float = field(metadata=quantity('1', 'relative', least=0.0))
    force_bias: float = field(metadata=quantity('N', least=0.0))
    torque_bias: float = field(metadata=quantity('N m', least=0.0))
    wrench_gain: float = field(metadata=quantity('1', 'relative', least=0.0))
    accelerometer_gain: float = field(metadata=quantity('1', 'relative', least=0.0))
    accelerometer_offset: float = field(metadata=quantity('V', least=0.0))
    noise_factor: float = field(metadata=quantity(
        '1', 'noise levels times or divided by this', least=1.0))


@dataclass(frozen=True)
class Home(Section):
    """Where ft_sensor starts, in base."""

    position: Vector3 = field(metadata=quantity('m', '', (3,)))
    orientation_xyzw: Vector4 = field(metadata=quantity('1', 'quaternion', (4,)))

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

    distance: float = field(metadata=quantity('m'))
    duration: float = field(metadata=quantity('s', positive=True))


@dataclass(frozen=True)
class Rig(Section):
    """
    The whole rig.

    Attributes
    ----------
    optidrive : Optidrive or None
        None where the tool is rigid: its displacement is 0 and there is no such signal.
    effects : Chosen
        In what it differs from the numbers above; see
        :func:`~forcecal_ros.effects.with_effects`.
    """

    robot: Robot
    servo: Servo
    tool: Tool
    optidrive: Optidrive | None
    wall: Wall
    wrench_sensor: WrenchSensor
    accelerometer: Accelerometer
    pose_sensor: PoseSensor
    spreads: Spreads
    gravity: Vector3 = field(metadata=quantity('m/s^2', 'in base', (3,)))
    home: Home
    step: Step
    effects: Chosen = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, 'effects', chosen_effects(self.effects))
        for name, _ in self.effects:
            if name in SLIDE_ONLY and self.optidrive is None:
                raise ConfigError(f'effects: {name} needs an optidrive, and this rig has none; '
                                  'remove the effect')
        for name in ('wrench_sensor', 'accelerometer', 'optidrive', 'pose_sensor'):
            section = getattr(self, name)
            if section is None:
                continue
            samples = section.rate * self.robot.period
            if samples < 0.5 or abs(samples - round(samples)) > _RATE_TOLERANCE:
                raise ConfigError(f'{name}.rate: {section.rate:g} Hz is no whole multiple of '
                                  f'{1.0 / self.robot.period:g} Hz, the rate of robot.period')

    def samples_per_period(self, sensor: str) -> int:
        """Return how many samples a sensor, named as its section, gives in one robot period."""
        return round(float(getattr(self, sensor).rate) * self.robot.period)
