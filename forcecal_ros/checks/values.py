"""Readings that are none: not finite, or larger than anything a sensor says."""

from collections.abc import Sequence

from forcecal_ros.checks import limits
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Stream
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


class Unreadable:
    """
    The samples of one stream that are no readings, counted piece by piece.

    Parameters
    ----------
    stream : str
        For messages.
    channels : sequence of str
        Names of the columns, for messages.
    limit : float
        Largest reading.
    """

    def __init__(self, stream: str, channels: Sequence[str],
                 limit: float = limits.ABSURD) -> None:
        self.count = self.total = 0
        self._stream, self._channels, self._limit = stream, channels, limit
        self._first = ''
        self._finite = True

    def add(self, t: Array, values: Array) -> Mask:
        """Count the samples of a piece; return which are readings."""
        self.total += len(values)
        if not len(values) or (-self._limit < values.min() and values.max() < self._limit):
            return np.ones(len(values), dtype=bool)
        good = np.abs(values) < self._limit
        whole: Mask = good.all(axis=1)
        self.count += int((~whole).sum())
        self._finite &= bool(np.isfinite(values).all())
        i = int(np.argmin(whole))
        j = int(np.argmin(good[i]))
        channel = self._channels[j] if j < len(self._channels) else f'column {j + 1}'
        self._first = self._first or f'{channel} from {t[i]:.2f} s on'
        return whole

    def note(self) -> str:
        """
        Say what has to be left out; empty: nothing.

        Raises
        ------
        DataError
            Too much.
        """
        if not self.count:
            return ''
        what = f'not finite or beyond {self._limit:g}'
        if self._finite and self.count == self.total:
            raise DataError(f'{self._stream}: all samples are beyond {self._limit:g} '
                            f'({self._first}): they are counts of a converter; divide them '
                            'by the counts of each unit in the driver')
        if self.count == self.total or self.count > max(limits.FEW, limits.SPOILT * self.total):
            raise DataError(f'{self._stream}: {100.0 * self.count / self.total:.1f} % of the '
                            f'samples are {what} ({self._first}); check the driver and record '
                            'again')
        return f'{self._stream}: {self.count} samples are {what} and left out'


def readable(stream: Stream | PoseStream, name: str, channels: Sequence[str],
             limit: float = limits.ABSURD) -> tuple[Mask, str]:
    """
    Say which samples are readings, and what has to be left out.

    Of a pose the orientation may be all there is: its position is NaN then.

    Raises
    ------
    DataError
        Too much would have to be left out.
    """
    if isinstance(stream, Stream):
        values = stream.values
    else:
        place = np.nan_to_num(stream.position, nan=0.0, posinf=np.inf, neginf=-np.inf)
        values = np.hstack([place, stream.R_base_sensor.reshape(len(stream), 9)])
    counted = Unreadable(name, channels, limit)
    return counted.add(stream.t, values), counted.note()


def startup(stream: Stream) -> int:
    """
    Count the samples before a sensor's first reading: not finite, or zero in all channels.

    Returns
    -------
    int
        0 where they are no start: too long, or not the only ones of their kind.
    """
    for nothing in (~np.isfinite(stream.values).all(axis=1), ~stream.values.any(axis=1)):
        first = int(np.argmin(nothing))
        if first > limits.FEW and not nothing[first:].any() and 2 * first < len(stream) and (
                stream.t[first] - stream.t[0] < limits.STARTUP):
            return first
    return 0
