"""The simulated rig: live, period by period, or offline along recorded commands.

A live simulation schedules which command holds in which robot period.
"""

from collections import deque
from typing import Any, Literal, NamedTuple

from forcecal_ros.core import jit
from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import AccelerometerEffects, StampEffects, WrenchEffects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.plant import Plant
from forcecal_ros.sim.rig.robot import Motion, move
from forcecal_ros.sim.rig.sensors import Noise, respond, Response
from forcecal_ros.sim.rig.tool import Slide, slide_along
import numpy as np
from numpy.typing import ArrayLike, NDArray

LONGEST_LAG = 250
"""Most periods that a late stream lags behind; commands beyond that are dropped."""


class CommandSchedule:
    """
    Commands on their way to a robot that takes one a period.

    A command acts in the first period that begins at its stamp or later, as in a recording that
    is replayed. Stamps that jitter neither drop nor double a command: one within half a period of
    the slot that comes next takes that slot. Nor do commands that come late: they act one after
    the other, and the stream lags until it rests.

    Parameters
    ----------
    period_ns : int
        Of the robot [ns].
    start_ns : int
        When period 0 begins [ns].

    Attributes
    ----------
    late : int
        Commands that came too late for their period.
    """

    def __init__(self, period_ns: int, start_ns: int) -> None:
        self._period = period_ns
        self._start = start_ns
        self._queue: deque[tuple[int, Any]] = deque()
        self._last = -1
        self._newest: Any = None
        self._lag = 0
        self.late = 0

    def add(self, stamp_ns: int, now_ns: int, next_period: int, command: Any) -> None:
        """
        Take in a command.

        Parameters
        ----------
        stamp_ns : int
            Of its header; taken to be now where it is in the future or too old.
        next_period : int
            The first period that is not simulated yet.
        command : object
            Compared with the one before: where they are equal the robot rests.
        """
        frontier = self._start + next_period * self._period
        if not frontier - 10**9 <= stamp_ns <= now_ns:
            stamp_ns = now_ns
        since = stamp_ns - self._start
        if command == self._newest:  # at rest nothing is dropped: the stream is in step again
            self._lag, due = 0, -(-since // self._period)
        else:
            due = self._due(since)
        behind = next_period - due
        if behind > self._lag:
            self._lag = min(behind, LONGEST_LAG)
            self.late += 1
        self._last = max(due + self._lag, next_period, self._last)
        self._newest = command
        self._queue.append((self._last, command))

    @property
    def commanded_ns(self) -> int:
        """End of the last period that a command has come for [ns]."""
        return self._start + (self._last + 1) * self._period

    def _due(self, since: int) -> int:
        """Return the period a command is due in, ``since`` the start [ns]."""
        expected, half = self._last - self._lag + 1, self._period // 2
        if abs(since - expected * self._period + half) <= self._period:
            return expected
        return -(-since // self._period)

    def restarted(self, start_ns: int) -> 'CommandSchedule':
        """
        Return a schedule for a time that was skipped: what waits acts one after the other.

        Parameters
        ----------
        start_ns : int
            When period 0 begins from now on [ns].
        """
        schedule = CommandSchedule(self._period, start_ns)
        schedule._queue.extend((i, command) for i, (_, command) in enumerate(self._queue))
        schedule._last, schedule._newest = len(self._queue) - 1, self._newest
        schedule._lag = min(len(self._queue), LONGEST_LAG)
        schedule.late = self.late
        return schedule

    def take(self, period: int) -> Any:
        """Return the newest command that acts in a period; None: the one before holds."""
        newest = None
        while self._queue and self._queue[0][0] <= period:
            newest = self._queue.popleft()[1]
        return newest


class Samples(NamedTuple):
    """
    What the sensors say during one or more robot periods.

    Times are seconds since command 0; sample i of a signal is its state at ``t[i]``.

    Attributes
    ----------
    wrench_t : ndarray, shape (n,)
    wrench : ndarray, shape (n, 6)
        As on the wire: environment on tool, in ft_sensor, bias included [N], [N m].
    contact_t : ndarray, shape (l,)
    contact : ndarray, shape (l, 6)
        The truth: environment on tool, in ft_sensor, about its origin.
    accelerometer_t : ndarray, shape (m,)
    volts, specific_force : ndarray, shape (m, 3)
        Accelerometer [V], and the same in its physical unit, (volts - offset) / gain [m/s^2].
    optidrive_t : ndarray, shape (k,)
    optidrive : ndarray, shape (k,)
        Displacement of the tool along x of ft_sensor [m]; empty where the tool is rigid.
    pose_t : ndarray, shape (j,)
    position : ndarray, shape (j, 3)
        Of S in base [m].
    R_base_sensor : ndarray, shape (j, 3, 3)
    """

    wrench_t: Array
    wrench: Array
    contact_t: Array
    contact: Array
    accelerometer_t: Array
    volts: Array
    specific_force: Array
    optidrive_t: Array
    optidrive: Array
    pose_t: Array
    position: Array
    R_base_sensor: Array


SIGNALS = {
    'wrench': ('wrench_t', 'wrench'),
    'accelerometer': ('accelerometer_t', 'volts', 'specific_force'),
    'optidrive': ('optidrive_t', 'optidrive'),
    'pose': ('pose_t', 'position', 'R_base_sensor'),
}
"""Of each stream of samples, its stamps first."""


class Simulator:
    """
    The rig, one robot period after another.

    Before its first command everything rests at the first commanded pose, the tool at its static
    sag; without any command that pose is the rig's home.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.
    seed : int, optional
        Of the noise; fresh noise each time where none is given.
    steps : int, optional
        Integration steps per period, a multiple of what the sensor rates ask for; the fewest
        sufficient ones (0.5 ms or less) where none is given.

    Raises
    ------
    ConfigError
        No such accelerometer, or steps that miss samples.
    """

    def __init__(self, rig: Rig, accelerometer: str | None = None, seed: int | None = None, *,
                 steps: int | None = None) -> None:
        self._rig = rig
        self._model = rig.accelerometer.model(accelerometer)
        self._plant = Plant(rig, accelerometer, steps)
        self._noise = Noise(rig, seed)
        self._wrench = WrenchEffects(rig, 1.0 / rig.wrench_sensor.rate)
        self._volts = AccelerometerEffects(rig, accelerometer, 1.0 / rig.accelerometer.rate)
        self._arrival = StampEffects(rig, self._noise.seed_of_losses)
        self._command = (np.array(rig.home.position), np.array(rig.home.orientation_xyzw))
        self._periods = 0

    @property
    def time(self) -> float:
        """Time since command 0 [s]."""
        return self._periods * self._rig.robot.period

    def command(self, position: ArrayLike, R_base_sensor: ArrayLike) -> None:
        """
        Set the command that holds from the next period on.

        Parameters
        ----------
        position : array_like, shape (3,)
            Of S in base [m].
        R_base_sensor : array_like, shape (3, 3)

        Raises
        ------
        MotionError
            Not finite, or not a rotation; the command before stays.
        """
        positions, xyzw = checked_commands(
            np.reshape(position, (1, 3)), np.reshape(R_base_sensor, (1, 3, 3)))
        self._command = (positions[0], xyzw[0])

    def advance(self, noise: bool = True) -> Samples:
        """
        Advance by one robot period.

        Parameters
        ----------
        noise : bool
            False: readings of noise-free sensors, without losses.

        Returns
        -------
        Samples
            Of this period.
        """
        position, xyzw = self._command
        return self.run(position[np.newaxis], xyzw[np.newaxis], noise)

    def run(self, positions: Array, xyzw: Array, noise: bool = True) -> Samples:
        """
        Advance by one robot period per command.

        Parameters
        ----------
        positions : ndarray, shape (m, 3)
            Of S in base [m].
        xyzw : ndarray, shape (m, 4)
            Orientations of S in base, unit quaternions.
        noise : bool
            False: readings of noise-free sensors, without losses.

        Returns
        -------
        Samples
            Of these m periods.
        """
        if self._periods == 0:
            self._plant.rest(positions[0], xyzw[0])
        motion = self._plant.move(positions, xyzw)
        slide, response = self._plant.respond(motion)
        samples = self._sample(motion, slide, response, noise)
        self._periods += len(positions)
        return self._arrive(samples) if noise else samples

    def _times(self, sensor: str, n_steps: int) -> tuple[Array, int]:
        """Return the sample times of a sensor, and every how many steps it samples."""
        per_period = self._rig.samples_per_period(sensor)
        n = n_steps * per_period // self._plant.steps
        index = self._periods * per_period + 1 + np.arange(n)
        return index / (per_period / self._rig.robot.period), self._plant.steps // per_period

    def _sample(self, motion: Motion, slide: Slide, response: Response, noise: bool) -> Samples:
        n = len(response.wrench)
        sensor, model = self._rig.wrench_sensor, self._model
        wrench_t, every = self._times('wrench_sensor', n)
        wrench = response.wrench[every - 1::every] * sensor.gain + sensor.bias
        wrench = self._wrench.before_noise(wrench)
        contact = response.contact[every - 1::every]
        accelerometer_t, every = self._times('accelerometer', n)
        volts = response.specific_force[every - 1::every] * model.gain + model.offset
        volts = self._volts.before_noise(volts)
        pose_t, every = self._times('pose_sensor', n)
        position = motion.position[2 * every::2 * every]
        R_base_sensor = motion.R_base_sensor[2 * every::2 * every]
        optidrive_t = optidrive = np.empty(0)
        if self._rig.optidrive:
            optidrive_t, every = self._times('optidrive', n)
            optidrive = slide.slide[every::every]
        if noise:
            wrench = wrench + self._noise.wrench(len(wrench))
            volts = volts + self._noise.volts(len(volts))
            optidrive = optidrive + self._noise.optidrive(len(optidrive))
            position = position + self._noise.position(len(position))
            R_base_sensor = R_base_sensor @ self._noise.turn(len(R_base_sensor))
        wrench, volts = self._wrench.after_noise(wrench), self._volts.after_noise(volts)
        specific_force = (volts - model.offset) / model.gain
        stamps = self._arrival.stamps
        return Samples(
            stamps('wrench', wrench_t), wrench, wrench_t, contact,
            stamps('accelerometer', accelerometer_t), volts, specific_force,
            stamps('optidrive', optidrive_t), optidrive,
            stamps('pose', pose_t), position, R_base_sensor)

    def _arrive(self, s: Samples) -> Samples:
        """Leave out the samples that get lost."""
        if not self._arrival.loses:
            return s
        for stream, names in SIGNALS.items():
            here = self._arrival.arrived(stream, len(getattr(s, names[0])))
            s = s._replace(**{name: getattr(s, name)[here] for name in names})
        return s


def checked_commands(positions: Array, R_base_sensor: Array) -> tuple[Array, Array]:
    """
    Check commanded poses.

    Parameters
    ----------
    positions : ndarray, shape (m, 3)
        Of S in base [m].
    R_base_sensor : ndarray, shape (m, 3, 3)

    Returns
    -------
    positions : ndarray, shape (m, 3)
    xyzw : ndarray, shape (m, 4)
        What :meth:`Simulator.run` takes.

    Raises
    ------
    MotionError
        Not finite, or not rotations.
    """
    if not (np.isfinite(positions).all() and np.isfinite(R_base_sensor).all()):
        raise MotionError('a commanded pose is not finite; send finite numbers only')
    squares = np.swapaxes(R_base_sensor, -1, -2) @ R_base_sensor
    worst = float(np.abs(squares - np.eye(3)).max())
    if worst > 1e-6 or (np.linalg.det(R_base_sensor) < 0.0).any():
        raise MotionError(f'a commanded orientation is not a rotation (R^T R differs from 1 by '
                          f'{worst:.2g}, or it is left-handed); send unit quaternions')
    return positions, quaternion_from_matrix(R_base_sensor)


def waits_for_compiler() -> bool:
    """Whether the first period has to wait until the rig is compiled."""
    return jit.waits_for_compiler(move, slide_along, respond)


def warm_up() -> None:
    """Compile what is not compiled yet, which may take some seconds after an install."""
    Simulator(load_rig()).advance()


def held_commands(stamps: Array, starts: Array, tolerance: float) -> NDArray[np.intp]:
    """
    Say which command holds during each robot period: the latest one there is at its start.

    Parameters
    ----------
    stamps : ndarray, shape (m,)
        Of the commands, increasing [s].
    starts : ndarray, shape (n,)
        Of the robot's periods [s]; before the first command, the first one holds.
    tolerance : float
        How late a command may be and still count for its period [s].

    Returns
    -------
    ndarray of int, shape (n,)
    """
    latest = np.searchsorted(stamps, starts + tolerance, side='right') - 1
    return np.maximum(latest, 0)


def simulate(rig: Rig, target: PoseStream, *, accelerometer: str | None = None,
             noise: bool = True, seed: int | None = None, duration: float | None = None,
             unit: Literal['V', 'm/s^2'] = 'V', steps: int | None = None) -> Recording:
    """
    Simulate the recording that a stream of commands would give.

    Parameters
    ----------
    target : PoseStream
        Commanded poses. In each period of the robot the command holds that is the latest at its
        start, give or take half a period: jitter neither drops nor doubles any, and a missing one
        leaves the one before.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.
    noise : bool
        False: readings of noise-free sensors, without losses.
    seed : int, optional
        Of the noise; fresh noise each time where none is given.
    duration : float, optional
        How long to go on from the first command [s]; one period beyond the last command where
        none is given.
    unit : str
        Of the accelerometer: ``V``, or ``m/s^2`` for specific force.
    steps : int, optional
        Integration steps per period; fewest sufficient ones where none is given.

    Returns
    -------
    Recording
        Times on the clock of ``target``.

    Raises
    ------
    DataError
        There are no commands, or commands without position.
    """
    # robot periods simulated in one block, which bounds the memory
    block = 500
    if not target.has_position:
        raise DataError(f'{len(target)} commands, not all with a position, cannot be simulated; '
                        'record target_frame with positions')
    period = rig.robot.period
    t0 = float(target.t[0])
    span = float(target.t[-1]) - t0 + period if duration is None else duration
    starts = np.array([t0 + k * period for k in range(max(1, round(span / period)))])
    held = held_commands(target.t, starts, period / 2.0)
    positions, xyzw = checked_commands(target.position, target.R_base_sensor)
    simulator = Simulator(rig, accelerometer, seed, steps=steps)
    blocks = [simulator.run(positions[held[i:i + block]], xyzw[held[i:i + block]], noise)
              for i in range(0, len(held), block)]
    samples = Samples(*map(np.concatenate, zip(*blocks)))
    return _recording(samples, target, t0, unit)


def _recording(s: Samples, target: PoseStream, t0: float, unit: str) -> Recording:
    return Recording(
        wrench=Stream(t0 + s.wrench_t, s.wrench, 'ft_sensor'),
        accelerometer=Stream(t0 + s.accelerometer_t,
                             s.volts if unit == 'V' else s.specific_force, 'accelerometer'),
        accelerometer_unit=unit,
        pose=PoseStream(t0 + s.pose_t, s.position, s.R_base_sensor, target.frame),
        target=target,
        optidrive=(Stream(t0 + s.optidrive_t, s.optidrive[:, np.newaxis], 'ft_sensor')
                   if len(s.optidrive) else None),
        contact_truth=Stream(t0 + s.contact_t, s.contact, 'ft_sensor'),
        source='simulation')
