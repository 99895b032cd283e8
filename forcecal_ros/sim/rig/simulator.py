"""The whole rig: commands in, readings of the sensors out, any number of periods at a time."""

from typing import NamedTuple

from forcecal_ros.core import jit
from forcecal_ros.core.errors import MotionError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import AccelerometerEffects, StampEffects, WrenchEffects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.plant import Plant
from forcecal_ros.sim.rig.robot import Motion, move
from forcecal_ros.sim.rig.sensors import Noise, respond, Response
from forcecal_ros.sim.rig.tool import Slide, slide_along
import numpy as np
from numpy.typing import ArrayLike

ORTHONORMAL = 1e-6
"""Largest deviation of R^T R from 1 for a commanded rotation R: rounding."""


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
        raise MotionError('a commanded pose is not finite; send numbers only')
    squares = np.swapaxes(R_base_sensor, -1, -2) @ R_base_sensor
    worst = float(np.abs(squares - np.eye(3)).max())
    if worst > ORTHONORMAL or (np.linalg.det(R_base_sensor) < 0.0).any():
        raise MotionError(f'a commanded orientation is no rotation (R^T R departs from 1 by '
                          f'{worst:.2g}, or it is left-handed); send unit quaternions')
    return positions, quaternion_from_matrix(R_base_sensor)


def waits_for_compiler() -> bool:
    """Whether the first period has to wait until the rig is compiled."""
    return jit.waits_for_compiler(move, slide_along, respond)


def warm_up() -> None:
    """Compile whatever is not compiled yet, which may take some seconds after an install."""
    Simulator(load_rig()).advance()
