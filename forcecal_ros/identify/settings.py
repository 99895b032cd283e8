"""What a user may say about the identification; every default is stated with its reason."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import STANDARD_GRAVITY
import numpy as np

COUPLINGS = ('dc', 'ac')
COMPLIANCES = ('auto', 'yes', 'no')
DESIGNS = ('kalman', 'poles')
MODES = ('kalman', 'newton')


@dataclass(frozen=True)
class Thresholds:
    """
    Where an estimate is called into question; each names one line of ``quality.warnings``.

    Attributes
    ----------
    mass, gain, stiffness, damping, inertia : float
        Largest relative standard error. Above that of ``inertia`` it counts as not identified.
    com, position : float
        Largest standard error [m]. Above that of ``position`` the accelerometer's place counts
        as not identified.
    force_bias, torque_bias : float
        Largest standard error [N], [N m].
    offset : float
        Largest standard error, as a specific force [m/s^2].
    delay : float
        Largest standard error [s].
    condition : float
        Largest condition number of the poses, gravity directions scaled to unit spread.
    probability : float
        A chi-square of residuals less probable than this is reported.
    agreement : float
        Largest relative difference between the paper's estimate and the joint one.
    """

    mass: float = 0.001
    gain: float = 0.002
    stiffness: float = 0.01
    damping: float = 0.05
    inertia: float = 0.2
    com: float = 2e-4
    position: float = 0.005
    force_bias: float = 0.05
    torque_bias: float = 0.005
    offset: float = 0.02
    delay: float = 2e-4
    condition: float = 100.0
    probability: float = 1e-3
    agreement: float = 0.02


@dataclass(frozen=True)
class Settings:
    """
    Choices of the identification.

    Attributes
    ----------
    gravity : float
        Magnitude at the robot [m/s^2]; it points along -z of base.
    theta : float
        The paper's angle in Eq. 9 and 12 [rad]. Only the plain Eq. 16 uses it.
    coupling : str
        Of the accelerometer: ``dc``, or ``ac`` for one with a first-order high-pass.
    cutoff : float or None
        Corner of that high-pass where it is known [Hz]; None: estimated.
    accelerometer_position : tuple of 3 float or None
        Where it sits in ft_sensor at zero displacement, where known [m]; None: estimated.
    tool_compliance : str
        Whether the tool slides along x of ft_sensor: ``yes``, ``no``, or ``auto``, which looks
        for an Optidrive that moves or for ringing after the step.
    wrench_sign : int
        What the readings were multiplied by when they were read; written into the calibration.
    largest_delay : float
        Delays between sensors are looked for up to this [s].
    block : float
        Readings are averaged over blocks of this length [s]: well below the tool's period,
        well above the sensors'. Longer where a sensor is too slow for it.
    observer_mode : str
        ``kalman`` or ``newton``: who publishes the contact wrench.
    observer_design : str
        Of the paper's gain: ``kalman`` (Eq. 18, 19) or ``poles``.
    observer_poles : tuple of 2 float
        Of the observer's error where ``poles`` places them [1/s], negative.
    thresholds : Thresholds
    source : mapping
        Copied into the calibration's ``source``.
    """

    gravity: float = STANDARD_GRAVITY
    theta: float = 0.0
    coupling: str = 'dc'
    cutoff: float | None = None
    accelerometer_position: tuple[float, float, float] | None = None
    tool_compliance: str = 'auto'
    wrench_sign: int = 1
    largest_delay: float = 0.02
    block: float = 0.02
    observer_mode: str = 'kalman'
    observer_design: str = 'kalman'
    observer_poles: tuple[float, float] = (-30.0, -40.0)
    thresholds: Thresholds = Thresholds()
    source: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, words in (('coupling', COUPLINGS), ('tool_compliance', COMPLIANCES),
                            ('observer_mode', MODES), ('observer_design', DESIGNS)):
            if getattr(self, name) not in words:
                raise ConfigError(f'{name} is {getattr(self, name)!r}; '
                                  f'it wants one of {", ".join(words)}')
        for name in ('gravity', 'cutoff', 'block', 'largest_delay'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ConfigError(f'{name} is {value!r}; it wants a positive number')
        if self.wrench_sign not in (1, -1):
            raise ConfigError(f'wrench_sign is {self.wrench_sign!r}; it wants 1 or -1')
        if len(self.observer_poles) != 2 or not max(self.observer_poles) < 0:
            raise ConfigError(f'observer_poles are {self.observer_poles}; '
                              'they want two negative numbers [1/s]')
        position = self.accelerometer_position
        if position is not None and (len(position) != 3 or not np.isfinite(position).all()):
            raise ConfigError(f'accelerometer_position is {position}; it wants x, y, z [m]')
