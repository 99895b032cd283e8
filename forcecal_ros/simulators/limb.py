"""A limb that hangs from a strain-gauge sensor and is tilted slowly: data to try ``insitu`` on."""

from collections.abc import Mapping
from typing import NamedTuple

from forcecal_ros.geometry import Array
import numpy as np

GRAVITY = 9.80665
RATE, DURATION = 100.0, 60.0
"""[Hz], [s]: a minute, as [Traversaro2014] took for each added mass."""

MASS, COM = 2.9, np.array([0.012, -0.008, 0.205])
"""Of the limb alone [kg], in the sensor's frame [m]."""

SWINGS = ((np.deg2rad(40.0), 30.0), (np.deg2rad(30.0), 23.0))
"""Amplitude [rad] and period [s] about y and about x: so slow that weight alone counts."""

NOISE = np.array([0.3, 0.3, 0.3, 0.02, 0.02, 0.02])
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
    gravity = GRAVITY * np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll),
                                  np.cos(pitch) * np.cos(roll)], axis=1)
    moment = MASS * COM + load.mass * np.array(load.position)
    wrench = np.hstack([(MASS + load.mass) * gravity, np.cross(moment, gravity)])
    matrix, offset = gauges()
    felt = wrench + NOISE * rng.standard_normal(wrench.shape)
    accel = -gravity + ACCELERATION_NOISE * rng.standard_normal(gravity.shape)
    return Log(t, felt @ matrix.T + offset, accel)
