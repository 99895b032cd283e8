"""The sequencer: moves the robot, records its sensors, identifies and publishes a calibration."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError, MotionError, with_id
from forcecal_ros.core.geometry import rotation_vector
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.sensor_matrix import corrected, required_sensor_matrix, SensorMatrix
from forcecal_ros.io.calibration_file import dump, load, save
from forcecal_ros.motion.monitor import POSITIONING_ERROR, Stillness
from forcecal_ros.motion.plan import (
    check_wrench,
    continuous_plan,
    Goal,
    in_words,
    outline,
    path_of,
    PlannedSegment,
    prepare,
    SEQUENCES,
)
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.motion.sequence import Command, MotionSequence
from forcecal_ros.nodes.backends import backend_of
from forcecal_ros.nodes.collector import Collector, Identification
from forcecal_ros.nodes.inputs import (
    accelerometer_input,
    at_sensor,
    mounting_parameter,
    optidrive_input,
    plain_input,
    pose_source,
)
from forcecal_ros.nodes.messages import (
    matrix_message,
    path_message,
    plan_markers,
    tool_message,
)
from forcecal_ros.nodes.motion_node import MotionNode
from forcecal_ros.nodes.runtime import answering, LATCHED, run, SECOND
from forcecal_ros.nodes.sequencer_settings import PARAMETERS, SequencerSettings, settings_of
from forcecal_ros.nodes.supervision import Deadman, Fault, Sensors
from forcecal_ros.nodes.wire import Reader, Sample
from geometry_msgs.msg import InertiaStamped, WrenchStamped
from nav_msgs.msg import Path
import numpy as np
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

AGAIN = 'call sequencer/preview and look at sequencer/planned_path'


class Preview(NamedTuple):
    """What a start does: parameters as text, and where it begins."""

    parameters: dict[str, str]
    start: Goal

    @classmethod
    def of(cls, values: Mapping[str, Any], start: Goal) -> 'Preview':
        """Note values as text, which can be compared: NaN, as poses may hold, equals nothing."""
        return cls({name: repr(value) for name, value in values.items()}, start)

    def refuse_other(self, shown: 'Preview | None') -> None:
        """
        Refuse a start that was not shown.

        Raises
        ------
        MotionError
            Nothing was shown, a parameter has changed since, or the robot has moved.
        """
        if shown is None:
            raise MotionError(f'motion.require_preview is set and nothing was shown yet; {AGAIN}')
        changed = [name for name, value in self.parameters.items()
                   if value != shown.parameters[name]]
        if changed:
            raise MotionError(f'{", ".join(changed)} changed since the preview; {AGAIN} again')
        if moved := _moved(shown.start, self.start):
            raise MotionError(f'the robot has moved by {moved} since the preview; {AGAIN} again')


def _moved(before: Goal, now: Goal) -> str:
    """Say by how much a robot has moved; empty: by no more than it positions itself."""
    if isinstance(before, Pose) and isinstance(now, Pose):
        turn = rotation_vector(before.R_base_sensor.T @ now.R_base_sensor)
        found = ((float(np.linalg.norm(now.position - before.position)), 'm'),
                 (float(np.linalg.norm(turn)), 'rad'))
    else:
        farthest = float(np.abs(np.subtract(now, before)).max())
        found = ((0.0, 'm'), (farthest, 'rad'))
    return ' and '.join(f'{size:.3g} {unit}' for (size, unit), least in zip(
        found, POSITIONING_ERROR) if size > least)


def _tool_in_words(calibration: Calibration) -> str:
    mass, com = calibration.mass, calibration.com
    place = ', '.join(f'{axis} {quantity(float(x), float(std), com.unit)}'
                      for axis, x, std in zip('xyz', com.value, com.std))
    return (f'mass {quantity(float(mass), float(mass.std), mass.unit)}, centre of mass {place} '
            '(95 % intervals)')


class WrenchReader:
    """Reads the raw channels of a sensor, and makes wrenches of them by its matrix."""

    def __init__(self, matrix: SensorMatrix) -> None:
        self._read, self._matrix = Reader(WrenchStamped), matrix

    def __call__(self, raw: bytes) -> Sample:
        """Read one message."""
        stamp_ns, (fx, fy, fz, nx, ny, nz) = self._read(raw)
        return Sample(stamp_ns, corrected((fx, fy, fz, nx, ny, nz), self._matrix))


class Sequencer(MotionNode[SequencerSettings]):
    """Runs one sequence at a time, from start to done or aborted."""

    def __init__(self) -> None:
        super().__init__('sequencer', PARAMETERS, settings_of)
        self._sequence = MotionSequence(self._settings.stream)
        self._calibration: Calibration | None = None
        self._identified = ''
        self._checks = 0
        self._stillness: Stillness | None = None
        self._preview: Preview | None = None
        sensors = self._listen()
        self._make_outputs()
        self._serve(self._sequence, sensors, backend_of(self, self._inbox, sensors),
                    round(SECOND / self._settings.stream.rate))

    def _listen(self) -> Sensors:
        value = self._values()
        accelerometer, unit = accelerometer_input(value['accelerometer.source'])
        mounting = mounting_parameter(self)
        self._collector = Collector(unit, value['wrench.sign'], mounting)
        matrix, part = self._load_matrix()
        self._identification = Identification(matrix)
        wrench = plain_input('wrench', 'wrench', WrenchStamped)
        inputs = (wrench if part is None else wrench._replace(read=WrenchReader(part)),
                  at_sensor(pose_source(self), mounting), accelerometer,
                  optidrive_input(value['optidrive.joint']))
        return Sensors(self._inbox, filter(None, inputs),
                       Deadman(self._inbox, value['motion.deadman_timeout']),
                       self._settings.watch, self._settings.limits, self._record)

    def _load_matrix(self) -> tuple[Calibration | None, SensorMatrix | None]:
        name = self.get_parameter('wrench.matrix_file').value
        if not name:
            return None, None
        if self.get_parameter('wrench.sign').value != 1:
            raise ConfigError('wrench.matrix_file gives wrenches of the right sign already; '
                              'set wrench.sign to 1')
        source = load(FilePath(name).expanduser())
        return source, required_sensor_matrix(source, name)

    def _record(self, channel: str, stamp_ns: int, values: tuple[float, ...]) -> None:
        if self._sequence.streaming:
            self._collector.add(channel, stamp_ns, values)

    # Motion -----------------------------------------------------------------------------

    def _busy(self) -> bool:
        return self._identification.under_way

    def _begin(self) -> str:
        settings, start = self._settings, self._backend.measured()
        if self.get_parameter('motion.require_preview').value:
            Preview.of(self._values(), start).refuse_other(self._preview)
        parts = self._plan(start)
        how = ('in continuous motion' if settings.continuous
               else f'with poses {", ".join(settings.poses)}')
        self.get_logger().info(f'{settings.sequence} starts, {how}')
        self._collector.clear()
        self._collector.frames.update(self._sensors.frames)
        self._sequence.settings = settings.stream
        self._sequence.start(parts, start, 'identification' if SEQUENCES[
            settings.sequence].identifies else '')
        return f'{settings.sequence} started'

    def _plan(self, start: Goal) -> tuple[PlannedSegment, ...]:
        """Plan from where the robot stands, checked against all limits."""
        settings = self._settings
        if settings.continuous:
            parts = continuous_plan(start, settings.timing, settings.pace, settings.limits)
        else:
            goals, away = settings.goals(start)
            plan = SEQUENCES[settings.sequence].plan(goals, away, settings.timing)
            parts = prepare(plan, start, settings.pace, settings.limits)
        check_wrench(parts, self._sensors.monitor.mean('wrench'), settings.limits)
        return parts

    def _show(self) -> str:
        """Say what a start would do, and publish its path; nothing moves."""
        self._make_ready()
        start = self._backend.measured()
        parts = self._plan(start)
        frame = self._sensors.frames['pose'] or self.get_parameter('motion.frame').value
        limits, now = self._settings.limits, self.get_clock().now()
        positions, rotations = path_of(parts)
        self._path_out.publish(path_message(positions, rotations, frame, now))
        self._markers_out.publish(plan_markers(
            limits.workspace_min, limits.workspace_max, positions, frame, now))
        self._preview = Preview.of(self._values(), start)
        found = in_words(outline(parts, self._settings.limits.tip))
        return self._with_caveat(f'{self._settings.sequence}: {found}')

    def _command(self) -> Command | None:
        return self._sequence.step(self._judge())

    def _judge(self) -> Stillness | None:
        if not self._sequence.settling:
            self._stillness = None
            return None
        self._checks += 1
        # stillness is checked once in so many commands: every 20 ms at 250 Hz, little
        # against the 0.25 s of its window
        if self._stillness is None or self._checks % 5 == 0:
            self._stillness = self._sensors.monitor.stillness()
        return self._stillness

    def _entered(self, stamp_ns: int) -> None:
        if self._sequence.streaming:
            self._collector.enter(self._sequence.status.phase, stamp_ns)

    def _headline(self) -> str:
        return f'{self._sequence.status.phase} {self._sequence.status.label}'.strip()

    def _details(self) -> dict[str, object]:
        status = self._sequence.status
        return {'for': status.label, 'progress': status.progress,
                'sequence': self._settings.sequence}

    # Result -----------------------------------------------------------------------------

    def _make_outputs(self) -> None:
        self._calibration_out = self.create_publisher(String, '~/calibration', LATCHED)
        self._gain_out = self.create_publisher(Float64MultiArray, '~/observer_gain', LATCHED)
        self._inertia_out = self.create_publisher(InertiaStamped, '~/tool_inertia', LATCHED)
        self._path_out = self.create_publisher(Path, '~/planned_path', LATCHED)
        self._markers_out = self.create_publisher(MarkerArray, '~/markers', LATCHED)
        self.create_service(Trigger, '~/save_calibration', answering(self._save))
        self.create_service(Trigger, '~/preview', answering(self._show))

    def _after(self) -> None:
        if self._identification.under_way:
            if (result := self._identification.take()) is not None:
                self._take(result)
        elif self._sequence.moved and not self._sequence.streaming:
            if SEQUENCES[self._settings.sequence].identifies:
                self._identification.begin(self._collector, self._settings.identification)
            else:
                self._finish()

    def _take(self, result: Calibration | str) -> None:
        if not self._sequence.running:
            return
        if isinstance(result, str):
            self._abort(Fault(result))
            return
        self._calibration = result
        now = datetime.now().astimezone().isoformat(' ', 'seconds')
        self._identified = (
            f'calibration from the {result.source["recording"]} recording that ended at {now}: '
            f'{_tool_in_words(result)}')
        self.get_logger().info(self._identified)
        self._calibration_out.publish(String(data=dump(result)))
        self._inertia_out.publish(tool_message(result, self.get_clock().now()))
        if result.observer is not None:
            self._gain_out.publish(matrix_message(
                result.observer.K.value, 'state x, dx/dt', 'output x, dx/dt, d2x/dt2'))
        self._finish()
        if self.get_parameter('save.automatic').value:
            try:
                self.get_logger().info(self._save())
            except ForcecalError as error:
                self.get_logger().error(with_id(error))

    def _finish(self) -> None:
        self._sequence.finish()
        self._announce(self.get_clock().now().nanoseconds)

    def _save(self) -> str:
        if self._sequence.running:
            raise MotionError(f'a motion is under way ({self._headline()}); save when '
                              'sequencer/state is done')
        if self._calibration is None:
            raise DataError('there is no calibration yet; call sequencer/start')
        path = FilePath(self.get_parameter('save.path').value).expanduser().absolute()
        save(self._calibration, path)
        return f'written to {path}: {self._identified}'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('sequencer', Sequencer, arguments, PARAMETERS)


if __name__ == '__main__':
    raise SystemExit(main())
