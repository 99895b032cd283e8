"""A real arm's motion (KUKA LBR Med), on whose measured wrench effects and backgrounds are laid.

The arm has departures of its own, which stay: a delay between its two sensors, an offset, and
what else a calibration from static poses does not know. Its noise is that by which neighbouring
samples differ; offset, mass and moment are the nuisances.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
import os
from pathlib import Path

from background_kinds import Motion
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.geometry import Array, rotation_from_vector, rotation_vector
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.effects import with_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation, RotationSpline
from signal_effects import apply_signal_effects

GRAVITY = 9.8209
"""Of the recordings [m/s^2]."""

DATA = Path(os.environ.get(
    'FORCECAL_DATA', Path(__file__).resolve().parents[2] / 'shared' / 'data')) / 'kuka_lbr_med'

EFFECTS_ON_IT = ('wrench_delay', 'wrench_lowpass', 'wrench_bias_drift', 'wrench_gain',
                 'wrench_crosstalk', 'wrench_hysteresis', 'wrench_saturation', 'base_tilt')

SLOW = 12.0
"""Up to which the wrench is the motion's, not vibration [Hz]."""

NUISANCES = (1.0, 0.1, 0.02)
"""One spread of offsets of force and torque [N], [N m], and of mass and moment, relative."""


@dataclass
class Arm:
    """
    The recording, and what counts beside its noise.

    Attributes
    ----------
    clean : Recording
        As it was recorded.
    calibration : Calibration
        From static poses.
    rig : Rig
        A rig whose sensor has the calibrated offset, for the effects on signals.
    motion : Motion
        On the wrench's stamps.
    """

    clean: Recording
    calibration: Calibration
    rig: Rig
    motion: Motion
    _columns: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self._noise = np.diff(self.clean.wrench.values, axis=0).std(axis=0) / np.sqrt(2.0)
        weight = self._weight(self.motion.up)
        torques = np.cross(np.eye(3)[:, None], weight[:, :3]) * np.linalg.norm(self.motion.com)
        columns = [np.tile(row, (len(weight), 1)) for row in np.diag(
            np.repeat(NUISANCES[:2], 3))]
        columns += [NUISANCES[2] * weight]
        columns += [NUISANCES[2] * np.hstack([np.zeros_like(one), one]) for one in torques]
        self._columns = np.array([self.whitened(c) for c in columns])

    def _weight(self, up: Array) -> Array:
        force = -self.motion.mass * GRAVITY * up
        return np.hstack([force, np.cross(self.motion.com, force)])

    def whitened(self, departure: Array) -> Array:
        """Return a departure of the wrench over the noise, in one row."""
        return (departure / self._noise).ravel()

    def net(self, departure: Array, without: str | None = None) -> float:
        """Return the energy of a departure of the wrench that the nuisances cannot take up."""
        d, columns = self.whitened(departure), self._columns
        product = columns @ d
        return float(d @ d - product @ np.linalg.solve(
            columns @ columns.T + np.eye(len(columns)), product))

    def departure(self, values: Mapping[str, Mapping[str, float]]) -> Array:
        """Return what effects change of the wrench, (n, 6)."""
        zero = np.zeros_like(self.clean.wrench.values)
        return self.recorded(values, zero).wrench.values - self.clean.wrench.values

    def recorded(self, effects: Mapping[str, Mapping[str, float]], added: Array) -> Recording:
        """Lay something added, then effects, on the measured wrench."""
        wrench = self.clean.wrench
        tilt = effects.get('base_tilt')
        values = wrench.values + added
        if tilt:
            zenith = rotation_from_vector(np.array([tilt.get('x', 0.0), tilt.get('y', 0.0), 0.0]))
            up = zenith[:, 2] @ self.motion.R_base_sensor
            values = values + self._weight(up) - self._weight(self.motion.up)
        on_signals = {n: v for n, v in effects.items() if n != 'base_tilt'}
        out = Recording(wrench=Stream(wrench.t, values, wrench.frame))
        if on_signals:
            out = apply_signal_effects(out, with_effects(self.rig, on_signals))
        return replace(self.clean, wrench=out.wrench)


def there() -> bool:
    """Say whether the recordings are there."""
    return DATA.is_dir()


def _table(name: str) -> Array:
    rows = np.genfromtxt(DATA / f'{name}.csv', delimiter=',', skip_header=1)
    return np.asarray(rows)


def _calibrated() -> Calibration:
    """Calibrate from the static poses, one sample each."""
    rows = _table('0-calibration_fts-accel')
    t = np.arange(len(rows), dtype=float)
    pose = PoseStream(t, np.full((len(t), 3), np.nan), rows[:, 12:].reshape(-1, 3, 3))
    return identify(Recording(
        wrench=Stream(t, rows[:, :6]), accelerometer=Stream(t, rows[:, 6:9] * GRAVITY),
        accelerometer_unit='m/s^2', pose=pose,
        phases=tuple(Phase('measure', x - 0.1, x + 0.1) for x in t)),
        IdentificationSettings(gravity=GRAVITY))


def _baseline() -> Recording:
    """Read the free trajectory; stamps that do not increase are left out."""
    parts = [_table(f'1-baseline_{kind}') for kind in ('wrench', 'accel', 'orientations')]
    start = parts[0][0, 0]
    parts = [p[np.r_[True, np.diff(p[:, 0]) > 0.0]] for p in parts]
    (at, wrench), (later, accel), (when, R) = (((p[:, 0] - start) * 1e-6, p[:, 1:])
                                               for p in parts)
    return Recording(
        wrench=Stream(at, wrench, 'ft_sensor'), accelerometer_unit='m/s^2',
        accelerometer=Stream(later, accel * GRAVITY, 'accelerometer'),
        pose=PoseStream(when, np.full((len(when), 3), np.nan), R.reshape(-1, 3, 3)))


@lru_cache(maxsize=1)
def arm() -> Arm:
    """Read and calibrate the arm."""
    recording, known = _baseline(), _calibrated()
    t, pose, bias = recording.wrench.t, recording.pose, known.wrench_bias.value
    dt = 1.0 / recording.wrench.rate
    turning = RotationSpline(pose.t, Rotation.from_matrix(np.array(pose.R_base_sensor)))
    R = turning(np.clip(t, pose.t[0], pose.t[-1])).as_matrix()
    low = butter(2, SLOW, fs=1.0 / dt, output='sos')
    felt = sosfiltfilt(low, recording.wrench.values - bias, axis=0)
    omega = np.zeros((len(t), 3))
    omega[1:-1] = rotation_vector(np.swapaxes(R[:-2], 1, 2) @ R[2:]) / (2.0 * dt)
    omega = sosfiltfilt(low, omega, axis=0)
    still = np.zeros((len(t), 3))
    motion = Motion(t - t[0], R, still, still, still, omega, np.gradient(omega, dt, axis=0),
                    -felt[:, :3] / float(known.mass), felt, np.zeros((len(t), 6)),
                    float(known.mass), np.array(known.com.value), 0)
    rig = load_rig()
    rig = replace(rig, wrench_sensor=replace(rig.wrench_sensor, bias=tuple(bias)))
    return Arm(recording, known, rig, motion)
