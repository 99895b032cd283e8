"""A rig that stands for a robot, and a simulator of its tool by other code."""

from dataclasses import replace
from functools import cache

from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.diagnose.sources.pair import shift_times
from forcecal_ros.effects import with_effects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

TOLERANCES = load_rig('rigid_tool.yaml')
GRIPPER = replace(TOLERANCES.tool, mass=1.2, com=(0.01, -0.005, 0.06),
                  inertia=((3e-3, 0.0, 0.0), (0.0, 3e-3, 0.0), (0.0, 0.0, 1e-3)))
RIG = replace(TOLERANCES, tool=GRIPPER)
LATE = {'robot_delay': {'delay': 0.008}}
SECONDS = 12.0


@cache
def commands(phase=0.0, seconds=SECONDS):
    t = 0.004 * np.arange(round(seconds / 0.004))
    u = np.clip(t - 1.5, 0.0, seconds - 4.0)
    rise = np.minimum(1.0, np.minimum(u, seconds - 4.0 - u)).clip(0.0)
    rise = rise ** 3 * (10.0 - 15.0 * rise + 6.0 * rise ** 2)
    turn = np.outer(0.8 * rise * np.sin(u * np.pi / 2.0 + phase), [0.5, 1.0, 0.3])
    turn += np.outer(0.5 * rise * np.sin(1.1 * u + phase), [1.0, -0.2, 0.3])
    sway = np.outer(0.02 * rise * np.sin(3.0 * np.pi * u + phase), [1.0, 0.5, 0.7])
    return PoseStream(t, np.array(RIG.home.position) + sway,
                      np.array(RIG.home.R_base_sensor) @ Rotation.from_rotvec(turn).as_matrix())


def real(effects, seed=3, phase=0.0):
    return simulate(with_effects(RIG, {**LATE, **effects}), commands(phase), seed=seed)


def with_imu(recording, bias=0.0):
    """Turn volts into what an Imu says."""
    model, stream = RIG.accelerometer.acc1, recording.accelerometer
    felt = (stream.values - model.offset) / model.gain
    return replace(recording, accelerometer_unit='m/s^2',
                   accelerometer=replace(stream, values=felt + [bias, 0.0, 0.0]))


@cache
def simulated(phase=0.0, start=1000.0, imu=False):
    """
    Return what a simulator of the test's own records, without noise, at 500 Hz on its own clock.

    Its arm follows the commands 6 ms late; its wrench is [F; n] of a rigid body by Newton and
    Euler, differentiated by splines.
    """
    target = commands(phase)
    t = np.arange(0.1, SECONDS - 0.1, 0.002)
    place = CubicSpline(target.t, target.position)
    way = RotationSpline(target.t, Rotation.from_matrix(np.array(target.R_base_sensor)))
    at = t - 0.006
    R, p = way(at).as_matrix(), place(at)
    omega, alpha = way(at, 1), way(at, 2)  # in S
    c, inertia = np.array(GRIPPER.com), np.array(GRIPPER.inertia)
    f = np.einsum('nij,ni->nj', R, place(at, 2) - RIG.gravity)
    f += np.cross(alpha, c) + np.cross(omega, np.cross(omega, c))
    force = -GRIPPER.mass * f
    torque = np.cross(c, force) - alpha @ inertia - np.cross(omega, omega @ inertia)
    a = np.array(RIG.accelerometer.position) - c
    felt = f + np.cross(alpha, a) + np.cross(omega, np.cross(omega, a))
    recording = Recording(
        wrench=Stream(t, np.hstack([force, torque])), pose=PoseStream(t, p, R), target=target,
        accelerometer=Stream(t, felt) if imu else None, accelerometer_unit='m/s^2')
    return shift_times(recording, start)
