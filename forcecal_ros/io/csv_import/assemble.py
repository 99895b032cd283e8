"""Tables to signals on one time base."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion
from forcecal_ros.core.streams import JointStream, Phase, PHASES, phases_of, PoseStream, Stream
from forcecal_ros.io.csv_import import specification
from forcecal_ros.io.csv_import.specification import (
    ANGLES,
    Signal,
    Specification,
    TableSpecification,
)
from forcecal_ros.io.csv_import.table import nanoseconds, question_rate, read_table, Table
from forcecal_ros.io.urdf import FARTHEST_TURN
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_NOT_A_ROTATION = 1e-2
"""A matrix or quaternion that is further from orthogonal or from norm 1 is no rotation."""

WORSE = 10.0
"""How many times as much of the changes of force a weight leaves by the orientation as stated, at
least, where another reading is refused for it."""


Value = Stream | PoseStream | tuple[Phase, ...]


@dataclass(frozen=True)
class Imported:
    """
    Signals of all tables.

    Attributes
    ----------
    signals : mapping of str to Stream, PoseStream or phases
        By role; times count from ``start_ns``.
    topics : mapping of str to str
        By role, where it is not the usual one.
    start_ns : int
        [ns since the epoch]
    shift : int
        How much later all times are than in the tables [s]: a recording begins after zero.
    notes : tuple of str
        What the user should look at.
    """

    signals: Mapping[str, Value]
    topics: Mapping[str, str]
    start_ns: int
    shift: int
    notes: tuple[str, ...] = ()


def assemble(specification: Specification) -> Imported:
    """
    Read all tables and put their signals on one time base.

    Raises
    ------
    DataError
        A file, column or cell does not fit the specification; file and line are named.
    ConfigError
        A table gives no signal, or two give the same.
    """
    tables = [(one, _table(one)) for one in specification.tables]
    stamps = [_stamps(one, table) for one, table in tables]
    _check_time_base(specification, stamps)
    start = int(min(times[0] for times in stamps))
    signals: dict[str, Value] = {}
    topics: dict[str, str] = {}
    notes: list[str] = []
    posed: tuple[Table, Signal] | None = None
    for (one, table), times in zip(tables, stamps):
        t = (times - start) / 1e9
        notes.extend(table.notes)
        if one.time is not None:
            notes.extend(question_rate(
                len(t), float(t[-1] - t[0]), f'{table.path}, column {one.time.column!r}',
                one.time.unit))
        found: dict[str, Value] = {}
        for role, signal in one.signals.given.items():
            rows = table.having([name for part in signal.parts.values() for name in part.columns])
            part = table.select(rows)
            found[role] = value = _signal(part, t[rows], signal)
            notes.extend(_notes(role, part, table, value))
            posed = (part, signal) if role == 'pose' else posed
        if one.phases:
            found['phase'] = _phases(one, table, t)
        if not found:
            raise ConfigError(f'{specification.path}: {one.file} has neither signals nor phases; '
                              'add one of them')
        if repeated := sorted(found.keys() & signals.keys()):
            raise ConfigError(f'{specification.path}: {", ".join(repeated)} in more than one '
                              'table; import each table into a separate recording')
        signals.update(found)
        topics.update({role: signal.topic for role, signal in one.signals.given.items()
                       if signal.topic is not None})
    if posed:
        _refuse_other_readings(*posed, signals)
    shift = max(0, 1 - start // 10**9)
    return Imported(signals, topics, start + shift * 10**9, shift, tuple(notes))


def _table(specification: TableSpecification) -> Table:
    """Read a table, less rows whose stamp and signals are those of the row before."""
    time, phases, long = specification.time, specification.phases, specification.long
    names = [*(filter(None, (time.column, time.nanoseconds) if time else ())),
             *(name for signal in specification.signals.given.values()
               for part in signal.parts.values() for name in part.columns)]
    if phases and phases.column:
        names.append(phases.column)
    table = read_table(Path(specification.file), specification, names)
    if long is not None and time is not None:
        return table.widened(time.column, time.unit, long.name, long.value)
    return table if time is None else table.renewed(names)


def _notes(role: str, part: Table, table: Table, signal: Stream | PoseStream) -> Iterator[str]:
    if len(part) < len(table):
        yield f'{table.path}: {len(part)} of {len(table)} rows have values of {role}'
    bad = ~np.isfinite(signal.values).all(axis=1) if isinstance(signal, Stream) else np.array([])
    if bad.any():
        yield (f'{int(bad.sum())} of {len(bad)} rows of {role} are not finite, first in '
               f'{part.place(int(np.argmax(bad)))}; remove them (only a few are ignored when the '
               'recording is used)')


def _refuse_other_readings(table: Table, signal: Signal, signals: Mapping[str, Value]) -> None:
    wrench, pose, name = signals.get('wrench'), signals['pose'], _orientation(signal)
    if name in ANGLES and isinstance(wrench, Stream) and isinstance(pose, PoseStream):
        # others are checked with every recording
        refuse_other_reading(
            wrench, pose, _other_angles(name, _part(table, signal, name), signal.parts[name].unit),
            f'{table.path}: {name}')


def _other_angles(name: str, angles: Array, stated: str) -> Mapping[str, Array]:
    """Orientations by angles [rad] that are in the other unit or about other axes."""
    unit = 'deg' if stated == 'rad' else 'rad'
    size = specification.UNITS['angle'][unit] / specification.UNITS['angle'][stated]
    others = {f'its unit is {unit}': _turn(name, size * angles)}
    if name != 'rotation_vector':
        others['its columns are in the order yaw, pitch, roll'] = _turn(name, angles[:, ::-1])
    others['its angles are about the moving axes z, y, z (convert them to quaternions)'] = (
        np.asarray(Rotation.from_euler('ZYZ', angles).as_matrix()))
    return others | {f'it is {other}': _turn(other, angles) for other in ANGLES if other != name}


def refuse_other_reading(wrench: Stream, pose: PoseStream, others: Mapping[str, Array],
                         key: str) -> None:
    """
    Refuse an orientation by which force does not turn as a weight, but by another reading does.

    Parameters
    ----------
    others : mapping of str to ndarray, shape (n, 3, 3)
        R_base_sensor by other readings, and how messages call them.
    key : str
        What the specification calls it.
    """
    inside = np.flatnonzero((pose.t >= wrench.t[0]) & (pose.t <= wrench.t[-1]))
    force = wrench.at(pose.t[inside])[:, :3]
    good = (np.abs(force) < 1e6).all(axis=1)  # others are no readings
    inside, force = inside[good], force[good]
    if len(inside) < 10 or not np.ptp(force, axis=0).any():
        return
    mine = _unexplained_share(force, pose.R_base_sensor[inside])
    other, words = min((_unexplained_share(force, R[inside]), words)
                       for words, R in others.items())
    if WORSE * other < mine:
        raise DataError(
            f'{key}: the force rotates like a weight if {words} ({1 - other:.0%} of its variation '
            f'is explained), but not as specified ({1 - mine:.0%}); correct the specification')


def _unexplained_share(force: Array, R: Array) -> float:
    """Share of the changes of force that a constant one in base and a bias leave."""
    x = np.concatenate([R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape)], axis=2)
    x, y = x.reshape(-1, 6), force.ravel()
    found = np.linalg.lstsq(x, y, rcond=1e-9)[0]
    return float(((y - x @ found) ** 2).sum() / ((force - force.mean(axis=0)) ** 2).sum())


def _orientation(signal: Signal) -> str:
    return next(name for name in specification.ORIENTATIONS if name in signal.parts)


def _turn(name: str, angles: Array) -> Array:
    turn = (Rotation.from_rotvec(angles) if name == 'rotation_vector'
            else Rotation.from_euler('xyz' if name == 'rpy' else 'XYZ', angles))
    return np.asarray(turn.as_matrix())


def _stamps(specification: TableSpecification, table: Table) -> NDArray[np.int64]:
    time, rate, start = specification.time, specification.rate, specification.start or 0.0
    if time is not None:
        return nanoseconds(table, time.column, time.unit, time.nanoseconds)
    assert rate is not None
    rows = np.arange(len(table)) / rate + start
    stamps = np.rint(rows * 1e9).astype(np.int64)
    if (np.diff(stamps) <= 0).any():
        raise DataError(f'{table.path}: rows at {rate:g} Hz from {start:g} s on have the same '
                        'stamp in nanoseconds; correct rate or start')
    return stamps


def _check_time_base(specification: Specification, stamps: Sequence[NDArray[np.int64]]) -> None:
    order = sorted(range(len(stamps)), key=lambda i: int(stamps[i][0]))
    for one, other in pairwise(order):
        gap = int(stamps[other][0]) - max(int(stamps[i][-1]) for i in order[:order.index(other)])
        days = gap / (86400 * 10**9)
        if days > 1.0:
            raise DataError(
                f'{specification.tables[other].file} begins {days:.0f} days after '
                f'{specification.tables[one].file} ends: the tables are of different recordings, '
                'or a unit of time is wrong; correct the specification')


def _part(table: Table, signal: Signal, name: str) -> Array:
    part = signal.parts[name]
    return np.asarray(table.numbers(part.columns) * np.array(part.factors))


def _signal(table: Table, t: Array, signal: Signal) -> Stream | PoseStream:
    if not signal.parts.keys() & set(specification.ORIENTATIONS):
        values = np.concatenate([_part(table, signal, name) for name in signal.parts], axis=1)
        if isinstance(signal, specification.Joints):
            return JointStream(t, values, '', signal.names)
        return Stream(t, values, signal.frame)
    position = (_part(table, signal, 'position') if 'position' in signal.parts
                else np.full((len(t), 3), np.nan))
    return PoseStream(t, position, _rotations(table, signal), signal.frame)


def _rotations(table: Table, signal: Signal) -> Array:
    name = _orientation(signal)
    values = _part(table, signal, name)
    if name in ANGLES:
        _refuse(table, ~np.isfinite(values).all(axis=1), 'not finite')
        _refuse(table, (np.abs(values) > FARTHEST_TURN).any(axis=1),
                f'more than 4 pi ({np.abs(values).max():.4g} rad); is {name} in degrees '
                '(unit: deg)?')
        return _turn(name, values)
    if name == 'quaternion_xyzw':
        wrong = ~(np.abs(np.linalg.norm(values, axis=1) - 1.0) < _NOT_A_ROTATION)
        _refuse(table, wrong, 'not a quaternion of norm 1')
        return matrix_from_quaternion(values)
    R = values.reshape(-1, 3, 3)
    deviation = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    _refuse(table, ~(deviation < _NOT_A_ROTATION), 'not a rotation matrix in row-major order')
    _refuse(table, np.linalg.det(R) < 0, 'a reflection (determinant -1); its axes are left-handed')
    R = np.asarray(Rotation.from_matrix(np.array(R)).as_matrix())
    return R.transpose(0, 2, 1) if name == 'R_sensor_base' else R


def _refuse(table: Table, wrong: NDArray[np.bool_], what: str) -> None:
    if wrong.any():
        row = int(np.argmax(wrong))
        raise DataError(f'{table.place(row)}: the orientation is {what} ({int(wrong.sum())} such '
                        'rows)')


def _phases(specification: TableSpecification, table: Table, t: Array) -> tuple[Phase, ...]:
    words = specification.phases
    assert words is not None
    step = float(t[-1] - t[-2]) if len(t) > 1 else 1.0 / (specification.rate or 1.0)
    end = float(t[-1]) + step
    if words.column is not None:
        return _spoken(table, words.column, t, end)
    if words.whole is not None:
        return (Phase(words.whole, float(t[0]), end), Phase('done', end, end))
    assert words.each_row is not None and words.between is not None
    middles = [*((t[1:] + t[:-1]) / 2).tolist(), float(t[-1]) + step / 2]
    changes = [change for start, middle in zip(t.tolist(), middles)
               for change in ((start, words.each_row), (middle, words.between))]
    return phases_of([*changes[:-1], (middles[-1], 'done')], middles[-1])


def _spoken(table: Table, column: str, t: Array, end: float) -> tuple[Phase, ...]:
    """Phases from a column that holds their words."""
    found = [cell.strip() for cell in table.cells(column)]
    for row, word in enumerate(found):
        if word not in PHASES:
            raise DataError(f'{table.place(row)}: {word[:40]!r} in column {column!r} is not a '
                            f'phase; use {", ".join(PHASES)}')
    return phases_of([*zip(t.tolist(), found), (end, 'done')], end)
