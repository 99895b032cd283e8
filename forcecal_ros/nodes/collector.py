"""Live samples, collected into a recording, and identified beside the command stream."""

from dataclasses import replace
from threading import Thread

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError, with_id
from forcecal_ros.core.geometry import matrix_from_quaternion
from forcecal_ros.core.schema import Vector7
from forcecal_ros.core.sensor_matrix import with_matrix_of
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.observe.design import with_kalman_gains
import numpy as np

CHANNELS = ('wrench', 'accelerometer', 'pose', 'target', 'optidrive')


class Collector:
    """
    All samples since :meth:`clear`.

    Parameters
    ----------
    accelerometer_unit : str
        ``V`` or ``m/s^2``.
    wrench_sign : int
        -1 where the driver reports the wrench of the tool on its environment.
    sensor_from_pose : tuple of 7 float or None
        By which the poses that are added were taken to ft_sensor.

    Attributes
    ----------
    frames : dict
        frame_id by channel.
    """

    def __init__(self, accelerometer_unit: str, wrench_sign: int,
                 sensor_from_pose: Vector7 | None = None) -> None:
        if wrench_sign not in (1, -1):
            raise ConfigError(f'wrench.sign is {wrench_sign}, expected 1 or -1')
        self._unit = accelerometer_unit
        self._sign = wrench_sign
        self._sensor_from_pose = sensor_from_pose
        self.frames: dict[str, str] = {}
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._stamps: dict[str, list[int]] = {name: [] for name in CHANNELS}
        self._values: dict[str, list[tuple[float, ...]]] = {name: [] for name in CHANNELS}
        self._phases: list[tuple[str, int]] = []

    def add(self, channel: str, stamp_ns: int, values: tuple[float, ...]) -> None:
        """Add a sample."""
        self._stamps[channel].append(stamp_ns)
        self._values[channel].append(values)

    def forget(self, before_ns: int) -> None:
        """Forget samples with earlier stamps."""
        for name, stamps in self._stamps.items():
            kept = [i for i, stamp in enumerate(stamps) if stamp >= before_ns]
            self._stamps[name] = [stamps[i] for i in kept]
            self._values[name] = [self._values[name][i] for i in kept]

    def newest(self, channel: str) -> int:
        """Return the latest stamp of a channel, 0 where it has no sample [ns]."""
        return max(self._stamps[channel], default=0)

    def enter(self, phase: str, stamp_ns: int) -> None:
        """Add a phase; one that is announced again changes nothing."""
        if not self._phases or self._phases[-1][0] != phase:
            self._phases.append((phase, stamp_ns))

    def recording(self) -> Recording:
        """
        Return the samples as a recording, sorted by stamp.

        Raises
        ------
        DataError
            There is no sample of the wrench or the pose.
        """
        if not self._stamps['wrench'] or not self._stamps['pose']:
            raise DataError('no wrench or no pose was received; check topics and drivers')
        start = min(min(stamps) for stamps in self._stamps.values() if stamps)
        wrench = self._stream('wrench', start)
        assert wrench is not None
        return Recording(
            wrench=replace(wrench, values=wrench.values * self._sign),
            accelerometer=self._stream('accelerometer', start),
            accelerometer_unit=self._unit,
            pose=self._poses('pose', start), target=self._poses('target', start),
            optidrive=self._stream('optidrive', start),
            phases=self._closed_phases(start), start_ns=start, source='live',
            sensor_from_pose=self._sensor_from_pose, wrench_sign=self._sign)

    def _stream(self, name: str, start: int) -> Stream | None:
        stamps, order = np.unique(np.array(self._stamps[name], dtype=np.int64), return_index=True)
        values = np.array([self._values[name][i] for i in order], dtype=float)
        t = np.asarray((stamps - start) * 1e-9, dtype=float)
        return Stream(t, values, self.frames.get(name, '')) if len(t) else None

    def _poses(self, name: str, start: int) -> PoseStream | None:
        one = self._stream(name, start)
        return None if one is None else PoseStream(
            one.t, one.values[:, :3], matrix_from_quaternion(one.values[:, 3:]),
            self.frames.get(name, 'base'))

    def _closed_phases(self, start: int) -> tuple[Phase, ...]:
        end = max(max(stamps) for stamps in self._stamps.values() if stamps) + 1
        ends = [*(stamp for _, stamp in self._phases[1:]), end]
        return tuple(Phase(name, (begin - start) * 1e-9, (end - start) * 1e-9)
                     for (name, begin), end in zip(self._phases, ends) if end > begin)


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
            self._result = with_id(error)
        except Exception as error:
            self._result = f'identification failed: {type(error).__name__}: {error}'
            raise

    def take(self) -> Calibration | str | None:
        """Return the calibration, or why there is none, once; None without a new result."""
        if self._worker is None or self._worker.is_alive():
            return None
        self._worker = None
        return self._result
