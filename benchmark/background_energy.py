"""How much a departure of a rig's signals matters: its energy, net of what nuisances take up.

Energies are whitened: squares of a departure over the variance of the true white noise, summed
over the samples of the held-out recording. What the nuisances, within one spread each, could take
up is projected out by columns in closed form: of the wrench and accelerometer gains, biases, mass,
centre of mass and inertia; of slide and wall their static part.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import background_kinds
from background_kinds import Motion
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from signal_effects import apply_signal_effects

NOISE = 1.5
"""Noise of the recordings, in that of the rig's file."""

STEPS = 8
"""Integration steps in 4 ms: right to an energy of 1e-4."""


class Rates(NamedTuple):
    """Every how many samples of 1 kHz each stream has one."""

    wrench: int = 1
    accelerometer: int = 1
    optidrive: int = 1
    pose: int = 4


GROUPS = (('wrench', slice(0, 6)), ('accelerometer', slice(6, 9)), ('optidrive', slice(9, 10)),
          ('pose', slice(10, 16)))
"""Columns of each stream: wrench, volts, slide, position, rotation vector in S."""


def sampled(rig: Rig) -> Rig:
    """Let every sensor take a thousand samples a second."""
    def often(part: Any) -> Any:
        return part and replace(part, rate=1000.0)
    return replace(rig, wrench_sensor=often(rig.wrench_sensor), optidrive=often(rig.optidrive),
                   accelerometer=often(rig.accelerometer), pose_sensor=often(rig.pose_sensor))


def clean_recording(rig: Rig, target: PoseStream) -> Recording:
    return simulate(rig, target, noise=False, steps=STEPS)


def departure_of(one: Recording, other: Recording) -> Array:
    """Return how two recordings of 1 kHz differ, (n, 16)."""
    out = np.zeros((len(one.wrench), 16))
    out[:, :6] = one.wrench.values - other.wrench.values
    out[:, 6:9] = one.accelerometer.values - other.accelerometer.values
    if one.optidrive is not None:
        out[:, 9:10] = one.optidrive.values - other.optidrive.values
    out[:, 10:13] = one.pose.position - other.pose.position
    if not np.array_equal(one.pose.R_base_sensor, other.pose.R_base_sensor):
        out[:, 13:] = rotation_vector(np.swapaxes(other.pose.R_base_sensor, 1, 2)
                                      @ one.pose.R_base_sensor)
    return out


def noise_of(rig: Rig) -> Array:
    """Return the noise of every column, shape (16,)."""
    pose = rig.pose_sensor
    slide = rig.optidrive.noise if rig.optidrive else np.inf
    return NOISE * np.array(
        [rig.wrench_sensor.force_noise] * 3 + [rig.wrench_sensor.torque_noise] * 3
        + [rig.accelerometer.noise] * 3 + [slide] + [pose.position_noise] * 3
        + [pose.orientation_noise] * 3)


def motion_of(rig: Rig, clean: Recording, index: int) -> Motion:
    """
    Say how a rig's sensor moves and what it feels.

    Parameters
    ----------
    rig : Rig
    clean : Recording
        Of 1 kHz, without noise.
    index : int
        Of the recording in its case.
    """
    t, R = clean.wrench.t, clean.pose.R_base_sensor
    dt = float(np.median(np.diff(t)))
    velocity = np.gradient(clean.pose.position, dt, axis=0)
    acceleration = np.gradient(velocity, dt, axis=0)
    omega = np.zeros_like(velocity)
    omega[1:-1] = rotation_vector(np.swapaxes(R[:-2], 1, 2) @ R[2:]) / (2.0 * dt)
    force = np.einsum('nji,nj->ni', R, acceleration - np.array(rig.gravity))
    return Motion(t - t[0], R, clean.pose.position, velocity, acceleration, omega,
                  np.gradient(omega, dt, axis=0), force,
                  clean.wrench.values - rig.wrench_sensor.bias, clean.contact_truth.values,
                  rig.tool.mass, np.array(rig.tool.com), index)


def _nuisance_columns(rig: Rig, clean: Recording, m: Motion) -> tuple[Array, tuple[str, ...]]:
    """Return what one spread of each nuisance adds, (k, n, 16), and the keys of the spreads."""
    s, found, keys = rig.spreads, [], []

    def add(key: str, start: int, values: Array) -> None:
        column = np.zeros((len(m.t), 16))
        column[:, start:start + values.shape[1]] = values
        found.append(column)
        keys.append(key)

    own = m.wrench - m.contact
    add('mass', 0, s.mass * own)
    for i, axis in enumerate(np.eye(3)):
        add('com', 3, s.com * np.cross(axis, own[:, :3]))
        spin = rig.tool.inertia[i][i] * m.omega[:, i:i + 1] * axis
        turned = rig.tool.inertia[i][i] * m.alpha[:, i:i + 1] * axis
        add('inertia', 3, -s.inertia * (turned + np.cross(m.omega, spin)))
    volts = clean.accelerometer.values - rig.accelerometer.model().offset
    for i in range(6):
        add('force_bias' if i < 3 else 'torque_bias', i,
            np.full((len(m.t), 1), s.force_bias if i < 3 else s.torque_bias))
        add('wrench_gain', i, s.wrench_gain * m.wrench[:, i:i + 1])
    for i in range(3):
        add('accelerometer_gain', 6 + i, s.accelerometer_gain * volts[:, i:i + 1])
        add('accelerometer_offset', 6 + i, np.full((len(m.t), 1), s.accelerometer_offset))
    if rig.optidrive:
        add('stiffness', 9, s.stiffness * clean.optidrive.values)
    if m.contact.any():
        yielding = rig.optidrive.stiffness if rig.optidrive else np.inf
        share = 1.0 / (1.0 + rig.wall.stiffness / yielding)
        pushed = np.linalg.norm(m.contact[:, :3], axis=1, keepdims=True)
        add('wall_stiffness', 0, s.wall_stiffness * share * m.contact)
        series = rig.wall.stiffness * share if share < 1.0 else rig.wall.stiffness
        add('wall_position', 0, s.wall_position * series * m.contact / np.maximum(pushed, 1.0))
    return np.array(found), tuple(keys)


# energies

@dataclass
class Ground:
    """
    The held-out recording of the nominal rig, and what counts beside its noise.

    Attributes
    ----------
    rig : Rig
    target : PoseStream
    clean : Recording
    motion : Motion
    rates : Rates
    """

    rig: Rig
    target: PoseStream
    clean: Recording
    motion: Motion
    rates: Rates
    _columns: Array = field(default_factory=lambda: np.zeros(0))
    _keys: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        columns, self._keys = _nuisance_columns(self.rig, self.clean, self.motion)
        self._columns = np.array([self.whitened(c) for c in columns])
        self._gram = self._columns @ self._columns.T + np.eye(len(self._columns))

    def nuisances(self, without: str | None = None) -> Array:
        """Return orthonormal rows that span the nuisances' whitened columns, but for one key."""
        kept = [key != without for key in self._keys]
        return np.asarray(np.linalg.qr(self._columns[kept].T)[0].T)

    def whitened(self, departure: Array) -> Array:
        """Return what of a departure (n, 16) is sampled, over the noise, in one row."""
        parts = departure / noise_of(self.rig)
        return np.concatenate([parts[every - 1::every, columns].ravel() for every, (_, columns)
                               in zip(self.rates, GROUPS)])

    def net(self, departure: Array, without: str | None = None) -> float:
        """
        Return the energy of a departure that the nuisances cannot take up.

        Parameters
        ----------
        departure : ndarray, shape (n, 16)
        without : str, optional
            Key of a nuisance that is left out.
        """
        d = self.whitened(departure)
        product = self._columns @ d
        rows = np.array([key != without for key in self._keys])
        product, gram = product[rows], self._gram[np.ix_(rows, rows)]
        return float(d @ d - product @ np.linalg.solve(gram, product))

    def departure(self, values: Mapping[str, Mapping[str, float]]) -> Array:
        """Return what effects change, (n, 16)."""
        rig = with_effects(self.rig, values)
        if all(EFFECTS[name].where == 'signal' for name in values):
            return departure_of(apply_signal_effects(self.clean, rig), self.clean)
        return departure_of(clean_recording(rig, self.target), self.clean)


def additions(rig: Rig, law: background_kinds.Law, m: Motion) -> Array:
    """Return what a law adds to the signals of a recording, (n, 16)."""
    added = law(m)
    out = np.zeros((len(added), 16))
    out[:, :6] = added[:, background_kinds.WRENCH]
    out[:, 6:9] = added[:, background_kinds.ACCEL] * rig.accelerometer.model().gain
    out[:, 10:13] = added[:, background_kinds.POSITION]
    out[:, 13:] = added[:, background_kinds.TURN]
    return out
