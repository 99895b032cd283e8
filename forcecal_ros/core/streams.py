"""Recorded or live signals as arrays: what bags and topics become before anything is computed.

Time comes first: streams are sorted by header stamp and counted in seconds from
``Recording.start_ns``, so that a float keeps well below a microsecond over days.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from itertools import groupby, pairwise
from operator import itemgetter
from typing import TYPE_CHECKING

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import (
    Array,
    continuous_sign,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from forcecal_ros.core.schema import Vector7
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from typing import Self  # Python 3.11

Rows = slice | NDArray[np.bool_] | NDArray[np.intp]
"""Which samples."""

PHASES = (
    'idle', 'settle', 'move', 'measure', 'step', 'sweep', 'reverse', 'approach', 'contact',
    'retract', 'done', 'aborted',
)
"""The words that a sequencer publishes; see ``sequencer/phase``."""

FREE = ('move', 'settle', 'step', 'sweep', 'reverse')
"""Phases in which nothing touches the tool while the robot moves, or may."""

TOUCHING = ('approach', 'contact', 'retract')
"""Phases in which the tool touches something, or may."""

STILL = ('measure',)
"""Phases in which nothing touches the tool while the robot stands."""

SLOWEST_HZ, MANY_MESSAGES = 2.5, 1000
"""So many messages at a lower rate [Hz] may be stamped in milliseconds taken for seconds: a log of
0.4 to 2.5 kHz looks like that."""

CLOCK_JUMP_S = 1.0
"""Stamps that go back by more, twice, are of a clock that was set, or of a recording that begins
again [s]: no message is so late. By less, they are of messages out of order."""

_POSE = (*(f'pose.{axis}' for axis in 'xyz'), *9 * ('pose.orientation',))

CHANNELS = {
    'wrench': (*(f'force.{axis}' for axis in 'xyz'), *(f'torque.{axis}' for axis in 'xyz')),
    'accelerometer': tuple(f'accel.{axis}' for axis in 'xyz'),
    'optidrive': ('optidrive',),
    'angular_velocity': tuple(f'angular_velocity.{axis}' for axis in 'xyz'),
    'pose': _POSE,
    'target': tuple(name.replace('pose', 'target') for name in _POSE),
}
"""Names of each stream's columns, of a pose's position and rotation matrix."""


def _frozen(values: object) -> Array:
    """Return the values so that they cannot be changed: a copy, unless that is so already."""
    array = (np.asarray if _is_frozen(values) else np.array)(values, dtype=float)
    array.setflags(write=False)
    return array


def _is_frozen(values: object) -> bool:
    while isinstance(values, np.ndarray) and not values.flags.writeable:
        values = values.base
    return values is None


class Samples:
    """Arrays, one row for each time ``t`` [s]."""

    t: Array

    def __len__(self) -> int:
        return len(self.t)

    def between(self, start: float, end: float) -> 'Self':
        """Return the samples with ``start <= t < end`` [s]."""
        return self.rows(slice(*np.searchsorted(self.t, [start, end])))

    def rows(self, kept: Rows) -> 'Self':
        """Return some of the samples."""
        arrays = {name: one[kept] for name, one in vars(self).items() if hasattr(one, 'shape')}
        return replace(self, **arrays)  # type: ignore[type-var]


@dataclass(frozen=True)
class Stream(Samples):
    """
    One signal over time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Header stamps, strictly increasing [s] since the recording's start.
    values : ndarray, shape (n, k)
        One row a sample; unit and frame as the owner states.
    frame : str
        frame_id of the messages.
    """

    t: Array
    values: Array
    frame: str = ''

    def __post_init__(self) -> None:
        t, values = _frozen(self.t), _frozen(self.values)
        if t.ndim != 1 or values.ndim != 2 or len(t) != len(values):
            raise ValueError(f'expected t (n,) and values (n, k), got {t.shape}, {values.shape}')
        object.__setattr__(self, 't', t)
        object.__setattr__(self, 'values', values)

    @property
    def rate(self) -> float:
        """Median rate of the samples [Hz]."""
        return float(1.0 / np.median(np.diff(self.t))) if len(self.t) > 1 else float('nan')

    def at(self, t: Array) -> Array:
        """
        Return the values at other times, linearly interpolated, held beyond the ends.

        Parameters
        ----------
        t : ndarray, shape (m,)
            [s]

        Returns
        -------
        ndarray, shape (m, k)
        """
        if not len(self.t):
            raise DataError('cannot interpolate an empty stream')
        return np.stack([np.interp(t, self.t, column) for column in self.values.T], axis=1)


@dataclass(frozen=True)
class JointStream(Stream):
    """
    Positions of joints over time [rad] or [m].

    Attributes
    ----------
    names : tuple of str
        Of the columns; empty if not known.
    """

    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class PoseStream(Samples):
    """
    The sensor's pose in base over time, measured or commanded.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Header stamps, strictly increasing [s] since the recording's start.
    position : ndarray, shape (n, 3)
        Origin of ft_sensor in base [m]; NaN where only the orientation is known.
    R_base_sensor : ndarray, shape (n, 3, 3)
        Maps sensor coordinates to base coordinates.
    frame : str
        frame_id of the messages.
    of : str
        The frame whose pose it is, if the recording states it; a PoseStamped does not.
    """

    t: Array
    position: Array
    R_base_sensor: Array
    frame: str = 'base'
    of: str = ''

    def __post_init__(self) -> None:
        t, p, R = _frozen(self.t), _frozen(self.position), _frozen(self.R_base_sensor)
        n = len(t)
        if t.ndim != 1 or p.shape != (n, 3) or R.shape != (n, 3, 3):
            raise ValueError(
                f'expected t (n,), position (n, 3), R_base_sensor (n, 3, 3), '
                f'got {t.shape}, {p.shape}, {R.shape}')
        object.__setattr__(self, 't', t)
        object.__setattr__(self, 'position', p)
        object.__setattr__(self, 'R_base_sensor', R)

    @property
    def has_position(self) -> bool:
        """Whether every position is known, not the orientation alone."""
        return len(self.t) > 0 and bool(np.isfinite(self.position).all())

    def at(self, t: Array) -> 'PoseStream':
        """
        Return the poses at other times, by splines whose accelerations are smooth.

        Parameters
        ----------
        t : ndarray, shape (m,)
            [s]

        Returns
        -------
        PoseStream
            Without positions where not every position is known.
        """
        from scipy.interpolate import CubicSpline  # takes a second, which a node starts without

        turns = continuous_sign(quaternion_from_matrix(self.R_base_sensor))
        position = (CubicSpline(self.t, self.position)(t) if self.has_position
                    else np.full((len(t), 3), np.nan))
        return replace(self, t=t, position=position,
                       R_base_sensor=matrix_from_quaternion(CubicSpline(self.t, turns)(t)))


@dataclass(frozen=True)
class Phase:
    """One phase of the sequence: ``name`` from ``start`` up to ``end`` [s]."""

    name: str
    start: float
    end: float


@dataclass(frozen=True)
class Recording:
    """
    Everything one recording holds, of any source.

    Attributes
    ----------
    wrench : Stream or None
        (n, 6) force [N] and torque [N m] in ft_sensor, as on the wire: environment on tool,
        bias included.
    accelerometer : Stream or None
        (n, 3) in ``accelerometer_unit``: volts of each axis, or specific force (REP-145).
    accelerometer_unit : str
        ``V`` or ``m/s^2``.
    pose, target : PoseStream or None
        Measured and commanded pose of ft_sensor.
    optidrive : Stream or None
        (n, 1) displacement of a compliant tool along x of ft_sensor [m].
    contact_truth : Stream or None
        (n, 6) true contact wrench, which only a simulator knows.
    angular_velocity : Stream or None
        (n, 3) of an IMU's gyro, in its frame [rad/s].
    joint_commands : JointStream or None
        What a controller of joints was commanded.
    joints : JointStream or None
        Measured, of the joints that are commanded where these are named.
    phases : tuple of Phase
        In order, without gaps or overlaps; empty where none was recorded.
    start_ns : int
        Stamp that t = 0 represents [ns since the epoch].
    source : str
        Where it came from, for messages to the user.
    notes : tuple of str
        What reading had to leave out or correct, one plain sentence each.
    topics : mapping of str to tuple of (str, str)
        Role -> name and type of the topic that it was read from.
    candidates : mapping of str to tuple of str
        Role without a topic -> topics of the recording whose type fits it and that nothing uses.
    sensor_from_pose : tuple of 7 float or None
        By which the poses were taken from another frame to ft_sensor: x y z [m] qx qy qz qw of
        ft_sensor in that frame.
    wrench_sign : int or None
        What the wrench was multiplied by, 1 or -1; None: nobody has stated a sign.
    removed : mapping of str to int, or None
        Samples that the checks removed from each stream; None before they have run.
    raw_wrench : bool
        Whether they took the wrench for raw channels; it is checked again after their matrix.
    """

    wrench: Stream | None = None
    accelerometer: Stream | None = None
    accelerometer_unit: str = 'V'
    pose: PoseStream | None = None
    target: PoseStream | None = None
    optidrive: Stream | None = None
    contact_truth: Stream | None = None
    angular_velocity: Stream | None = None
    joint_commands: JointStream | None = None
    joints: JointStream | None = None
    phases: tuple[Phase, ...] = ()
    start_ns: int = 0
    source: str = ''
    notes: tuple[str, ...] = field(default=())
    topics: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    candidates: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    sensor_from_pose: Vector7 | None = None
    wrench_sign: int | None = None
    removed: Mapping[str, int] | None = None
    raw_wrench: bool = False

    def __repr__(self) -> str:
        found = {one.name: getattr(self, one.name) for one in fields(self)}
        lines = [f'{"stream":16}{"samples":>9}{"rate":>12}{"duration":>11}']
        for name, one in found.items():
            if isinstance(one, Samples) and len(one):
                s = float(one.t[-1] - one.t[0])
                rate = f'{(len(one) - 1) / s:.4g} Hz' if s else '-'
                lines.append(f'{name:16}{len(one):9}{rate:>12}{s:9.2f} s')
        return '\n'.join([self.source or 'recording', *lines])


def phases_of(words: Iterable[tuple[float, str]], end: float) -> tuple[Phase, ...]:
    """Make phases, each up to the next, of words at times [s], with or without repeats."""
    changes = [next(same) for _, same in groupby(words, key=itemgetter(1))]
    return tuple(Phase(word, start, stop)
                 for (start, word), (stop, _) in pairwise([*changes, (end, '')]))


def phase_spans(phases: tuple[Phase, ...], names: tuple[str, ...]) -> list[tuple[float, float]]:
    """
    Join consecutive phases of some names.

    Returns
    -------
    list of tuple of float
        Start and end of each stretch [s].
    """
    spans: list[tuple[float, float]] = []
    for phase in phases:
        if phase.name not in names:
            continue
        if spans and abs(spans[-1][1] - phase.start) < 1e-6:
            spans[-1] = (spans[-1][0], phase.end)
        else:
            spans.append((phase.start, phase.end))
    return spans
