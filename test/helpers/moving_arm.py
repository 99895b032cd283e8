"""A small arm that never rests: multi-sine about three axes, with the noise of a UR-like robot."""

from functools import cache
from typing import NamedTuple

from forcecal_ros.core.geometry import quaternion_from_matrix, rotation_from_vector
import numpy as np
from scipy.spatial.transform import Rotation
from wrong_recordings import EPOCH, load, Log, Motion

MASS, COM = 0.95, np.array([0.012, -0.006, 0.065])
BIAS = np.array([2.0, -3.0, 5.0, 0.1, -0.15, 0.05])
SECONDS, RATE, POSE_RATE = 38.0, 500.0, 125.0


class Sines(NamedTuple):
    """Angles and places of sums of sines, by amplitude, frequency [Hz] and phase, (6, k) each."""

    size: np.ndarray
    hertz: np.ndarray
    phase: np.ndarray

    def at(self, t):
        """Return the motion; its rotation is derived by differences over 0.1 ms."""
        h = 1e-4
        R0, R, R1 = (self._turned(t + dt) for dt in (-h, 0.0, h))
        before, after = (_rate(R0, R) / h, _rate(R, R1) / h)
        omega, alpha = (before + after) / 2.0, (after - before) / h
        place, acceleration = (self._sum(t, k)[:, 3:] for k in (0, 2))
        return Motion(place + [0.4, 0.1, 0.5], R, acceleration, omega, alpha)

    def _sum(self, t, order):
        w = 2.0 * np.pi * self.hertz
        angle = w[:, :, None] * t + self.phase[:, :, None] + order * np.pi / 2.0
        return (self.size[:, :, None] * w[:, :, None]**order * np.sin(angle)).sum(axis=1).T

    def _turned(self, t):
        return (Rotation.from_euler('x', np.pi) * Rotation.from_euler(
            'xyz', self._sum(t, 0)[:, :3])).as_matrix()


def _rate(R, R_next):
    S = np.swapaxes(R, 1, 2) @ R_next
    return np.stack([S[:, 2, 1] - S[:, 1, 2], S[:, 0, 2] - S[:, 2, 0],
                     S[:, 1, 0] - S[:, 0, 1]], axis=1) / 2.0


def moving(seed, mass=MASS, com=COM, seconds=SECONDS, rate=RATE, turns=1.0):
    """Record the arm without contact, as a Log that can be spoilt; `turns` scales rotations."""
    return _recorded(seed, mass, tuple(com), seconds, rate, turns)


@cache
def _recorded(seed, mass, com, seconds, rate, turns):
    rng = np.random.default_rng(seed)
    hertz = rng.uniform(0.08, 0.6, (6, 3))
    size = np.concatenate([turns * rng.uniform(0.2, 0.45, (3, 3)),
                           rng.uniform(0.02, 0.08, (3, 3))])
    way = Sines(size, hertz, rng.uniform(0.0, 2.0 * np.pi, (6, 3)))
    t, pose_t = np.arange(0.0, seconds, 1 / rate), np.arange(0.003, seconds, 1 / POSE_RATE)
    motion, seen = way.at(t), way.at(pose_t)
    noise = np.repeat([0.08, 0.004], 3)
    wrench = load(motion, mass, com) + BIAS + noise * rng.standard_normal((len(t), 6))
    wobble = rotation_from_vector(2e-4 * rng.standard_normal((len(pose_t), 3)))
    place = seen.place + 1e-4 * rng.standard_normal((len(pose_t), 3))
    stamps = [EPOCH + np.rint(x * 1e9).astype(np.int64) for x in (t, pose_t)]
    return Log(t, wrench, np.zeros((len(t), 6)), np.full(len(t), 'ft_sensor'), pose_t, place,
               quaternion_from_matrix(seen.R @ wobble), *stamps)
