"""A contact task along one line: its reference, the law within its bounds, and the way out."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

from forcecal_ros.core.errors import above, MotionError
from forcecal_ros.core.schema import Row, Section
from forcecal_ros.impedance.law import Measurement, Reference, Regulator
from forcecal_ros.motion.profiles import quintic
import numpy as np
from scipy.interpolate import BPoly

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


@dataclass(frozen=True)
class Program:
    """Stages one after another, beginning at zero."""

    stages: tuple[Stage, ...]

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


@dataclass(frozen=True)
class Task:
    """The three phases of [Gamez2005] V in numbers."""

    swing: Annotated[float, Row(
        'Distance of each free move, out and back', 'm', 0.0, 0.5)] = 0.035
    swing_duration: Annotated[float, Row('Duration of each free move', 's', 0.05, 10.0)] = 0.3
    swings: Annotated[int, Row('Number of free moves out and back', low=0, high=1000)] = 2
    clearance: Annotated[float, Row(
        'Distance of the wall from the tool at the start, along x of ft_sensor', 'm', 0.0, 1.0)
        ] = 0.08
    depth: Annotated[float, Row(
        'Depth of the reference behind the wall',
        'm', 0.0, 0.2)] = 0.02
    approach: Annotated[float, Row(
        'Duration of the move to the wall, and of the move back', 's', 0.1, 60.0)] = 1.4
    sweep: Annotated[float, Row(
        'Amplitude of the reference in contact', 'm', 0.0, 0.1)] = 0.005
    hold: Annotated[float, Row(
        'Duration of each of the three holds in contact', 's', 0.1, 600.0)] = 1.0
    rest: Annotated[float, Row('Duration of the holds between free moves', 's', 0.01, 60.0)] = 0.25
    settle: Annotated[float, Row(
        'Duration of the hold after the move back',
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


class LineMotion(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s^2] along one line."""

    position: float
    velocity: float = 0.0
    acceleration: float = 0.0


@dataclass(frozen=True)
class Withdrawal:
    """
    From a motion to rest, by a polynomial of fifth degree.

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

    @cached_property
    def path(self) -> BPoly:
        """Position over time."""
        return BPoly.from_derivatives([0.0, self.duration], [self.start, (self.goal, 0.0, 0.0)])

    def at(self, t: float) -> LineMotion:
        """
        Return the motion at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        """
        if t >= self.duration:
            return LineMotion(self.goal)
        return LineMotion(*(float(self.path(max(t, 0.0), order)) for order in range(3)))


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
    farthest = min(motion.position - retract, gentlest) if retract > 0.0 else gentlest
    t = np.linspace(0.0, duration, 17)
    for goal in np.linspace(farthest, gentlest, 9).tolist():
        stop = Withdrawal(motion, goal, duration)
        if np.abs(stop.path(t, 2)).max() <= acceleration:
            break
    return stop


@dataclass(frozen=True)
class Bounds(Section, name='limits'):
    """Limits of the command of S, and forces that end the task."""

    speed: Annotated[float, Row(
        'Largest speed of the commands; the motion stops above limits.overspeed times this',
        'm/s', 0.001, 2.0)] = 0.25
    acceleration: Annotated[float, Row(
        'Largest acceleration of the commands', 'm/s^2', 0.01, 50.0)] = 8.0
    deviation: Annotated[float, Row(
        'Distance between command and reference above which the motion stops as unstable',
        'm', 0.001, 1.0)] = 0.06
    force: Annotated[float, Row('Contact force that stops the motion', 'N', 0.5, 1e5)] = 100.0
    free_force: Annotated[float, Row(
        'Contact force that stops the motion away from the wall',
        'N', 0.5, 1e5)] = 10.0
    margin: Annotated[float, Row(
        'Distance before task.clearance from which contact is expected',
        'm', 0.0005, 1.0)] = 0.01
    touch: Annotated[float, Row('Force above which contact is detected', 'N', 0.05, 1000.0)] = 1.0
    stop_duration: Annotated[float, Row(
        'Duration from the first command of a stop to rest', 's', 0.01, 0.5)] = 0.062
    retract: Annotated[float, Row(
        'Retreat of the tool during a stop at the wall',
        'm', 0.0005, 0.1)] = 0.005
    withdraw: Annotated[float, Row(
        'Slow retreat after limits.retract, repeated while the tool presses',
        'm', 0.0005, 0.5)] = 0.015


class TaskStatus(NamedTuple):
    """
    How far a task got.

    Attributes
    ----------
    phase : str
        ``idle``, a phase of the program, ``done`` or ``aborted``.
    reason : str
        Why it was aborted.
    contacts, missed : int
        Visits of the wall in which it was touched, and in which it was not.
    limited : int
        Commands that were held to the bounds.
    """

    phase: str = 'idle'
    reason: str = ''
    contacts: int = 0
    missed: int = 0
    limited: int = 0


class Session:
    """
    One task at a time.

    Parameters
    ----------
    period : float
        Of the control loop [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._motion = LineMotion(0.0)
        self._stop: Withdrawal | None = None
        self._paused = False
        self._closing = 0
        self._streaming = False
        self.status = TaskStatus()

    @property
    def running(self) -> bool:
        """Whether a task is under way."""
        return self.status.phase not in ('idle', 'done', 'aborted')

    @property
    def streaming(self) -> bool:
        """Whether :meth:`step` has commands to give."""
        return self._streaming

    @property
    def guarded(self) -> bool:
        """Whether a fault ends it."""
        return self.running

    @property
    def moving(self) -> bool:
        """Whether the command moves."""
        return abs(self._motion.velocity) > 1e-4

    def start(self, program: Program, wall: float, controller: Regulator, bounds: Bounds
              ) -> None:
        """
        Begin a task; the first command is where the robot stands.

        Parameters
        ----------
        wall : float
            Where it is expected, from the start [m].
        controller : Regulator
            At rest at zero.

        Raises
        ------
        MotionError
            One is under way already.
        """
        if self.running or self._streaming:
            raise MotionError(f'a task is under way already ({self.status.phase}); abort it first')
        self._program, self._wall = program, wall
        self._controller, self._bounds = controller, bounds
        self._motion, self._stop, self._time = LineMotion(0.0), None, 0.0
        self._closing, self._streaming, self._paused = 0, True, False
        self._touched, self._pressed, self._force = False, False, 0.0
        self._withdrawn: Measurement | None = None
        self.status = TaskStatus(program.at(0.0).phase)

    def abort(self, reason: str, *, at_once: bool = False) -> bool:
        """
        Come to rest within the stop's duration, away from what may be touched.

        Parameters
        ----------
        reason : str
            One line for the user.
        at_once : bool
            Begin from rest, after a silence in which the robot came to a stop.

        Returns
        -------
        bool
            False where nothing was under way.
        """
        if not self.running:
            return False
        if at_once:
            self.restart()
        bounds = self._bounds
        self._pressed = -self._force > bounds.touch
        near = self.status.phase != 'free' or self._pressed
        retract = bounds.retract if near else 0.0
        self._stop = to_rest(self._motion, bounds.stop_duration, retract, bounds.acceleration)
        self._time = 0.0
        self.status = self.status._replace(phase='aborted', reason=reason)
        return True

    def pause(self, paused: bool) -> None:
        """Hold the reference, or let it continue; the law runs in either case."""
        self._paused = paused

    def restart(self) -> None:
        """Start again from rest, after a silence in which the robot came to a stop."""
        if self._stop is None:
            self._motion = LineMotion(self._motion.position)

    def step(self, measured: Measurement) -> float | None:
        """
        Advance by one period.

        Returns
        -------
        float or None
            Command of S from the start [m]; None where the stream is silent.
        """
        if not self._streaming:
            return None
        if self._stop is None and not self._closing:
            self._follow(measured)
        if self._stop is not None:
            self._time += self._period
            self._motion = self._stop.at(self._time)
            if self._time >= self._stop.duration - 1e-9:
                self._rest(measured)
        elif self._closing:
            self._closing -= 1
            self._streaming = self._closing > 0
        return self._motion.position

    def _rest(self, measured: Measurement) -> None:
        """Hold at the end of a stop, or go on where the tool still presses."""
        here = self._motion.position
        if self.status.phase == 'aborted' and self._presses(measured):
            # the way it came was free, as far as to where it began
            goal = here - self._bounds.withdraw
            if self._withdrawn is not None:
                goal = max(goal, min(here, 0.0))
            if goal < here:
                self._withdrawn, self._time = measured, 0.0
                # duration of each slow withdrawal after a stop, while the tool still presses [s]
                self._stop = Withdrawal(self._motion, goal, 0.25)
                return
        self._stop = None
        # commands at rest end the stream, for so long [s]
        self._closing = max(2, round(0.1 / self._period))

    def _presses(self, measured: Measurement) -> bool:
        """Say whether the tool touches, or may do so by a force that comes late."""
        touches = -measured.force > self._bounds.touch
        if self._withdrawn is None:
            # displacement beyond which the tool counts as pressed in, for any force [m]
            return touches or self._pressed or measured.slide < -5e-4
        # the very same numbers again are those of sensors that fell silent
        return touches and measured != self._withdrawn

    def _follow(self, measured: Measurement) -> None:
        self._time += 0.0 if self._paused else self._period
        reference = self._program.at(self._time)
        if self._paused:
            reference = reference._replace(velocity=0.0)
        self._note(reference.phase, measured)
        command = self._controller(reference, measured)
        if fault := self._fault(reference, measured, command):
            self.abort(fault)
        elif self._time >= self._program.duration:
            self.status = self.status._replace(phase='done')
            self._stop = to_rest(self._motion, self._bounds.stop_duration, 0.0,
                                 self._bounds.acceleration)
            self._time = 0.0
        else:
            self._motion = self._limited(command)
            self._controller.sent(self._motion.position)

    def _note(self, phase: str, measured: Measurement) -> None:
        """Count the visits of the wall with and without contact."""
        status, self._force = self.status, measured.force
        if phase == 'contact':
            self._touched |= -measured.force > self._bounds.touch
        elif status.phase == 'contact':
            hit = 'contacts' if self._touched else 'missed'
            status = status._replace(**{hit: getattr(status, hit) + 1})
            self._touched = False
        self.status = status._replace(phase=phase)

    def _fault(self, reference: Reference, measured: Measurement, command: float) -> str:
        bounds, force = self._bounds, abs(measured.force)
        tool = measured.position + measured.slide
        if force > bounds.force:
            return (f'contact force {above(force, bounds.force)} N exceeds limits.force '
                    f'{bounds.force:g} N')
        expected = reference.phase != 'free' and tool > self._wall - bounds.margin
        if not expected and force > bounds.free_force:
            return (f'contact force {above(force, bounds.free_force)} N '
                    f'{self._wall - tool:.3f} m before the wall is '
                    f'expected; limits.free_force is {bounds.free_force:g} N')
        off = abs(command - reference.position)
        if not off <= bounds.deviation:
            return (f'the command is {above(off, bounds.deviation)} m from the reference, '
                    f'limits.deviation is {bounds.deviation:g} m; the loop is unstable here')
        return ''

    def _limited(self, command: float) -> LineMotion:
        """Return the command one period on, held to speed and acceleration."""
        dt, before, bounds = self._period, self._motion, self._bounds
        velocity = (command - before.position) / dt
        change = bounds.acceleration * dt
        held = min(max(velocity, -bounds.speed, before.velocity - change), bounds.speed,
                   before.velocity + change)
        if held != velocity:
            self.status = self.status._replace(limited=self.status.limited + 1)
        return LineMotion(before.position + held * dt, held, (held - before.velocity) / dt)
