"""What a specification may say wrongly though every cell is a number: units, orders, lines."""

from collections.abc import Iterator, Mapping

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Stream
from forcecal_ros.io.bags.header_stamps import MANY, SLOWEST
from forcecal_ros.io.csv_import.table import Table
import numpy as np

FASTEST = 50_000.0
"""No force sensor sends more rows a second [Hz]."""

MOST = 2000
"""Rows that are looked at."""

FOLLOWS, WORSE = 0.1, 10.0
"""Share of the changes of force that a weight leaves at most where it is what turns there, and how
many times as much it leaves by the orientation as it was read."""


def question_rate(rows: int, span: float, what: str, unit: str) -> Iterator[str]:
    """Question a rate that no sensor has; ``span`` from the first row to the last [s]."""
    if rows >= MANY and rows <= SLOWEST * span:
        yield (f'{what}: {rows} rows over {span / 3600:.2g} h, {rows / span:.3g} a second; if '
               f'that is too slow, time is not in {unit}: state the unit that it is in')
    if rows >= MANY and rows > FASTEST * span:
        yield (f'{what}: {rows} rows in {span:.3g} s, more than any sensor sends; if time is '
               f'not in {unit}, state the unit that it is in')


def missing(table: Table, role: str, values: Array) -> Iterator[str]:
    """Say how many rows have cells that are not finite, and where the first is."""
    bad = ~np.isfinite(values).all(axis=1)
    if bad.any():
        yield (f'{int(bad.sum())} of {len(bad)} rows of {role} are not finite, first in '
               f'{table.place(int(np.argmax(bad)))}; a few are left out where the recording is '
               'used, remove what is not a reading')


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
    inside = inside[::max(1, len(inside) // MOST)]
    force = np.stack([np.interp(pose.t[inside], wrench.t, column)
                      for column in wrench.values[:, :3].T], axis=1)
    good = np.isfinite(force).all(axis=1)
    inside, force = inside[good], force[good]
    if len(inside) < 10 or not np.ptp(force, axis=0).any():
        return
    if words := other_reading(force, pose.R_base_sensor[inside],
                              {name: R[inside] for name, R in others.items()}):
        raise DataError(f'{key}: {words}; state what it is')


def other_reading(force: Array, R_base_sensor: Array, others: Mapping[str, Array]) -> str:
    """
    Say by which other reading of orientations forces turn as a weight; empty: by none.

    Parameters
    ----------
    force : ndarray, shape (n, 3)
        [N]
    others : mapping of str to ndarray, shape (n, 3, 3)
        R_base_sensor by other readings, and how messages call them.
    """
    mine = _unexplained_share(force, R_base_sensor)
    unexplained, words = min((_unexplained_share(force, R), words) for words, R in others.items())
    if unexplained < FOLLOWS and WORSE * unexplained < mine:
        return (f'force turns as a weight does if {words} ({1 - unexplained:.0%} of its changes '
                f'follow), not as stated ({1 - mine:.0%})')
    return ''


def _unexplained_share(force: Array, R: Array) -> float:
    """Share of the changes of force that a constant one in base and a bias leave."""
    x = np.concatenate([R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape)], axis=2)
    x, y = x.reshape(-1, 6), force.ravel()
    found = np.linalg.lstsq(x, y, rcond=1e-9)[0]
    return float(((y - x @ found) ** 2).sum() / ((force - force.mean(axis=0)) ** 2).sum())
