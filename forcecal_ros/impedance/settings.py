"""What a user may say about the impedance and how it is designed."""

from dataclasses import dataclass, fields
from math import isfinite

from forcecal_ros.errors import ConfigError


def _check_positive(section: object, name: str, *skip: str) -> None:
    for field in fields(section):  # type: ignore[arg-type]
        value = getattr(section, field.name)
        if field.name not in skip and not (isfinite(value) and value > 0.0):
            raise ConfigError(f'{name}.{field.name} is {value}; it wants a positive number')


@dataclass(frozen=True)
class Wanted:
    """
    How the tool shall give way to a force, about its reference.

    Attributes
    ----------
    mass, damping, stiffness : float
        [kg], [N s/m], [N/m]
    """

    mass: float = 13.0
    damping: float = 250.0
    stiffness: float = 1000.0

    def __post_init__(self) -> None:
        _check_positive(self, 'impedance')


@dataclass(frozen=True)
class DesignSettings:
    """
    How the law is designed.

    Attributes
    ----------
    effort : float
        What a command off its steady value costs, as a force per distance: small against the
        wanted stiffness, so that the impedance relation counts [N/m].
    latency : int
        Periods that a command takes beyond the robot's own delay.
    force_lag : float
        Time constant of the contact force that is fed back [s].
    force_std : float
        Error of that force, white [N].
    command_std : float
        Error of the robot model, as white noise on its command [m].
    position_std, slide_std : float
        Noise of the two measurements [m].
    wall_stiffness : tuple of two float
        Range of the walls that the loop has to be stable against; without a wall it always has
        to be [N/m].
    wall_damping : float
        Of the wall; stiff walls are the harder to bear the less they damp [N s/m].
    state_gain : tuple of float or None
        L, in the place of the optimal one.
    force_gain, position_gain : float or None
        c [m/N] and l_r [1], in the place of those that make the steady state right.
    """

    effort: float = 100.0
    latency: int = 0
    force_lag: float = 0.004
    force_std: float = 0.3
    command_std: float = 1e-5
    position_std: float = 2e-5
    slide_std: float = 2e-5
    wall_stiffness: tuple[float, float] = (100.0, 20_000.0)
    wall_damping: float = 0.0
    state_gain: tuple[float, ...] | None = None
    force_gain: float | None = None
    position_gain: float | None = None

    def __post_init__(self) -> None:
        _check_positive(self, 'design', 'latency', 'wall_stiffness', 'wall_damping',
                        'state_gain', 'force_gain', 'position_gain')
        low, high = self.wall_stiffness
        if not 0.0 < low <= high < float('inf'):
            raise ConfigError(f'design.wall_stiffness is {low:g} to {high:g}; it wants two '
                              'positive numbers, the smaller one first')
        if not 0.0 <= self.wall_damping < float('inf'):
            raise ConfigError(f'design.wall_damping is {self.wall_damping:g}; it wants 0 or more')
        if not 0 <= self.latency <= 50:
            raise ConfigError(f'design.latency is {self.latency}; it wants 0 to 50 periods')
        given = (*(self.state_gain or ()), self.force_gain or 0.0, self.position_gain or 0.0)
        if not all(map(isfinite, given)):
            raise ConfigError('design: a gain is not a finite number')
