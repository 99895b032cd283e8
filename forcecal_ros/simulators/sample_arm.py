"""Recordings of a sample robot: an arm like its model, but for what a drawing leaves open."""

from collections.abc import Mapping
from dataclasses import replace

from forcecal_ros.geometry import Array, rotation_from_vector
from forcecal_ros.recording.streams import JointStream, Recording
from forcecal_ros.simulators.protocol import Inputs
from forcecal_ros.simulators.third_party import ThirdParty
import numpy as np

SECONDS, PERIOD = 20.0, 0.008
"""Length of the motion, and between commands: 125 Hz, as many controllers are told [s]."""

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

NOISE = (0.15, 0.006, 1e-4, 2e-4)
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


def recorded(arm: ThirdParty, factors: Mapping[str, float], seed: int) -> Recording:
    """
    Record a robot whose numbers are off, each by a part of its sigma, and some by a factor.

    Parameters
    ----------
    arm : ThirdParty
        Of six joints.
    factors : mapping of str to float
        Of parameters, times their nominal value.
    seed : int

    Returns
    -------
    Recording
        Commands of joints, wrench and pose, with a sensor's noise and zero.
    """
    rng = np.random.default_rng([seed, 2])
    names = tuple(p.name[3:-1] for p in arm.parameters if p.name.startswith('kp['))
    joints = commands(names, seed)
    off = rng.choice([-OFF, OFF], len(arm.parameters))
    values = [max(p.low, p.nominal * factors[p.name] if p.name in factors
                  else p.nominal + x * p.sigma) for p, x in zip(arm.parameters, off)]
    made = arm.run(Inputs(0.0, SECONDS, joints=joints), values)
    wrench, pose = made.wrench, made.pose
    assert wrench is not None
    assert pose is not None
    force, torque, place, turn = (s * rng.normal(size=(len(wrench), 3)) for s in NOISE)
    return replace(
        made, joint_commands=joints,
        wrench=replace(wrench, values=wrench.values + np.hstack([force, torque]) + ZERO),
        pose=replace(pose, position=pose.position + place,
                     R_base_sensor=pose.R_base_sensor @ rotation_from_vector(turn)))
