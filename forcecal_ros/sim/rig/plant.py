"""Robot, tool and sensors of a rig, integrated together by compiled loops.

The loops read one flat record of the rig's numbers, with the effects on the tool's displacement.
"""

import math
from typing import Any

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion
from forcecal_ros.effects.library import EFFECTS, named_effects
from forcecal_ros.effects.rig import physical_rig, Rig
from forcecal_ros.sim.rig.robot import (
    CommandDelays,
    Motion,
    MotionEffects,
    move,
    robot_at_rest,
    without_traces,
)
from forcecal_ros.sim.rig.sensors import highpass_settled, respond, Response
from forcecal_ros.sim.rig.tool import Slide, slide_along, tool_at_rest
import numpy as np

SLIDE_EFFECTS = (
    ('extra', 'f8'),                      # 1: something of the following is not 0
    ('stiffening', 'f8'),                 # [N/m^3]
    ('friction', 'f8'),                   # [N]
    ('friction_speed', 'f8'),             # [m/s] at which 76 % of it act
    ('presliding', 'f8'),                 # [m] after which it acts in full; 0: by speed instead
    ('half_gap', 'f8'),                   # [m] of play either way
    ('cable_force', 'f8', 3),             # [N] in base, S at home and the tool undisplaced
    ('cable_stiffness', 'f8'),            # [N/m]
    ('cable_point', 'f8', 3),             # [m] in S, tool undisplaced
    ('cable_home', 'f8', 3),              # [m] where the point is in base at home
    ('spindle_sine', 'f8', 3),            # [N] in S
    ('spindle_cosine', 'f8', 3),          # [N] in S
    ('spindle_rate', 'f8'),               # [rad/s]
    ('spindle_point', 'f8', 3),           # [m] in S, tool undisplaced
)
"""Fields of the record; :mod:`forcecal_ros.sim.rig.tool` documents what they do."""

NAMES = ('tool_stiffening', 'tool_friction', 'tool_backlash', 'cable_force', 'spindle_vibration')
"""Effects that enter the integration of the tool."""


def slide_effects(rig: Rig) -> tuple[Any, ...]:
    """
    Flatten the effects that enter the integration of the tool.

    Returns
    -------
    tuple
        One value for each of SLIDE_EFFECTS.
    """
    named = named_effects(rig.effects)
    extra = float(any(name in named for name in NAMES))
    stiffening, friction, backlash, cable, spindle = (
        named.get(name) or {q.name: q.nominal for q in EFFECTS[name].parameters}
        for name in NAMES)
    cable_point = [cable[f'point_{axis}'] for axis in 'xyz']
    return (
        extra, stiffening['cubic'], friction['force'], friction['velocity_scale'],
        friction['presliding'], 0.5 * backlash['gap'],
        [cable[axis] for axis in 'xyz'], cable['stiffness'], cable_point,
        np.array(rig.home.position) + rig.home.R_base_sensor @ cable_point,
        [spindle[f'sine_{axis}'] for axis in 'xyz'],
        [spindle[f'cosine_{axis}'] for axis in 'xyz'],
        2.0 * math.pi * spindle['frequency'], [spindle[f'point_{axis}'] for axis in 'xyz'],
    )


def slide_rates(rig: Rig) -> list[float]:
    """
    Return the rates that these effects add to the tool's dynamics.

    Returns
    -------
    list of float
        [rad/s]
    """
    named = named_effects(rig.effects)
    rates = []
    if 'tool_stiffening' in named and rig.optidrive:
        cubic = named['tool_stiffening']['cubic']
        # displacement up to which the integration resolves a stiffening spring [m]
        rates.append(math.sqrt((rig.optidrive.stiffness + rig.wall.stiffness
                                + 3.0 * max(0.0, cubic) * 0.015 ** 2) / rig.tool.mass))
    if 'tool_friction' in named:
        v = named['tool_friction']
        if v['presliding']:
            stiffness = rig.optidrive.stiffness if rig.optidrive else 0.0
            rates.append(math.sqrt((stiffness + v['force'] / v['presliding']) / rig.tool.mass))
        else:
            # share of the rate of creep in friction that the integration
            # resolves: creep is over at once
            rates.append(v['force'] / v['velocity_scale'] / rig.tool.mass * 0.5)
    if 'spindle_vibration' in named:
        rates.append(2.0 * math.pi * named['spindle_vibration']['frequency'])
    return rates


PARAMETERS = np.dtype([
    ('period', 'f8'),                     # [s]
    ('feedback', 'f8', (3, 3)),           # [1] axis, k-1 to k-3
    ('feedforward', 'f8', (3, 3)),        # [1] the same of the commands
    ('direct', 'f8', 3),                  # 1: those are of k to k-2
    ('position_bandwidth', 'f8'),         # [rad/s]
    ('orientation_bandwidth', 'f8'),      # [rad/s]
    ('orientation_damping', 'f8'),        # [1]
    ('gravity', 'f8', 3),                 # [m/s^2] in base
    ('mass', 'f8'),                       # [kg]
    ('com', 'f8', 3),                     # [m] in S, tool undisplaced
    ('inertia', 'f8', (3, 3)),            # [kg m^2] about the CoM
    ('rigid', 'f8'),                      # 1: the tool does not slide
    ('stiffness', 'f8'),                  # [N/m]
    ('damping', 'f8'),                    # [N s/m]
    ('tip', 'f8', 3),                     # [m] in S, tool undisplaced
    ('wall_position', 'f8'),              # [m]
    ('wall_stiffness', 'f8'),             # [N/m]
    ('wall_damping', 'f8'),               # [N s/m]
    ('accelerometer_position', 'f8', 3),  # [m] in S, tool undisplaced
    ('highpass', 'f8'),                   # [rad/s]
    *SLIDE_EFFECTS,
])
"""Layout of the record; numba compiles anew when it changes."""


def kernel_parameters(rig: Rig, accelerometer: str | None = None) -> Array:
    """
    Flatten the numbers that the compiled loops need.

    Parameters
    ----------
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the mounted one where none is given.

    Returns
    -------
    ndarray of PARAMETERS, shape ()
        Its ``[()]`` is the record that the loops take.
    """
    rig = physical_rig(rig)
    slides = rig.optidrive
    model = rig.accelerometer.model(accelerometer)
    robot, damping = rig.robot, rig.servo.orientation_damping
    return np.array((
        robot.period, [(axis or robot).feedback for axis in robot.axes],
        [(axis or robot).feedforward for axis in robot.axes],
        [0.0 if axis is None else 1.0 for axis in robot.axes],
        rig.servo.position_bandwidth, rig.servo.orientation_bandwidth,
        1.0 if damping is None else damping,
        rig.gravity,
        rig.tool.mass, rig.tool.com, rig.tool.inertia,
        0.0 if slides else 1.0,
        slides.stiffness if slides else 0.0, slides.damping if slides else 0.0,
        rig.tool.tip, rig.wall.position, rig.wall.stiffness, rig.wall.damping,
        rig.accelerometer.position, 2.0 * math.pi * model.highpass,
        *slide_effects(rig),
    ), dtype=PARAMETERS)


AT_ONCE = 2048
"""Periods that are moved along at once: effects of the robot work on copies."""


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
            raise ConfigError(f'{steps} integration steps per robot period do not reach all '
                              f'samples of sensors; give a multiple of {common_samples(rig)}')
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
        Steps are 0.5 ms at most, FASTEST over the fastest rate of servo and tool at most,
        and a whole number of them lies between the samples of each sensor.
    """
    # longest step times the fastest rate of tool or orientation servo [rad]
    fastest = 0.2
    common, rig = common_samples(rig), physical_rig(rig)
    damping = max(1.0, rig.servo.orientation_damping or 1.0)
    turning = rig.servo.orientation_bandwidth * (damping + math.sqrt(damping ** 2 - 1.0))
    # longest integration step [s]: forces of the nominal rig have converged to 1e-4 N
    rates = [fastest / 0.0005, turning, *slide_rates(rig)]
    if rig.optidrive:
        rates += [
            math.sqrt((rig.optidrive.stiffness + rig.wall.stiffness) / rig.tool.mass),
            (rig.optidrive.damping + rig.wall.damping) / rig.tool.mass]
    return common * math.ceil(rig.robot.period * max(rates) / fastest / common - 1e-9)
