"""What a user may say about the impedance and how it is designed."""

from dataclasses import dataclass
from typing import Annotated

from forcecal_ros.core.schema import Row, Section


@dataclass(frozen=True)
class Wanted(Section, name='impedance'):
    """How the tool shall give way to a force, about its reference."""

    mass: Annotated[float, Row('Of the wanted behaviour', 'kg', above=0.0)] = 13.0
    damping: Annotated[float, Row('Of the wanted behaviour', 'N s/m', above=0.0)] = 250.0
    stiffness: Annotated[float, Row('Of the wanted behaviour', 'N/m', above=0.0)] = 1000.0


@dataclass(frozen=True)
class DesignSettings(Section, name='design'):
    """
    How the law is designed.

    Stiff walls are the harder to bear the less they damp. Without a wall the loop always has to be
    stable.
    """

    effort: Annotated[float, Row(
        'What a command off its steady value costs, as a force per distance: small against the '
        'wanted stiffness, so that the impedance relation counts', 'N/m', above=0.0)] = 100.0
    latency: Annotated[int, Row(
        "Periods that a command takes beyond the robot's own delay", low=0, high=50)] = 0
    force_lag: Annotated[float, Row(
        'Time constant of the contact force that is fed back', 's', above=0.0)] = 0.004
    force_std: Annotated[float, Row('Error of that force, white', 'N', above=0.0)] = 0.3
    command_std: Annotated[float, Row(
        'Error of the robot model, as white noise on its command', 'm', above=0.0)] = 1e-5
    position_std: Annotated[float, Row('Noise of the measured position', 'm', above=0.0)] = 2e-5
    slide_std: Annotated[float, Row('Noise of the measured displacement', 'm', above=0.0)] = 2e-5
    wall_stiffness: Annotated[tuple[float, float], Row(
        'Range of the walls that the loop has to be stable against', 'N/m', above=0.0)
        ] = (100.0, 20_000.0)
    wall_damping: Annotated[float, Row('Of the wall', 'N s/m', 0.0)] = 0.0
    state_gain: Annotated[tuple[float, ...] | None, Row('L, in place of the optimal one')] = None
    force_gain: Annotated[float | None, Row(
        'c, in place of the one that makes the steady state right', 'm/N')] = None
    position_gain: Annotated[float | None, Row('l_r likewise', '1')] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.wall_stiffness[0] > self.wall_stiffness[1]:
            raise self.wrong('wall_stiffness', 'the smaller number first')
