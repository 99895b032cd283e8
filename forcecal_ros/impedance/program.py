"""The reference of a contact task along one line, and how it comes to rest from any motion."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.schema import Row
from forcecal_ros.motion.profiles import quintic
import numpy as np

FREE = ('free', 'retract')
"""Stages in which nothing should be touched, once the way back has left the wall."""


class Stage(NamedTuple):
    """
    One minimum-jerk move of the reference, or a hold.

    Attributes
    ----------
    phase : str
        ``free``, ``approach``, ``contact`` or ``retract``.
    goal : float
        Where the reference is at the end, from the start of the program [m].
    duration : float
        [s]
    """

    phase: str
    goal: float
    duration: float


class Reference(NamedTuple):
    """Where the reference is [m], [m/s], from the start of the program, and in which phase."""

    position: float
    velocity: float
    phase: str


@dataclass(frozen=True)
class Program:
    """Stages one after another, beginning at zero."""

    stages: tuple[Stage, ...]

    def __post_init__(self) -> None:
        for stage in self.stages:
            if not (stage.duration > 0 and np.isfinite([stage.goal, stage.duration]).all()):
                raise ConfigError(f'a stage of phase {stage.phase} goes to {stage.goal:g} m in '
                                  f'{stage.duration:g} s; it wants finite numbers and a duration')

    @cached_property
    def ends(self) -> tuple[float, ...]:
        """When each stage ends [s]."""
        return tuple(float(t) for t in np.cumsum([stage.duration for stage in self.stages]))

    @property
    def duration(self) -> float:
        """Length of the whole [s]."""
        return self.ends[-1]

    @property
    def farthest(self) -> tuple[float, float]:
        """Least and greatest goal [m]."""
        goals = [0.0, *(stage.goal for stage in self.stages)]
        return min(goals), max(goals)

    def at(self, t: float) -> Reference:
        """
        Return the reference at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        """
        i = min(int(np.searchsorted(self.ends, t, side='right')), len(self.stages) - 1)
        stage = self.stages[i]
        start = self.stages[i - 1].goal if i else 0.0
        begin = self.ends[i] - stage.duration
        s, ds, _ = quintic((t - begin) / stage.duration)
        way = stage.goal - start
        return Reference(start + way * float(s), way * float(ds) / stage.duration, stage.phase)

    def first_hold(self, phase: str) -> float:
        """Return when the first stage of a phase ends [s]."""
        return next(end for stage, end in zip(self.stages, self.ends) if stage.phase == phase)

    def span(self, phase: str) -> tuple[float, float]:
        """Return when a phase begins first and ends last [s]."""
        begins = (0.0, *self.ends[:-1])
        times = [(a, b) for stage, a, b in zip(self.stages, begins, self.ends)
                 if stage.phase == phase]
        return times[0][0], times[-1][1]


@dataclass(frozen=True)
class Task:
    """The three phases of [Gamez2005] V in numbers."""

    swing: Annotated[float, Row(
        'Distance of each free move, out and back, away from the wall', 'm', 0.0, 0.5)] = 0.035
    swing_duration: Annotated[float, Row('Duration of each of these', 's', 0.05, 10.0)] = 0.3
    swings: Annotated[int, Row('Number of free moves out and back', low=0, high=1000)] = 2
    clearance: Annotated[float, Row(
        'Distance of the wall from the tool at the start, along x of ft_sensor', 'm', 0.0, 1.0)
        ] = 0.08
    depth: Annotated[float, Row(
        'Distance by which the reference goes behind the wall, which presses',
        'm', 0.0, 0.2)] = 0.02
    approach: Annotated[float, Row(
        'Duration of the move to the wall, and of the one back', 's', 0.1, 60.0)] = 1.4
    sweep: Annotated[float, Row(
        'Distance by which the reference moves out and back in contact', 'm', 0.0, 0.1)] = 0.005
    hold: Annotated[float, Row(
        'Duration of each of the three holds in contact', 's', 0.1, 600.0)] = 1.0
    rest: Annotated[float, Row('Duration of the holds between free moves', 's', 0.01, 60.0)] = 0.25
    settle: Annotated[float, Row(
        'Duration of the hold after the move back, for the tool to arrive',
        's', 0.01, 60.0)] = 0.75

    def program(self, cycles: int = 1) -> Program:
        """
        Return the reference of this task.

        Parameters
        ----------
        cycles : int
            Number of cycles of free motion, contact and move back.
        """
        free = [Stage('free', 0.0, self.rest)]
        for _ in range(self.swings):
            for goal in (-self.swing, 0.0):
                free += [Stage('free', goal, self.swing_duration), Stage('free', goal, self.rest)]
        pressed = self.clearance + self.depth
        contact = [Stage('contact', pressed, self.hold)]
        for goal in (pressed + self.sweep, pressed - self.sweep):
            contact += [Stage('contact', goal, 0.5), Stage('contact', goal, self.hold)]
        back = [Stage('retract', 0.0, self.approach), Stage('retract', 0.0, self.settle)]
        return Program((*free, Stage('approach', pressed, self.approach), *contact, *back)
                       * max(1, cycles))


STEPS = 8
"""Number of end points that are tried for a stop, from the farthest back to the gentlest."""


class LineMotion(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s^2] along one line."""

    position: float
    velocity: float = 0.0
    acceleration: float = 0.0


@dataclass(frozen=True)
class Withdrawal:
    """
    From a motion to rest.

    Attributes
    ----------
    goal : float
        [m]
    duration : float
        [s]
    """

    start: LineMotion
    goal: float
    duration: float

    def at(self, t: float) -> LineMotion:
        """
        Return the motion at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        """
        T = self.duration
        x = min(max(t / T, 0.0), 1.0)
        p, v, a = self.start.position, self.start.velocity * T, self.start.acceleration * T * T
        way = self.goal - p
        c3 = 10.0 * way - 6.0 * v - 1.5 * a
        c4 = -15.0 * way + 8.0 * v + 1.5 * a
        c5 = 6.0 * way - 3.0 * v - 0.5 * a
        if x == 1.0:
            return LineMotion(self.goal)
        return LineMotion(
            p + x * (v + x * (0.5 * a + x * (c3 + x * (c4 + x * c5)))),
            (v + x * (a + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / T,
            (a + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (T * T))


def to_rest(motion: LineMotion, duration: float, retract: float, acceleration: float
            ) -> Withdrawal:
    """
    Return the stop of a motion.

    Parameters
    ----------
    duration : float
        [s]
    retract : float
        How far back from here it ends, less where that takes too much acceleration [m]; 0:
        wherever the gentlest stop ends.
    acceleration : float
        Limit of it [m/s^2].
    """
    gentlest = motion.position + 0.5 * motion.velocity * duration
    if not retract > 0.0:
        return Withdrawal(motion, gentlest, duration)
    for share in range(STEPS, 0, -1):
        back = share / STEPS
        goal = min(motion.position - retract, gentlest)
        chosen = Withdrawal(motion, gentlest + back * (goal - gentlest), duration)
        if _peak_acceleration(chosen) <= acceleration:
            return chosen
    return Withdrawal(motion, gentlest, duration)


def _peak_acceleration(withdrawal: Withdrawal) -> float:
    return max(abs(withdrawal.at(withdrawal.duration * k / 16).acceleration) for k in range(17))
