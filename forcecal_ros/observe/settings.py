"""What a user may say about the chain."""

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from forcecal_ros.errors import ConfigError

MODES = ('kalman', 'newton')
"""Filters that a calibration may name as its own."""

FILTERS = (*MODES, 'ukf', 'ekf', 'static')
"""All filters of the chain; ``static`` takes off weight and bias alone and filters nothing."""

LEARNING = ('ukf', 'ekf')
"""Filters that estimate the wrench biases along."""

OFFSETS = ('auto', 'on', 'off')
COVARIANCES = ('measured', 'paper')


class Scaling(NamedTuple):
    """Spread of the sigma points; the defaults are those of [Ukf2025]."""

    alpha: float = 0.001
    beta: float = 2.0
    kappa: float = 0.0


PAPER_SCALING = Scaling()


@dataclass(frozen=True)
class FilterSettings:
    """
    Choices of filters ``ukf`` and ``ekf``, after [Ukf2025].

    Attributes
    ----------
    states : int
        6 (wrench) or 12 (wrench and biases).
    covariances : str
        ``measured`` or ``paper``.
    rise_time : float
        10-90 % rise of a contact wrench that ``measured`` aims at [s].
    relaxation : float
        Time in which the wrench is expected to return to nil while contact is excluded [s].
    bias_walk : tuple of 2 float
        Wander of the biases [N/sqrt(s)], [N m/sqrt(s)].
    bias_prior : tuple of 2 float
        How far the biases may have moved since the calibration [N], [N m].
    contact_floor : tuple of 2 float
        Errors of weight and inertia that are not to be called contact [N], [N m].
    contact_window : float
        Time over which a weak contact is averaged [s].
    false_alarm : float
        Probability that a sample without contact is called contact.
    release_time : float
        Quiet after which contact counts as ended [s].
    scaling : Scaling
        Spread of the sigma points.
    """

    states: int = 12
    covariances: str = 'measured'
    rise_time: float = 0.012
    relaxation: float = 0.1
    bias_walk: tuple[float, float] = (4e-4, 4e-5)
    bias_prior: tuple[float, float] = (0.0, 0.0)
    contact_floor: tuple[float, float] = (0.03, 0.003)
    contact_window: float = 0.1
    false_alarm: float = 1e-6
    release_time: float = 0.2
    scaling: Scaling = PAPER_SCALING

    def __post_init__(self) -> None:
        for name, value, words in (('states', self.states, (6, 12)),
                                   ('covariances', self.covariances, COVARIANCES)):
            if value not in words:
                raise ConfigError(f'gravity.{name} is {value!r}; '
                                  f'it wants one of {", ".join(map(str, words))}')
        for name in ('rise_time', 'relaxation', 'contact_window', 'release_time'):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ConfigError(f'gravity.{name} is {value!r}; it wants a positive time [s]')
        for name in ('bias_walk', 'bias_prior', 'contact_floor'):
            pair = getattr(self, name)
            if len(pair) != 2 or not all(isfinite(x) and x >= 0 for x in pair):
                raise ConfigError(f'gravity.{name} is {pair!r}; '
                                  'it wants two numbers from 0 on [N], [N m]')
        if not 0 < self.false_alarm < 1:
            raise ConfigError(f'gravity.false_alarm is {self.false_alarm!r}; '
                              'it wants a probability between 0 and 1')


@dataclass(frozen=True)
class Settings:
    """
    Choices of the chain.

    Attributes
    ----------
    filter : str or None
        One of :data:`FILTERS`; None: as the calibration says.
    bandwidth_hz : float or None
        Corner of the contact wrench in filter ``kalman`` [Hz]. None: from noise against response,
        see :func:`forcecal_ros.observe.bandwidth.contact_bandwidth`.
    contact_walk : float
        How fast a contact force is expected to wander, as a random walk [N/sqrt(s)].
    offset : str
        Whether the accelerometer offset is a state: ``on`` (an error where the streams do not
        make it detectable), ``off``, or ``auto`` (where they do).
    offset_walk : float
        Wander of that offset [m/s^2/sqrt(s)].
    position : bool
        Whether the pose stream is expected to hold a position; read by ``offset`` only.
    pose_position_std, pose_rotation_std : float
        Trust in one pose [m], [rad]. The position's is larger than a robot's repeatability:
        flexing and timing count as well.
    pose_rate : float
        Rate the two belong to [Hz].
    accelerometer_timeout, pose_timeout : float
        Pause after which the accelerometer (and displacement) or the pose counts as missing [s].
    skew : float
        Greatest difference of transport times between topics that is still waited for [s]. Costs
        no latency while all streams flow; bounds the pause when one of them stops.
    wrench_limit : tuple of 6 float or None
        Ends of the force sensor's range [N, N m].
    accelerometer_limit : float or None
        End of the accelerometer's range about zero, in its own unit.
    learning : FilterSettings
        Of filters ``ukf`` and ``ekf``.
    """

    filter: str | None = None
    bandwidth_hz: float | None = None
    contact_walk: float = 2.5
    offset: str = 'auto'
    offset_walk: float = 5e-4
    position: bool = True
    pose_position_std: float = 1e-4
    pose_rotation_std: float = 2e-5
    pose_rate: float = 250.0
    accelerometer_timeout: float = 0.025
    pose_timeout: float = 0.1
    skew: float = 0.05
    wrench_limit: tuple[float, ...] | None = None
    accelerometer_limit: float | None = None
    learning: FilterSettings = FilterSettings()

    def __post_init__(self) -> None:
        if self.filter is not None and self.filter not in FILTERS:
            raise ConfigError(f'filter {self.filter!r} is none of {", ".join(FILTERS)}')
        if self.offset not in OFFSETS:
            raise ConfigError(f'observer offset {self.offset!r} is none of {", ".join(OFFSETS)}')
        if self.wrench_limit is not None and len(self.wrench_limit) != 6:
            raise ConfigError(f'wrench_limit wants 6 numbers, got {len(self.wrench_limit)}')
        for name in ('bandwidth_hz', 'contact_walk', 'offset_walk', 'pose_position_std',
                     'pose_rotation_std', 'pose_rate', 'accelerometer_timeout', 'pose_timeout',
                     'skew', 'accelerometer_limit'):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise ConfigError(f'observer {name} is {value!r}; it wants a positive number')
