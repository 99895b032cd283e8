"""A recording without commands, in blocks: the wrench, and the motion that it follows from."""

from itertools import pairwise

from forcecal_ros.diagnose.channels import BLOCK, CHANNELS
from forcecal_ros.diagnose.motion.known import Known
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.kinematics import PoseKinematics, smoothed
from forcecal_ros.recording.streams import Phase, Recording
from forcecal_ros.recording.time_grid import Averager, TimeGrid
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d, uniform_filter1d

SHORTEST = 3.0
"""Recording that can be diagnosed [s]."""

LARGEST_DELAY = 0.03
"""Between two sensors [s]."""

STILL = (0.005, 0.002)
"""Angular speed [rad/s] and speed [m/s] below which the robot rests."""

TOUCHED = ('approach', 'contact', 'retract')
"""Phases in which what the tool meets is not known, and which are left out."""

ACCEL = slice(6, 9)
NEAR = 25
"""Blocks around motion that count as motion."""

UP = np.array([0.0, 0.0, 1.0])

KEPT = 30
"""Delays at which the motion is remembered."""

EVERY = 10
"""Blocks from one row that is fitted to the next."""

WINDOW = np.hanning(21) / np.hanning(21).sum()
"""Weights of the blocks that a row is the mean of: half at 12.5 Hz, nothing from 25 Hz on. A tool
is rigid for slow motion only; what shakes faster would outvote it."""


class MotionCase:
    """
    One recording.

    Parameters
    ----------
    recording : Recording
        With wrench and measured pose.
    known : Known

    Attributes
    ----------
    measured : ndarray, shape (n, 16)
        Block means: wrench, and the specific force in ft_sensor at rest.
    present : ndarray of bool, shape (n, 16)
    groups : ndarray of int, shape (n,)
        0 at rest, 1 in motion.
    phases : tuple of Phase
    train, held : ndarray of bool, shape (n,)

    Raises
    ------
    DataError
        Wrench or pose are missing, or overlap for too short a time.
    """

    def __init__(self, recording: Recording, known: Known) -> None:
        wrench, pose = recording.wrench, recording.pose
        if wrench is None or pose is None or len(wrench) < 100 or len(pose) < 20:
            raise DataError('the recording holds neither commands nor wrench with measured pose; '
                            'record target_frame, or wrench and current_pose')
        self.recording, self.known = recording, known
        self._pull = self._accelerometer()
        streams = [wrench.t, pose.t]
        if self._pull is not None:
            assert recording.accelerometer is not None
            streams.append(recording.accelerometer.t)
        first = max(float(t[0]) for t in streams) + LARGEST_DELAY
        last = min(float(t[-1]) for t in streams) - LARGEST_DELAY
        if last - first < SHORTEST:
            raise DataError(f'wrench and motion overlap for {max(0.0, last - first):.1f} s; at '
                            f'least {SHORTEST:g} s are needed: record a longer motion')
        n = int((last - first) / BLOCK)
        self.starts: Array = np.asarray(first + BLOCK * np.arange(n), dtype=np.float64)
        self._motions: dict[float, tuple[Array, Array | None]] = {}
        self._pulls: dict[float, Array] = {}
        self._turning()
        self.phases = recording.phases or self._made_up()
        self._measure(Averager(wrench.t, wrench.values))
        second = np.floor(self.times - self.times[0]).astype(int)
        self.held: NDArray[np.bool_] = second % 2 == 1
        self.train: NDArray[np.bool_] = ~self.held

    @property
    def times(self) -> Array:
        """Middle of each block [s]."""
        return np.asarray(self.starts + 0.5 * BLOCK)

    def phase_rows(self) -> dict[str, NDArray[np.bool_]]:
        """Say which blocks each phase word covers."""
        t = self.times
        found: dict[str, NDArray[np.bool_]] = {}
        for phase in self.phases:
            rows = (t >= phase.start) & (t < phase.end)
            found[phase.name] = found.get(phase.name, np.zeros(len(t), dtype=bool)) | rows
        return {name: rows for name, rows in found.items() if rows.any()}

    def slow(self, rows: Array) -> Array:
        """
        Average blocks over a window, and thin them out.

        Parameters
        ----------
        rows : ndarray, shape (n, 16)

        Returns
        -------
        ndarray, shape (m, 16)
            Zero where ``present_slow`` says that blocks are missing.
        """
        wide = convolve1d(rows, WINDOW, axis=0, mode='nearest')[::EVERY]
        return np.asarray(np.where(self.present_slow, wide, 0.0))

    @property
    def accelerated(self) -> bool:
        """Whether accelerometer or position tell how the tool is accelerated."""
        return self._pull is not None or self._place is not None

    def gravity(self, delay: float, zenith: Array) -> Array:
        """
        Specific force at rest in the measured orientation.

        Parameters
        ----------
        delay : float
            Of how long ago [s].
        zenith : ndarray, shape (3,)
            Unit vector upwards, in base.

        Returns
        -------
        ndarray, shape (n, 3)
            In ft_sensor [m/s^2].
        """
        return np.asarray(self.known.gravity * (zenith @ self._at(delay)[0]))

    def force(self, delay: float) -> Array:
        """
        Specific force at the centre of mass.

        Parameters
        ----------
        delay : float
            How much later than the wrench the accelerometer shows the same instant [s].

        Returns
        -------
        ndarray, shape (n, 3)
            In ft_sensor [m/s^2].
        """
        if self._pull is None:
            f = self._at(-delay)[1]
            return self.gravity(-delay, UP) if f is None else f
        if delay not in self._pulls:
            if len(self._pulls) > KEPT:
                self._pulls.pop(next(iter(self._pulls)))
            self._pulls[delay] = self._pull.means(self.starts + delay, BLOCK) + self._lever
        return self._pulls[delay]

    def _accelerometer(self) -> Averager | None:
        stream, known = self.recording.accelerometer, self.known
        if stream is None or known.sensitivity is None or len(stream) < 100:
            return None
        if self.recording.accelerometer_unit != known.unit:
            raise DataError(f'the accelerometer speaks {self.recording.accelerometer_unit}, it '
                            f'was calibrated in {known.unit}; calibrate with this one')
        assert known.offset is not None
        f = np.linalg.solve(known.sensitivity, (stream.values - known.offset).T).T
        return Averager(stream.t, f)

    def _turning(self) -> None:
        pose, n = self.recording.pose, len(self.starts)
        assert pose is not None
        grid = TimeGrid(self.starts, BLOCK, np.full(n, -1), np.ones(n, dtype=bool))
        self._poses = PoseKinematics(pose, grid)
        turn = self._poses.angular()
        turn = turn._replace(omega=smoothed(turn.omega), alpha=smoothed(turn.alpha))
        self._place = self._poses.acceleration()
        com, place = self.known.com, self.known.place
        arm = com if self._pull is None else np.zeros(3) if place is None else com - place
        self._lever = turn.lever @ arm
        inertia = self.known.inertia
        self.spin = turn.alpha @ inertia + np.cross(turn.omega, turn.omega @ inertia)
        speed = np.linalg.norm(_mean(turn.omega), axis=1) / STILL[0]
        if self._place is not None:
            place = CubicSpline(pose.t, pose.position)(self.times)
            velocity = _mean(np.gradient(place, BLOCK, axis=0))
            speed = np.maximum(speed, np.linalg.norm(velocity, axis=1) / STILL[1])
        moving = np.convolve(speed > 1.0, np.ones(2 * NEAR + 1), 'same') > 0.5
        self.groups: NDArray[np.intp] = moving.astype(np.intp)
        self.slide = np.zeros(n)
        if self.recording.optidrive is not None and len(self.recording.optidrive) > 1:
            self.slide = self.recording.optidrive.at(self.times)[:, 0]

    def _at(self, delay: float) -> tuple[Array, Array | None]:
        """Orientation, and specific force by the position where there is no accelerometer."""
        if delay not in self._motions:
            R, f = self._poses.angular(-delay).R_base_sensor, None
            if self._pull is None and (a := self._poses.acceleration(-delay)) is not None:
                a = smoothed(a) + [0.0, 0.0, self.known.gravity]
                f = np.einsum('nji,nj->ni', R, a) + self._lever
            if len(self._motions) > KEPT:
                self._motions.pop(next(iter(self._motions)))
            self._motions[delay] = R, f
        return self._motions[delay]

    def _made_up(self) -> tuple[Phase, ...]:
        edges = [0, *(np.flatnonzero(np.diff(self.groups)) + 1).tolist(), len(self.groups)]
        times = np.append(self.starts, self.starts[-1] + BLOCK)
        return tuple(Phase(('measure', 'move')[self.groups[i]], float(times[i]), float(times[j]))
                     for i, j in pairwise(edges))

    def _measure(self, wrench: Averager) -> None:
        n = len(self.starts)
        self.measured = np.zeros((n, len(CHANNELS)))
        self.measured[:, :6] = wrench.means(self.starts, BLOCK)
        rest = self.groups == 0
        if self._pull is not None:
            self.measured[rest, ACCEL] = self.force(0.0)[rest]
        finite = np.isfinite(self.measured) & np.isfinite(self.force(0.0)).all(1)[:, np.newaxis]
        self.present = finite
        self.present[:, 9:] = False
        self.present[:, ACCEL] &= rest[:, np.newaxis] & (self._pull is not None)
        for name, rows in self.phase_rows().items():
            if name in TOUCHED:
                self.present[rows] = False
        self.measured[~self.present] = 0.0
        width = np.ones(len(WINDOW))
        missing = convolve1d((~self.present).astype(float), width, axis=0, mode='nearest')
        self.present_slow = missing[::EVERY] < 0.5


def _mean(rows: Array) -> Array:
    """Average over a tenth of a second, which derivatives of a noisy pose need."""
    return np.asarray(uniform_filter1d(rows, NEAR, axis=0, mode='nearest'))


def held_apart(train: MotionCase, held: MotionCase) -> tuple[MotionCase, MotionCase]:
    """Fit on all of one recording, judge on all of another."""
    for case, fits in ((train, True), (held, False)):
        case.train = np.full(len(case.starts), fits)
        case.held = ~case.train
    return train, held

