"""Identification from the samples of a sequence, beside the command stream."""

from threading import Thread

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.calibration.sensor_matrix import with_matrix_of
from forcecal_ros.errors import ForcecalError
from forcecal_ros.identify.pipeline import identify
from forcecal_ros.identify.settings import IdentificationSettings
from forcecal_ros.nodes.collector import Collector
from forcecal_ros.observe.gains import with_kalman_gains


class Identification:
    """
    One identification at a time, in a thread of its own, so that the stream's timer goes on.

    Parameters
    ----------
    matrix : Calibration or None
        Its sensor matrix has made the wrenches of raw channels, and goes into the results.
    """

    def __init__(self, matrix: Calibration | None) -> None:
        self._matrix = matrix
        self._worker: Thread | None = None
        self._result: Calibration | str = ''

    @property
    def under_way(self) -> bool:
        """Whether one has begun and its result was not taken yet."""
        return self._worker is not None

    def begin(self, collector: Collector, settings: IdentificationSettings) -> None:
        """Begin to identify from the collected samples."""
        self._worker = Thread(target=self._work, args=(collector, settings), name='identify',
                              daemon=True)
        self._worker.start()

    def _work(self, collector: Collector, settings: IdentificationSettings) -> None:
        try:
            found = identify(collector.recording(), settings)
            if self._matrix is not None:
                found = with_matrix_of(found, self._matrix)
            self._result = with_kalman_gains(found)
        except ForcecalError as error:
            self._result = ' '.join(str(error).split())
        except Exception as error:
            self._result = f'identification failed: {type(error).__name__}: {error}'
            raise

    def take(self) -> Calibration | str | None:
        """Return the calibration, or why there is none, once; None without a new result."""
        if self._worker is None or self._worker.is_alive():
            return None
        self._worker = None
        return self._result
