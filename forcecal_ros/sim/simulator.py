"""The rig as a whole: commands in, what the sensors say out, any number of periods at a time."""

import math
from typing import NamedTuple

from forcecal_ros.errors import ConfigError, MotionError
from forcecal_ros.geometry import Array, matrix_from_quaternion, quaternion_from_matrix
from forcecal_ros.sim.parameters import kernel_parameters
from forcecal_ros.sim.rig import Rig
from forcecal_ros.sim.rig_file import load_rig
from forcecal_ros.sim.robot import Motion, move, robot_at_rest
from forcecal_ros.sim.sensors import highpass_settled, Noise, respond, Response
from forcecal_ros.sim.tool import Slide, slide_along, tool_at_rest
import numpy as np
from numpy.typing import ArrayLike

LONGEST_STEP = 0.0005
"""Of the integration [s]; converged to better than 1e-4 N on the nominal rig."""

FASTEST = 0.2
"""Most of a step times the fastest rate of the tool or the orientation servo [rad]."""

ORTHONORMAL = 1e-6
"""Most that the product of a commanded rotation and its transpose departs from 1."""


class Samples(NamedTuple):
    """
    What the sensors say during one or more robot periods.

    Times are seconds since command 0; sample i of a signal is its state at ``t[i]``.

    Attributes
    ----------
    wrench_t : ndarray, shape (n,)
    wrench : ndarray, shape (n, 6)
        As on the wire: environment on tool, in ft_sensor, bias included [N], [N m].
    contact : ndarray, shape (n, 6)
        The truth, at the same times: environment on tool, in ft_sensor, about its origin.
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
    contact: Array
    accelerometer_t: Array
    volts: Array
    specific_force: Array
    optidrive_t: Array
    optidrive: Array
    pose_t: Array
    position: Array
    R_base_sensor: Array


class Simulator:
    """
    The rig, one robot period after another.

    Before its first command everything rests at the first commanded pose, the tool at its static
    sag; without any command that pose is the rig's home.

    Parameters
    ----------
    rig : Rig
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
        self._p = kernel_parameters(rig, accelerometer)[()]
        self._model = rig.accelerometer.model(accelerometer)
        self._noise = Noise(rig, seed)
        self._steps = steps or enough_steps(rig)
        if self._steps % _common_samples(rig):
            raise ConfigError(f'{steps} integration steps per robot period miss samples of the '
                              f'sensors; give a multiple of {_common_samples(rig)}')
        self._step = rig.robot.period / self._steps
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
            False: what noise-free sensors would say.

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
            False: what noise-free sensors would say.

        Returns
        -------
        Samples
            Of these m periods.
        """
        positions, xyzw = np.array(positions, dtype=float), np.array(xyzw, dtype=float)
        if self._periods == 0:
            self._rest(positions[0], xyzw[0])
        n = len(positions) * self._steps
        motion, slide, response = Motion.empty(2 * n + 1), Slide.empty(n + 1), Response.empty(n)
        move(self._p, self._robot, positions, xyzw, self._steps, motion)
        slide_along(self._p, self._tool, motion, self._step, slide)
        respond(self._p, self._highpass, motion, slide, self._step, response)
        samples = self._sample(motion, slide, response, noise)
        self._periods += len(positions)
        return samples

    def _rest(self, position: Array, xyzw: Array) -> None:
        R_base_sensor = matrix_from_quaternion(xyzw)
        self._robot = robot_at_rest(position, xyzw)[0]
        self._tool = tool_at_rest(self._p, position, R_base_sensor)[0]
        self._highpass = highpass_settled(self._p, R_base_sensor)[0]

    def _times(self, sensor: str, n_steps: int) -> tuple[Array, int]:
        """Return the sample times of a sensor, and every how many steps it samples."""
        per_period = self._rig.samples_per_period(sensor)
        n = n_steps * per_period // self._steps
        index = self._periods * per_period + 1 + np.arange(n)
        return index / (per_period / self._rig.robot.period), self._steps // per_period

    def _sample(self, motion: Motion, slide: Slide, response: Response, noise: bool) -> Samples:
        n = len(response.wrench)
        sensor, model = self._rig.wrench_sensor, self._model
        wrench_t, every = self._times('wrench_sensor', n)
        wrench = response.wrench[every - 1::every] * sensor.gain + sensor.bias
        contact = response.contact[every - 1::every]
        accelerometer_t, every = self._times('accelerometer', n)
        volts = response.specific_force[every - 1::every] * model.gain + model.offset
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
        specific_force = (volts - model.offset) / model.gain
        return Samples(wrench_t, wrench, contact, accelerometer_t, volts, specific_force,
                       optidrive_t, optidrive, pose_t, position, R_base_sensor)


def _common_samples(rig: Rig) -> int:
    """Return the fewest equal parts of a robot period at whose ends all samples lie."""
    sensors = ('wrench_sensor', 'accelerometer', 'pose_sensor', 'optidrive')
    return math.lcm(*(rig.samples_per_period(s) for s in sensors if getattr(rig, s)))


def enough_steps(rig: Rig) -> int:
    """
    Return the fewest integration steps per robot period that are accurate and meet the sensors.

    Parameters
    ----------
    rig : Rig

    Returns
    -------
    int
        Steps are LONGEST_STEP at most, FASTEST over the fastest rate of servo and tool at most,
        and a whole number of them lies between the samples of each sensor.
    """
    common = _common_samples(rig)
    rates = [FASTEST / LONGEST_STEP, rig.servo.orientation_bandwidth]
    if rig.optidrive:
        rates += [
            math.sqrt((rig.optidrive.stiffness + rig.wall.stiffness) / rig.tool.mass),
            (rig.optidrive.damping + rig.wall.damping) / rig.tool.mass]
    return common * math.ceil(rig.robot.period * max(rates) / FASTEST / common - 1e-9)


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


def warm_up() -> None:
    """Compile whatever is not compiled yet, which may take some seconds after an install."""
    Simulator(load_rig()).advance()
