"""
Smooth motion about one pose that a calibration is estimated from: a multi-sine in all six axes.

Every axis has frequencies of its own, whole periods of them in the motion, so that the axes are
uncorrelated. An envelope leads from rest to rest, back to the start. Rotations move gravity
through the sensor (mass, centre of mass, biases); translations excite the accelerometer along the
vertical.
"""

from dataclasses import dataclass
from functools import cached_property

from forcecal_ros.core.errors import MotionError
from forcecal_ros.core.geometry import Array, rotation_from_vector, skew
from forcecal_ros.motion.limits import (
    check_rates,
    check_workspace,
    Limits,
    MARGIN,
    pace_within,
    rate_limits,
)
from forcecal_ros.motion.profiles import Pace, Pose, quintic, Setpoint, stop_time
import numpy as np

DURATION_S = 10.0
"""Length of the motion: two periods of the slowest sine."""

TRANSLATION_HZ = np.array([[0.8, 1.7], [0.9, 1.9], [1.1, 2.1]])
"""By axis of base. Whole periods in ``DURATION_S``, above the rotations, below what robots follow
with some degrees of lag."""

ROTATION_HZ = np.array([[0.2, 0.5], [0.3, 0.7], [0.4, 0.6]])
"""By axis of ft_sensor. Whole periods, slow: their amplitude counts, not their speed."""

MIN_ROTATION_RAD = 0.1
"""Least peak rotation: gravity in the sensor then changes by 1 m/s^2. Of 0.05 N/sqrt(Hz) 10 s
leave 16 mN: 0.1 % of the change by a tool of 13 kg."""

GRID_S = 0.002
"""Spacing at which limits are checked: 240 points in a period of the fastest sine."""

PHASES = np.pi * np.arange(12.0).reshape(6, 2) ** 2 / 12.0
"""Of every sine: quadratic (Schroeder), so that the peaks of the sum stay low."""


@dataclass(frozen=True)
class MultiSine:
    """
    From one pose and back to it, in ``DURATION_S``.

    Attributes
    ----------
    start : Pose
    translation, rotation : float
        Factors of the amplitudes, 0.03 m and 0.35 rad.
    """

    start: Pose
    translation: float = 1.0
    rotation: float = 1.0
    duration: float = DURATION_S

    @property
    def goal(self) -> Pose:
        """Where it ends."""
        return self.start

    def offsets(self, t: Array) -> tuple[Array, Array]:
        """
        Return six offsets and their rates at times (n,) [s].

        Returns
        -------
        tuple of ndarray, shapes (n, 6)
            Translation in base [m] and rotation vector from the start in ft_sensor [rad]; [1/s].
        """
        # rise and fall of the envelope, as slow as the fastest rotation's period
        ramp = 1.5
        x = np.clip(t, 0.0, self.duration)
        inside = (x > 0.0) & (x < self.duration)
        rise, rising, _ = quintic(x / ramp)
        fall, falling, _ = quintic((self.duration - x) / ramp)
        envelope = rise * fall
        slope = np.where(inside, (rising * fall - rise * falling) / ramp, 0.0)
        # translation: largest amplitude of a slow sine; the fast one of its axis has a quarter,
        # for about the same acceleration
        # rotation: largest amplitude of a slow sine: gravity along an axis then changes by a
        # third
        size = np.repeat([self.translation * 0.03, self.rotation * 0.35], 3)
        amplitude = size[:, None] * [1.0, 0.25]
        omega = 2 * np.pi * np.vstack([TRANSLATION_HZ, ROTATION_HZ])
        angle = omega * x[:, None, None] + PHASES
        wave = (amplitude * np.sin(angle)).sum(axis=2)
        change = (amplitude * omega * np.cos(angle)).sum(axis=2)
        return (envelope[:, None] * wave,
                envelope[:, None] * change + slope[:, None] * wave)

    def at(self, t: float, time_scale: float = 1.0) -> Setpoint:
        """
        Return the setpoint at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        time_scale : float
            Rate of the path's time, below 1 while stopping.
        """
        if not 0.0 < t < self.duration:
            return Setpoint(self.start, np.zeros(3), np.zeros(3))
        (offset,), (rate,) = self.offsets(np.array([t]))
        R = self.start.R_base_sensor @ rotation_from_vector(offset[3:])
        turning = R @ _right_jacobian(offset[3:]) @ rate[3:]
        return Setpoint(Pose(self.start.position + offset[:3], R), time_scale * rate[:3],
                        time_scale * turning)

    def poses(self, n: int = 1001) -> tuple[Array, Array]:
        """Return ``n`` poses along the path, ends included: (n, 3) [m] and (n, 3, 3)."""
        offset, _ = self.offsets(np.linspace(0.0, self.duration, n))
        return (self.start.position + offset[:, :3],
                self.start.R_base_sensor @ rotation_from_vector(offset[:, 3:]))

    @cached_property
    def _rates(self) -> tuple[Array, Array]:
        """Velocity in base and angular velocity in ft_sensor on the grid, each (n, 3)."""
        t = np.arange(0.0, self.duration + GRID_S / 2, GRID_S)
        offset, rate = self.offsets(t)
        return rate[:, :3], np.array([
            _right_jacobian(r) @ dr for r, dr in zip(offset[:, 3:], rate[:, 3:])])

    @cached_property
    def distance(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(self._rates[0], axis=1).sum() * GRID_S)

    @cached_property
    def angle(self) -> float:
        """Length of the path of orientations [rad]."""
        return float(np.linalg.norm(self._rates[1], axis=1).sum() * GRID_S)

    @property
    def peak_speeds(self) -> tuple[float, float]:
        """Largest speed [m/s] and angular speed [rad/s]."""
        velocity, turning = (float(np.linalg.norm(x, axis=1).max()) for x in self._rates)
        return velocity, turning

    def peak_acceleration_at(self, lever: float) -> float:
        """Return a bound on the acceleration of a point ``lever`` [m] from the origin [m/s^2]."""
        velocity, turning = self._rates
        a, alpha = (np.linalg.norm(np.gradient(x, GRID_S, axis=0), axis=1)
                    for x in (velocity, turning))
        spin = np.linalg.norm(turning, axis=1)
        return float((a + lever * np.hypot(alpha, spin**2)).max())

    def peaks(self, stop_duration: float | None = None) -> tuple[float, ...]:
        """
        Return the peak rates.

        Parameters
        ----------
        stop_duration : float, optional
            Of a stop that may begin at any instant [s]; by default there is none.

        Returns
        -------
        tuple of float
            Speed, acceleration, jerk [m/s, m/s^2, m/s^3], and the same of the rotation [rad].
        """
        return tuple(peak for rate in self._rates for peak in _peaks(rate, stop_duration))


def _peaks(velocity: Array, stop_duration: float | None) -> tuple[float, float, float]:
    """Peak speed, acceleration and jerk of a path by its velocity (n, 3) on the grid."""
    change = np.gradient(velocity, GRID_S, axis=0)
    bend = np.gradient(change, GRID_S, axis=0)
    speed, acceleration, jerk = (float(np.linalg.norm(x, axis=1).max())
                                 for x in (velocity, change, bend))
    if stop_duration is None:
        return speed, acceleration, jerk
    phase = np.linspace(0.0, 1.0, 21)
    for elapsed, du, ddu, dddu in zip(*stop_time(phase), 12 * phase - 6):
        i = np.minimum(np.arange(len(velocity)) + round(elapsed * stop_duration / GRID_S),
                       len(velocity) - 1)
        v, a, j = velocity[i] / stop_duration, change[i], bend[i]
        stopping = np.linalg.norm(a * du**2 + v * ddu, axis=1)
        jolt = np.linalg.norm(
            j * du**3 + (3 * a * du * ddu + v * dddu) / stop_duration, axis=1)
        acceleration, jerk = max(acceleration, stopping.max()), max(jerk, jolt.max())
    return speed, float(acceleration), float(jerk)


def _right_jacobian(r: Array) -> Array:
    """Return the matrix that takes the rate of a rotation vector (3,) to the body's turning."""
    angle = float(np.linalg.norm(r))
    if angle < 1e-6:
        return np.asarray(np.eye(3) - skew(r) / 2)
    K = skew(r)
    return np.asarray(np.eye(3) - (1 - np.cos(angle)) / angle**2 * K
                      + (angle - np.sin(angle)) / angle**3 * K @ K)


def fit_multi_sine(start: Pose, pace: Pace, limits: Limits) -> MultiSine:
    """
    Return the largest multi-sine about a pose that keeps pace, limits and workspace.

    Raises
    ------
    MotionError
        The room about the pose leaves too little rotation; with the number that is needed.
    """
    within, whole = pace_within(limits, pace), MultiSine(start)
    v, a, _, w, alpha, _ = whole.peaks()
    stopping = whole.peaks(limits.stop_duration)
    shares = [MARGIN * limit / peak for limit, peak in zip(rate_limits(limits), stopping)]
    # rotations do not quite add up, so that a margin is kept twice
    move = MultiSine(
        start, min(1.0, within.speed / v, within.acceleration / a, *shares[:3]),
        min(1.0, MARGIN * min(within.angular_speed / w, within.angular_acceleration / alpha,
                              *shares[3:])))
    peak = float(np.linalg.norm(move.offsets(np.arange(0.0, DURATION_S, GRID_S))[0][:, 3:],
                                axis=1).max())
    size = 1.0
    while True:
        fitted = MultiSine(start, size * move.translation, size * move.rotation)
        try:
            check_multi_sine(fitted, limits)
        except MotionError as error:
            # factor between two sizes that are tried within the workspace
            size *= 0.95
            if size * peak < MIN_ROTATION_RAD:
                raise MotionError(
                    f'{error}; the limits leave less than {np.degrees(MIN_ROTATION_RAD):.0f} deg '
                    'of rotation, too little for a calibration') from error
            continue
        return fitted


def check_multi_sine(move: MultiSine, limits: Limits) -> None:
    """
    Refuse a multi-sine that would exceed a limit, a stop at any instant of it included.

    Raises
    ------
    MotionError
        With the number, the limit and its key.
    """
    positions, rotations = move.poses()
    check_workspace(positions, limits, 'the continuous motion: the sensor')
    check_workspace(positions + rotations @ limits.tip, limits, 'the continuous motion: the tip')
    check_rates(move.peaks(limits.stop_duration), limits, 'the continuous motion')
