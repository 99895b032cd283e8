"""Simulated robots to try commands on: an arm nearly like its model, a limb for ``insitu``."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_from_vector, STANDARD_GRAVITY
from forcecal_ros.core.streams import JointStream, Recording
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.third_party import ThirdParty
import numpy as np

RATE, DURATION = 100.0, 60.0
"""[Hz], [s]: a minute, as [Traversaro2014] took for each added mass."""

MASS, COM = 2.9, np.array([0.012, -0.008, 0.205])
"""Of the limb alone [kg], in the sensor's frame [m]."""

SWINGS = ((np.deg2rad(40.0), 30.0), (np.deg2rad(30.0), 23.0))
"""Amplitude [rad] and period [s] about y and about x: so slow that weight alone counts."""

LIMB_NOISE = np.array([0.3, 0.3, 0.3, 0.02, 0.02, 0.02])
"""Of the wrench [N, N m]; that of the accelerometer is 0.05 m/s^2."""

ACCELERATION_NOISE = 0.05


class Load(NamedTuple):
    """An added mass [kg], where it is in the sensor's frame [m], and what it is used for."""

    mass: float
    position: tuple[float, float, float]
    use: str = 'train'


LOADS = {
    'nothing_added': Load(0.0, (0.0, 0.0, 0.0)),
    'front': Load(0.51, (0.34, 0.10, 0.39)),
    'left': Load(0.51, (0.02, -0.14, 0.42)),
    'right': Load(0.51, (0.24, -0.12, 0.45)),
    'far': Load(0.51, (0.39, 0.04, 0.39), 'validate'),
}
"""As many as a matrix takes, their centres of mass not on one line, and one to check it with."""


class Log(NamedTuple):
    """One recording: stamps (n,) [s], raw channels (n, 6), specific force (n, 3) [m/s^2]."""

    t: Array
    raw: Array
    accel: Array


def gauges() -> tuple[Array, Array]:
    """Return what six gauges around a hub show of a wrench [counts per N, N m], and at none."""
    angle = np.deg2rad(60.0) * np.arange(6)
    columns = (40.0 * np.cos(angle), 40.0 * np.sin(angle), np.full(6, 35.0),
               800.0 * np.cos(2.0 * angle), 800.0 * np.sin(2.0 * angle),
               600.0 * (-1.0) ** np.arange(6))
    return np.stack(columns, axis=1), np.array([1250.0, -840.0, 310.0, 2210.0, -1730.0, 420.0])


def logs(seed: int) -> Mapping[str, Log]:
    """Return a recording of each of :data:`LOADS`, by name."""
    rng = np.random.default_rng(seed)
    return {name: record(load, rng) for name, load in LOADS.items()}


def record(load: Load, rng: np.random.Generator) -> Log:
    """Tilt the limb with a load on it, and write down what its sensors say."""
    t = np.arange(round(DURATION * RATE)) / RATE
    pitch, roll = (amplitude * np.sin(2.0 * np.pi * (t / period + rng.uniform()))
                   for amplitude, period in SWINGS)
    # the limb hangs along z of the sensor
    gravity = STANDARD_GRAVITY * np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll),
                                  np.cos(pitch) * np.cos(roll)], axis=1)
    moment = MASS * COM + load.mass * np.array(load.position)
    wrench = np.hstack([(MASS + load.mass) * gravity, np.cross(moment, gravity)])
    matrix, offset = gauges()
    measured = wrench + LIMB_NOISE * rng.standard_normal(wrench.shape)
    accel = -gravity + ACCELERATION_NOISE * rng.standard_normal(gravity.shape)
    return Log(t, measured @ matrix.T + offset, accel)


SECONDS, PERIOD = 20.0, 0.008
"""Length of the motion, and between commands: 125 Hz, as for many controllers [s]."""

REST, RISE = 1.0, 2.0
"""At rest at either end, and until the motion has its full size [s]."""

HOME = (0.3, -1.3, 1.7, -1.9, -1.5, 0.4)
"""Joints at rest [rad]."""

SIZES = (0.3, 0.15, 0.2, 0.6, 0.8, 1.0)
"""By which each joint swings at the slowest [rad]: the wrist most, it turns gravity."""

SLOWEST, FASTEST = 0.08, 0.9
"""Of the sines that a joint's motion is made of [Hz]: what an arm of that size can follow."""

HEAVIER = {'body_mass[gripper]': 1.05}
"""What is wrong with the second robot: factors of its model's numbers."""

OFF = 0.5
"""By which every other number is off, in its sigma, up or down."""

ARM_NOISE = (0.15, 0.006, 1e-4, 2e-4)
"""Of force [N], torque [N m], position [m], orientation [rad], 1 sigma: as of a UR's."""

ZERO = (3.0, -1.0, 2.0, 0.1, 0.0, -0.2)
"""The sensor's zero [N], [N m]."""


def commands(names: tuple[str, ...], seed: int) -> JointStream:
    """Return commands of six joints that begin and end at rest and turn the wrist widely."""
    rng = np.random.default_rng([seed, 1])
    t: Array = PERIOD * np.arange(round(SECONDS / PERIOD) + 1, dtype=np.float64)
    u = np.clip(t - REST, 0.0, SECONDS - 2.0 * REST)
    x = np.clip(np.minimum(u, SECONDS - 2.0 * REST - u) / RISE, 0.0, 1.0)
    rise = x ** 3 * (10.0 - 15.0 * x + 6.0 * x ** 2)
    q: Array = np.tile(HOME, (len(t), 1))
    for joint, most in enumerate(SIZES):
        for f in rng.uniform(SLOWEST, FASTEST, 3):
            size = most * rng.uniform(0.3, 0.6) * min(1.0, 0.3 / f)
            q[:, joint] += rise * size * np.sin(2.0 * np.pi * (f * u + rng.uniform()))
    return JointStream(t, q, '', names)


def recorded(arm: ThirdParty, factors: Mapping[str, float], seed: int, *,
             motion: int | None = None) -> Recording:
    """
    Record a robot whose numbers are off, each by a part of its sigma, and some by a factor.

    Parameters
    ----------
    arm : ThirdParty
        Of six joints.
    factors : mapping of str to float
        Of parameters, times their nominal value.
    seed, motion : int
        Of noise and numbers, and of the commands: by default of all.

    Returns
    -------
    Recording
        Commands of joints, wrench and pose, with a sensor's noise and zero.
    """
    rng = np.random.default_rng([seed, 2])
    names = tuple(p.name[3:-1] for p in arm.parameters if p.name.startswith('kp['))
    joints = commands(names, seed if motion is None else motion)
    off = rng.choice([-OFF, OFF], len(arm.parameters))
    values = [max(p.low, p.nominal * factors[p.name] if p.name in factors
                  else p.nominal + x * p.sigma) for p, x in zip(arm.parameters, off)]
    made = arm.run(Inputs(0.0, SECONDS, joints=joints), values)
    wrench, pose = made.wrench, made.pose
    assert wrench is not None
    assert pose is not None
    force, torque, place, turn = (s * rng.normal(size=(len(wrench), 3)) for s in ARM_NOISE)
    return replace(
        made, joint_commands=joints,
        wrench=replace(wrench, values=wrench.values + np.hstack([force, torque]) + ZERO),
        pose=replace(pose, position=pose.position + place,
                     R_base_sensor=pose.R_base_sensor @ rotation_from_vector(turn)))
