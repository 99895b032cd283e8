"""The physics without the sensors: commands move the robot, the tool slides and meets the wall."""

import math

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion
from forcecal_ros.effects.numbers import physical_rig
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.parameters import kernel_parameters, slide_rates
from forcecal_ros.sim.rig.robot import Motion, move, robot_at_rest, without_traces
from forcecal_ros.sim.rig.robot_effects import CommandDelays, MotionEffects
from forcecal_ros.sim.rig.sensors import highpass_settled, respond, Response
from forcecal_ros.sim.rig.tool import Slide, slide_along, tool_at_rest
import numpy as np

LONGEST_STEP = 0.0005
"""Longest integration step [s]: forces of the nominal rig have converged to 1e-4 N."""

AT_ONCE = 2048
"""Periods that are moved along at once: effects of the robot work on copies."""

FASTEST = 0.2
"""Longest step times the fastest rate of tool or orientation servo [rad]."""


class Plant:
    """
    The physics of a rig, block after block, its effects included.

    The robot does not feel its load, so one motion serves every tool and wall: see
    :func:`same_motion`.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.
    steps : int, optional
        Integration steps per robot period, a multiple of what the sensor rates ask for; the
        fewest sufficient ones (0.5 ms or less) where none is given.

    Raises
    ------
    ConfigError
        No such accelerometer, or steps that miss samples.
    """

    def __init__(self, rig: Rig, accelerometer: str | None = None,
                 steps: int | None = None) -> None:
        self.steps = steps or enough_steps(rig)
        if self.steps % common_samples(rig):
            raise ConfigError(f'{steps} integration steps per robot period miss samples of the '
                              f'sensors; give a multiple of {common_samples(rig)}')
        self._p = kernel_parameters(rig, accelerometer)[()]
        self._rig, self._step = rig, rig.robot.period / self.steps

    def rest(self, position: Array, xyzw: Array) -> None:
        """
        Begin anew, having rested at one pose for ever.

        Parameters
        ----------
        position : ndarray, shape (3,)
            Of S in base [m].
        xyzw : ndarray, shape (4,)
        """
        R_base_sensor = matrix_from_quaternion(xyzw)
        self._effects = MotionEffects(self._rig, self._step / 2.0)
        self._delays = CommandDelays(self._rig, position, xyzw)
        self._robot = robot_at_rest(position, xyzw)[0]
        self._tool = tool_at_rest(self._p, position, R_base_sensor)[0]
        self._highpass = highpass_settled(self._p, R_base_sensor)[0]

    def move(self, positions: Array, xyzw: Array) -> Motion:
        """
        Follow commands, one robot period each.

        Parameters
        ----------
        positions : ndarray, shape (m, 3)
            Of S in base [m].
        xyzw : ndarray, shape (m, 4)

        Returns
        -------
        Motion
            At 2 steps m + 1 nodes.
        """
        nodes = 2 * self.steps
        motion = Motion.empty(nodes * len(positions) + 1)
        for begin in range(0, len(positions), AT_ONCE):
            end = min(begin + AT_ONCE, len(positions))
            self._move(positions[begin:end], xyzw[begin:end],
                       Motion(*(part[nodes * begin:nodes * end + 1] for part in motion)))
        return motion

    def _move(self, positions: Array, xyzw: Array, motion: Motion) -> None:
        """Follow commands, and fill a motion."""
        positions, xyzw = self._delays(positions, xyzw)
        # copies: read-only arrays would be another type, and compiled anew
        move(self._p, self._robot, np.array(positions, dtype=float),
             np.array(xyzw, dtype=float), self.steps, motion)
        for part, values in zip(motion, self._effects(motion)):
            if values is not part:
                part[:] = values
            without_traces(part)

    def respond(self, motion: Motion) -> tuple[Slide, Response]:
        """
        Let the tool respond to a block of motion.

        Parameters
        ----------
        motion : Motion
            Of this plant, or of another one of the :func:`same_motion` and steps.

        Returns
        -------
        Slide
            At the steps, the start included.
        Response
            At the steps, the start left out.
        """
        n = len(motion.position) // 2
        slide, response = Slide.empty(n + 1), Response.empty(n)
        slide_along(self._p, self._tool, motion, self._step, slide)
        respond(self._p, self._highpass, motion, slide, self._step, response)
        return slide, response


def same_motion(rig: Rig) -> object:
    """Return a key that rigs share (equal, same hash) whose S moves alike."""
    return (rig.robot, rig.servo, *(one for one in rig.effects if one[0].startswith('robot_')))


def common_samples(rig: Rig) -> int:
    """Return the fewest equal parts of a robot period at whose ends all samples lie."""
    sensors = ('wrench_sensor', 'accelerometer', 'pose_sensor', 'optidrive')
    return math.lcm(*(rig.samples_per_period(s) for s in sensors if getattr(rig, s)))


def enough_steps(rig: Rig) -> int:
    """
    Return the fewest integration steps per robot period that are accurate and hit every sample.

    Returns
    -------
    int
        Steps are LONGEST_STEP at most, FASTEST over the fastest rate of servo and tool at most,
        and a whole number of them lies between the samples of each sensor.
    """
    common, rig = common_samples(rig), physical_rig(rig)
    damping = max(1.0, rig.servo.orientation_damping or 1.0)
    turning = rig.servo.orientation_bandwidth * (damping + math.sqrt(damping ** 2 - 1.0))
    rates = [FASTEST / LONGEST_STEP, turning, *slide_rates(rig)]
    if rig.optidrive:
        rates += [
            math.sqrt((rig.optidrive.stiffness + rig.wall.stiffness) / rig.tool.mass),
            (rig.optidrive.damping + rig.wall.damping) / rig.tool.mass]
    return common * math.ceil(rig.robot.period * max(rates) / FASTEST / common - 1e-9)
