"""A contact task from start to done or aborted: the law within its limits, and the way out."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from forcecal_ros.core.errors import ConfigError, MotionError
from forcecal_ros.core.schema import Row
from forcecal_ros.impedance.law import Controller, Measurement
from forcecal_ros.impedance.program import LineMotion, Program, Reference, to_rest, Withdrawal

WITHDRAWING = 0.25
"""Duration of each slow withdrawal after a stop, while the tool still presses [s]."""

COMPRESSED = 5e-4
"""Displacement beyond which the tool counts as pressed in, whatever the force says [m]."""


@dataclass(frozen=True)
class Bounds:
    """Limits of the command of S, and forces that end the task."""

    speed: Annotated[float, Row(
        'Largest speed of the commands; a measured one above it times limits.overspeed stops',
        'm/s', 0.001, 2.0)] = 0.25
    acceleration: Annotated[float, Row(
        'Largest acceleration of the commands', 'm/s^2', 0.01, 50.0)] = 8.0
    deviation: Annotated[float, Row(
        'Distance of the command from the reference above which the loop counts as unstable',
        'm', 0.001, 1.0)] = 0.06
    force: Annotated[float, Row(
        'Contact force above which the motion stops, wherever it occurs', 'N', 0.5, 1e5)] = 100.0
    free_force: Annotated[float, Row(
        'Contact force above which the motion stops where no wall is expected',
        'N', 0.5, 1e5)] = 10.0
    margin: Annotated[float, Row(
        'Distance before task.clearance from which on the wall is expected',
        'm', 0.0005, 1.0)] = 0.01
    touch: Annotated[float, Row(
        'Contact force above which the tool touches', 'N', 0.05, 1000.0)] = 1.0
    stop_duration: Annotated[float, Row(
        'Duration from the first command of a stop to rest', 's', 0.01, 0.5)] = 0.062
    retract: Annotated[float, Row(
        'Distance by which a stop at the wall takes the tool back within that time',
        'm', 0.0005, 0.1)] = 0.005
    withdraw: Annotated[float, Row(
        'Distance by which it goes on from there, slowly, and again as long as the tool presses, '
        'to where the task began at most',
        'm', 0.0005, 0.5)] = 0.015
    closing: Annotated[float, Row(
        'Duration of the commands at rest that end the stream', 's')] = 0.1

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0.0:
                raise ConfigError(f'{name} is {getattr(self, name)}; it wants a positive number')


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

    def start(self, program: Program, wall: float, controller: Controller, bounds: Bounds
              ) -> None:
        """
        Begin a task; the first command is where the robot stands.

        Parameters
        ----------
        wall : float
            Where it is expected, from the start [m].
        controller : Controller
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
                self._stop = Withdrawal(self._motion, goal, WITHDRAWING)
                return
        self._stop = None
        self._closing = max(2, round(self._bounds.closing / self._period))

    def _presses(self, measured: Measurement) -> bool:
        """Say whether the tool touches, or may do so by a force that comes late."""
        touches = -measured.force > self._bounds.touch
        if self._withdrawn is None:
            return touches or self._pressed or measured.slide < -COMPRESSED
        # the very same numbers again are those of sensors that fell silent
        return touches and measured != self._withdrawn

    def _follow(self, measured: Measurement) -> None:
        self._time += 0.0 if self._paused else self._period
        reference = self._program.at(self._time)
        if self._paused:
            reference = reference._replace(velocity=0.0)
        self._note(reference.phase, measured)
        wanted = self._controller(reference, measured)
        if fault := self._fault(reference, measured, wanted):
            self.abort(fault)
        elif self._time >= self._program.duration:
            self.status = self.status._replace(phase='done')
            self._stop = to_rest(self._motion, self._bounds.stop_duration, 0.0,
                                 self._bounds.acceleration)
            self._time = 0.0
        else:
            self._motion = self._limited(wanted)
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

    def _fault(self, reference: Reference, measured: Measurement, wanted: float) -> str:
        bounds, force = self._bounds, abs(measured.force)
        tool = measured.position + measured.slide
        if force > bounds.force:
            return f'contact force {force:.1f} N exceeds limits.force {bounds.force:g} N'
        expected = reference.phase != 'free' and tool > self._wall - bounds.margin
        if not expected and force > bounds.free_force:
            return (f'contact force {force:.1f} N {self._wall - tool:.3f} m before the wall is '
                    f'expected; limits.free_force is {bounds.free_force:g} N')
        if not abs(wanted - reference.position) <= bounds.deviation:
            return (f'the command is {wanted - reference.position:.3f} m from the reference, '
                    f'limits.deviation is {bounds.deviation:g} m; the loop is not stable here')
        return ''

    def _limited(self, wanted: float) -> LineMotion:
        """Return the command one period on, held to speed and acceleration."""
        dt, before, bounds = self._period, self._motion, self._bounds
        velocity = (wanted - before.position) / dt
        change = bounds.acceleration * dt
        held = min(max(velocity, -bounds.speed, before.velocity - change), bounds.speed,
                   before.velocity + change)
        if held != velocity:
            self.status = self.status._replace(limited=self.status.limited + 1)
        return LineMotion(before.position + held * dt, held, (held - before.velocity) / dt)
