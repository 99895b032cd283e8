"""The second rig: numbers, how far a healthy one strays, and a run of it without sensors."""

from collections.abc import Callable
from typing import Any, NamedTuple

from blind.dynamics import feel
from blind.robot import Array, Motion, move, quaternions, Robot
from blind.tool import Felt, Tool, Wall
import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
ACCELEROMETERS = {'acc1': (-0.2937, 5.0938, 0.0), 'acc2': (0.2525, 5.9616, 0.01)}
"""Gain [V/(m/s^2)], offset [V], high-pass [Hz]."""

Stage = Callable[[Any, Any, np.random.Generator], Any]
"""(fine truth, signal, randomness) -> signal: one thing a sensor does to what it feels."""


class Sensors(NamedTuple):
    """
    What turns the felt into the recorded.

    Attributes
    ----------
    bias, gain : ndarray, shape (6,)
        Of the wrench [N, N m], relative.
    accel_gain, accel_offset : ndarray, shape (3,)
        [V/(m/s^2)], [V]
    accel_highpass : float
        Corner [Hz].
    place : ndarray, shape (3,)
        Of the accelerometer in S [m].
    wrench, wrench_reading, specific, volts_reading, slide, pose, stamps : tuple of callables
        Further stages, in order of action: on the wrench and on specific force as they are felt,
        on both as they are read (noise included), on the displacement, on the pose and on the
        whole recording.
    """

    bias: Array
    gain: Array
    accel_gain: Array
    accel_offset: Array
    accel_highpass: float
    place: Array
    wrench: tuple[Stage, ...] = ()
    wrench_reading: tuple[Stage, ...] = ()
    specific: tuple[Stage, ...] = ()
    volts_reading: tuple[Stage, ...] = ()
    slide: tuple[Stage, ...] = ()
    pose: tuple[Stage, ...] = ()
    stamps: tuple[Stage, ...] = ()


class Rig(NamedTuple):
    """Everything; effects return a changed one."""

    robot: Robot
    tool: Tool
    wall: Wall
    sensors: Sensors


def nominal(accelerometer: str = 'acc1') -> Rig:
    """Return the rig as the paper and its stand-in numbers have it."""
    gain, offset, corner = ACCELEROMETERS[accelerometer]
    return Rig(
        Robot(),
        Tool(13.0, np.array([0.03, -0.01, 0.14]), np.array([0.12, 0.15, 0.06]), 5000.0, 130.0,
             np.array([0.0, 0.0, -GRAVITY])),
        Wall(1.28, 10000.0, 50.0, np.array([0.20, 0.0, 0.10])),
        Sensors(np.array([4.0, -3.0, 8.0, 0.3, -0.2, 0.1]), np.ones(6), np.full(3, gain),
                np.full(3, offset), corner, np.array([0.05, 0.0, 0.18])))


NUISANCES: dict[str, tuple[int, float]] = {
    'mass': (1, 0.005), 'com': (3, 0.0005), 'stiffness': (1, 0.005), 'damping': (1, 0.02),
    'inertia': (3, 0.05), 'wall_place': (1, 1e-4), 'wall_stiffness': (1, 0.03),
    'wall_damping': (1, 0.10), 'force_bias': (3, 0.3), 'torque_bias': (3, 0.02),
    'wrench_gain': (6, 0.002), 'accel_gain': (3, 0.002), 'accel_offset': (3, 0.010)}
"""Name -> how many numbers, 1 sigma of each."""


def draw_nuisances(rng: np.random.Generator) -> dict[str, Array]:
    """Draw by how many sigma each number strays, at most 2.5."""
    return {name: np.clip(rng.standard_normal(count), -2.5, 2.5)
            for name, (count, _) in NUISANCES.items()}


def astray(rig: Rig, sigmas: dict[str, Array]) -> Rig:
    """Return a healthy rig that strays from nominal by so many sigma."""
    d = {name: sigmas.get(name, np.zeros(count)) * sigma
         for name, (count, sigma) in NUISANCES.items()}
    tool, wall, sensors = rig.tool, rig.wall, rig.sensors
    return rig._replace(
        tool=tool._replace(
            mass=tool.mass * (1 + d['mass'][0]), com=tool.com + d['com'],
            inertia=tool.inertia * (1 + d['inertia']),
            stiffness=tool.stiffness * (1 + d['stiffness'][0]),
            damping=tool.damping * (1 + d['damping'][0])),
        wall=wall._replace(
            place=wall.place + d['wall_place'][0],
            stiffness=wall.stiffness * (1 + d['wall_stiffness'][0]),
            damping=wall.damping * (1 + d['wall_damping'][0])),
        sensors=sensors._replace(
            bias=sensors.bias + np.concatenate([d['force_bias'], d['torque_bias']]),
            gain=sensors.gain * (1 + d['wrench_gain']),
            accel_gain=sensors.accel_gain * (1 + d['accel_gain']),
            accel_offset=sensors.accel_offset + d['accel_offset']))


class Commands(NamedTuple):
    """Commanded poses, one every 4 ms, and what each part of the motion is called."""

    position: Array
    R: Array
    phases: tuple[tuple[str, float, float], ...]


class Truth(NamedTuple):
    """A run without sensors, on a grid of 0.25 ms."""

    t: Array
    felt: Felt
    motion: Motion
    commands: Commands


def follow(robot: Robot, commands: Commands) -> Motion:
    """Return the motion of S that a robot makes of commands."""
    return move(robot, commands.position, quaternions(commands.R))


def run(rig: Rig, commands: Commands, motion: Motion | None = None) -> Truth:
    """Run the rig on commands; ``motion``: what its robot makes of them, where that is known."""
    motion = motion or follow(rig.robot, commands)
    felt = feel(rig.tool, rig.wall, motion, rig.sensors.place)
    coarse = Motion(*(one[:-1:2][:len(felt.slide)] for one in motion))
    return Truth(0.00025 * np.arange(len(felt.slide), dtype=float), felt, coarse, commands)


def rotations(vectors: Array) -> Array:
    """Return the matrices (n, 3, 3) of rotation vectors (n, 3) [rad]."""
    return np.asarray(Rotation.from_rotvec(vectors).as_matrix())


def rotation(vector: Array) -> Array:
    """Return the matrix of a rotation vector [rad]."""
    return np.asarray(rotations(vector[None])[0])
