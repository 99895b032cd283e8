"""Payloads and pushes laid onto recordings of tools that touch nothing, with forces of their own.

A payload of mass m at p puts -m f_p on the wire, f_p the specific force there; a push is any
wrench that does not follow from that.
"""

from dataclasses import replace

from forcecal_ros.core.streams import Stream
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import gravity_arm as arm
import numpy as np
from rig_recordings import commands, switched

POINT = np.array([0.02, 0.0, 0.12])
"""Where the arm takes its payload, and where it is pushed, in S [m]."""


def after(t, start, seconds=0.1):
    """Rise from 0 to 1 within ``seconds`` from ``start`` on, as a gripper lifts, shape (n, 1)."""
    return np.clip((t - start) / seconds, 0.0, 1.0)[:, np.newaxis]


def at_point(force, point=POINT):
    """Return the wrench (n, 6) of a force at a point of the tool."""
    return np.hstack([force, np.cross(point, force)])


def weight(moving, mass, start=0.0, point=POINT):
    """Return the wrench of a payload that the arm takes up at ``start`` [s]."""
    return at_point(-mass * arm.specific_force(moving, point) * after(moving.t, start), point)


def in_base(moving, force):
    """Return a force (3,) or (n, 3) that is given in base in the axes of S."""
    return np.einsum('nji,nj->ni', moving.R_base_sensor, np.broadcast_to(
        force, (len(moving.t), 3)))


def hand(moving, rng, size):
    """Return the force of a hand that leads the arm: three sines below 1 Hz, in base."""
    f, phase = rng.uniform(0.1, 1.0, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    waves = np.sin(2 * np.pi * moving.t[:, None, None] * f + phase).sum(axis=1)
    return in_base(moving, size / 1.5 * waves)


PUSHES = {
    'none': lambda moving, rng, size: np.zeros((len(moving.t), 3)),
    'steady, turns with the sensor': lambda moving, rng, size: np.tile(
        size * np.array([0.6, -0.5, 0.62]), (len(moving.t), 1)),
    'steady, horizontal': lambda moving, rng, size: in_base(moving, [0.8 * size, -0.6 * size, 0]),
    'steady, slanting': lambda moving, rng, size: in_base(moving, [0.7 * size, 0, -0.7 * size]),
    'steady, straight down': lambda moving, rng, size: in_base(moving, [0, 0, -size]),
    'hand-guided': hand,
}


TURNS = tuple(('move', 2.0, (0.0, y, 0.0), turn) for y, turn in (
    (0.05, (0.5, 0.3, 0.0)), (-0.05, (-0.4, 0.4, 0.3)), (0.05, (0.3, -0.5, -0.2)),
    (0.0, (-0.5, -0.2, 0.4)), (0.05, (0.4, 0.5, 0.1)), (-0.05, (-0.3, -0.4, 0.0)),
    (0.0, (0.0, 0.0, 0.0)), (0.05, (0.5, 0.0, 0.3))))
"""Of the rig, 16 s: tilts of up to 35 deg, one every two seconds, and 5 cm to and fro."""


def on_the_rig(load, start=4.0, seed=5, parts=TURNS):
    """Simulate the rig twice over one motion, and go over to the heavier tool at ``start`` [s]."""
    target, _ = commands(parts)
    rig = load_rig()
    point = np.array([0.1, 0.02, 0.12])
    mass = rig.tool.mass + load
    com = (rig.tool.mass * np.array(rig.tool.com) + load * point) / mass
    heavier = replace(rig, tool=replace(rig.tool, mass=mass, com=tuple(com.tolist())))
    one, other = (simulate(each, target, seed=seed) for each in (rig, heavier))
    return switched(one, other, start), mass, com


def laid_on(recording, calibration, mass, point, start):
    """Lay a payload onto a real recording, by what its own accelerometer shows."""
    sensor, t = calibration.accelerometer, recording.wrench.t
    f = ((recording.accelerometer.values - sensor.offset.value)
         @ np.linalg.inv(sensor.matrix).T)
    felt = np.column_stack([np.interp(t, recording.accelerometer.t - float(sensor.delay), column)
                            for column in f.T])
    wrench = at_point(-mass * felt * (t >= start)[:, np.newaxis], np.array(point))
    return replace(recording, wrench=Stream(t, recording.wrench.values + wrench))
