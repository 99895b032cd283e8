"""The sequencer: moves the robot, records its sensors, identifies and publishes a calibration."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from forcecal_ros.calibrate.settings import (
    COMPLIANCES,
    COUPLINGS,
    DESIGNS,
    IdentificationSettings,
    MODES,
)
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError, MotionError, with_id
from forcecal_ros.core.geometry import Array, POSE_LENGTH, rotation_vector, STANDARD_GRAVITY
from forcecal_ros.core.parameters import Parameter, parameters_of, section_of
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.sensor_matrix import corrected, required_sensor_matrix, SensorMatrix
from forcecal_ros.io.calibration_file import dump, load, save
from forcecal_ros.motion import plan, profiles
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import POSITIONING_ERROR, Stillness, WatchSettings
from forcecal_ros.motion.plan import Goal
from forcecal_ros.motion.profiles import Pace, Pose
from forcecal_ros.motion.sequence import Command, MotionSequence, StreamSettings
from forcecal_ros.nodes import inputs, messages
from forcecal_ros.nodes.backends import BACKENDS
from forcecal_ros.nodes.collector import Collector, Identification
from forcecal_ros.nodes.motion_node import Fault, MotionNode
from forcecal_ros.nodes.runtime import answering, EXECUTOR, LATCHED, run, SECOND
from forcecal_ros.nodes.runtime import live_parameter as _live
from forcecal_ros.nodes.wire import Reader, Sample
from geometry_msgs.msg import InertiaStamped, WrenchStamped
from nav_msgs.msg import Path
import numpy as np
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

_WATCH = WatchSettings()
_SETTLE = ('window', 'factor', 'force_floor', 'torque_floor', 'position_floor')


PARAMETERS = (
    EXECUTOR,
    _live('sequence', 'calibrate', 'Sequence that a start runs', choices=tuple(plan.SEQUENCES)),
    _live('motion.sequence', 'poses', 'Motion of calibrate. poses: rest in each pose, then a '
          'step; continuous: 10 s of smooth motion in all axes about the present pose',
          choices=('poses', 'continuous')),
    _live('poses.names', list(profiles.nominal_poses()), 'Names of the poses in their order; the '
          'step is made in the first'),
    _live('poses.values', profiles.flatten_poses(profiles.nominal_poses()),
          'x y z [m] qx qy qz qw of each pose of ft_sensor in base, one after the other; '
          '.nan keeps the present position')._replace(per_line=POSE_LENGTH),
    *parameters_of('timing', plan.Timing()),
    *parameters_of('pace', Pace()),
    *parameters_of('limits', Limits()),
    *parameters_of('watch', _WATCH, 'pause_timeout', 'most_pauses', 'lost_timeout',
                   'frozen_timeout', 'max_age', 'clock_timeout'),
    *parameters_of('settle', _WATCH, *_SETTLE),
    _live('settle.timeout', StreamSettings().settle_timeout, 'Time within which the tool must '
          'come to rest after a move', 's', 0.5, 120.0),
    Parameter('motion.backend', 'target_frame', 'Topic and type of the commands',
              choices=tuple(BACKENDS)),
    Parameter('motion.rate', 250.0, 'Rate of the commands', 'Hz', 100.0, 250.0),
    *inputs.COMMAND_PARAMETERS,
    _live('motion.require_preview', False, 'Refuse a start without a sequencer/preview of these '
          'parameters from the present pose'),
    Parameter('motion.twist_gain', 5.0, 'delta_twist_cmds: gain from the pose error to the '
              'velocity', '1/s', 0.0, 50.0),
    Parameter('joints.names', [''], 'joint_trajectory: names of all joints of the controller'),
    _live('joints.values', [0.0], 'joint_trajectory: joint vectors of the poses', 'rad'),
    _live('joints.away', [0.0], 'joint_trajectory: joint vector at the end of the step', 'rad'),
    *inputs.POSE_PARAMETERS,
    inputs.WRENCH_SIGN,
    Parameter('wrench.matrix_file', '', 'calibration.yaml of forcecal insitu, whose matrix '
              'converts raw channels to a wrench; empty: wrench is not raw'),
    inputs.ACCELEROMETER_SOURCE,
    _live('accelerometer.coupling', 'dc', 'ac for a sensor that does not measure a constant '
          'acceleration', choices=COUPLINGS),
    _live('accelerometer.cutoff', 0.0,
          'Cut-off frequency of an ac sensor; 0: estimated', 'Hz', 0.0, 10.0),
    Parameter('optidrive.joint', 'optidrive', 'Name in the JointState of the compliant tool'),
    _live('identify.gravity', STANDARD_GRAVITY, 'Magnitude of gravity at the robot',
          'm/s^2', 9.7, 9.9),
    _live('identify.gravity_direction', [0.0, 0.0, -1.0],
          'Direction of gravity in base, of any length'),
    _live('identify.sensor_rotation', [0.0, 0.0, 0.0],
          "Rotation vector of the wrench's axes in the frame of current_pose", 'rad'),
    _live('identify.tool_compliance', 'auto', 'Whether the tool is compliant along x of ft_sensor',
          choices=COMPLIANCES),
    _live('observer.mode', 'kalman', 'Observer that publishes the contact wrench', choices=MODES),
    _live('observer.design', 'kalman', "Design of the paper's gain", choices=DESIGNS),
    _live('observer.poles', [-30.0, -40.0],
          "Poles of the observer's error, with observer.design poles", '1/s'),
    _live('save.path', 'calibration.yaml', 'File that save_calibration writes; an earlier one is '
          'kept as FILE~'),
    _live('save.automatic', False, 'Whether every calibration is saved automatically'),
)


class SequencerSettings(NamedTuple):
    """Settings of one sequence."""

    sequence: str
    poses: dict[str, Pose]
    joints: dict[str, Array]
    joints_away: Array
    timing: plan.Timing
    pace: Pace
    limits: Limits
    watch: WatchSettings
    stream: StreamSettings
    identification: IdentificationSettings
    continuous: bool = False

    @property
    def identifies(self) -> bool:
        """Whether a calibration is identified from the sequence."""
        return self.sequence == 'calibrate'

    def goals(self, start: Goal) -> tuple[dict[str, Goal], Goal]:
        """Return goals and the goal of the step, as poses or joint vectors like ``start``."""
        if isinstance(start, Pose):
            poses = profiles.anchor(self.poses, start.position)
            home = next(iter(poses.values()))
            return dict(poses), profiles.step_goal(
                home, self.timing.step_distance if self.identifies
                else self.timing.contact_distance)
        return dict(self.joints), self.joints_away


def settings_of(value: Mapping[str, Any]) -> SequencerSettings:
    """
    Make settings of the values of all ``PARAMETERS``, by name.

    Raises
    ------
    ConfigError
        Values contradict each other, or the file of poses cannot be read.
    """
    limits = section_of(Limits, value, 'limits')
    watch = replace(section_of(WatchSettings, value, 'watch'),
                    **{name: value[f'settle.{name}'] for name in _SETTLE})
    # latency that sensors may have: settling lasts that much longer than the window of stillness,
    # so that all readings in it were taken at rest [s]
    stream = StreamSettings(
        rate=value['motion.rate'], stop_duration=limits.stop_duration,
        settle_minimum=watch.window + 0.05, settle_timeout=value['settle.timeout'])
    poses = profiles.read_poses(value['poses.names'], value['poses.values'])
    joints, away = _joint_vectors(list(poses), value)
    return SequencerSettings(
        value['sequence'], poses, joints, away, section_of(plan.Timing, value, 'timing'),
        section_of(Pace, value, 'pace'), limits, watch, stream, _identification(value),
        value['sequence'] == 'calibrate' and value['motion.sequence'] == 'continuous')


def _identification(value: Mapping[str, Any]) -> IdentificationSettings:
    return IdentificationSettings(
        gravity=value['identify.gravity'],
        gravity_direction=tuple(value['identify.gravity_direction']),
        sensor_rotation=tuple(value['identify.sensor_rotation']),
        coupling=value['accelerometer.coupling'],
        cutoff=value['accelerometer.cutoff'] or None,
        tool_compliance=value['identify.tool_compliance'],
        observer_mode=value['observer.mode'], observer_design=value['observer.design'],
        observer_poles=tuple(value['observer.poles']), source={'by': 'sequencer'})


def _joint_vectors(names: list[str], value: Mapping[str, Any]
                   ) -> tuple[dict[str, Array], Array]:
    if value['motion.backend'] != 'joint_trajectory':
        return {}, np.zeros(0)
    joints = value['joints.names']
    vectors = np.array(value['joints.values'], dtype=float)
    away = np.array(value['joints.away'], dtype=float)
    if len(vectors) != len(joints) * len(names) or len(away) != len(joints):
        raise ConfigError(
            f'{len(joints)} joints and {len(names)} poses require {len(joints) * len(names)} '
            f'numbers in joints.values and {len(joints)} in joints.away, got {len(vectors)} and '
            f'{len(away)}')
    if not (np.isfinite(vectors).all() and np.isfinite(away).all()):
        raise ConfigError('joints.values or joints.away has a number that is not finite')
    return dict(zip(names, vectors.reshape(len(names), -1))), away


AGAIN = 'call sequencer/preview and check sequencer/planned_path'


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
            raise MotionError(f'motion.require_preview is set, but no preview was made; {AGAIN}')
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


def wrench_reader(matrix: SensorMatrix) -> Callable[[bytes], Sample]:
    """Return a reader of the raw channels of a sensor that makes wrenches of them."""
    read = Reader(WrenchStamped)

    def read_wrench(raw: bytes) -> Sample:
        sample = read(raw)
        fx, fy, fz, nx, ny, nz = sample.values
        return sample._replace(values=corrected((fx, fy, fz, nx, ny, nz), matrix))

    return read_wrench


class Sequencer(MotionNode):
    """Runs one sequence at a time, from start to done or aborted."""

    _settings: SequencerSettings

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
        backend = BACKENDS[self.get_parameter('motion.backend').value]
        self._serve(self._sequence, sensors, backend(self, self._inbox, sensors),
                    round(SECOND / self._settings.stream.rate))

    def _listen(self) -> inputs.Sensors:
        value = self._values()
        accelerometer, unit = inputs.accelerometer_input(value['accelerometer.source'])
        mounting = inputs.mounting_parameter(self)
        self._collector = Collector(unit, value['wrench.sign'], mounting)
        matrix, part = self._load_matrix()
        self._identification = Identification(matrix)
        wrench = inputs.plain_input('wrench', 'wrench', WrenchStamped)
        topics = (wrench if part is None else wrench._replace(read=wrench_reader(part)),
                  inputs.at_sensor(inputs.pose_source(self), mounting), accelerometer,
                  inputs.optidrive_input(value['optidrive.joint']))
        deadman = inputs.Deadman(self._inbox, value['motion.deadman_timeout'])
        return inputs.Sensors(self._inbox, filter(None, topics), deadman, self._settings.watch,
                              self._settings.limits, self._record)

    def _load_matrix(self) -> tuple[Calibration | None, SensorMatrix | None]:
        name = self.get_parameter('wrench.matrix_file').value
        if not name:
            return None, None
        if self.get_parameter('wrench.sign').value != 1:
            raise ConfigError('wrench.matrix_file already gives wrenches of the right sign; '
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
        self._sequence.start(parts, start, 'identification' if settings.identifies else '')
        return f'{settings.sequence} started'

    def _plan(self, start: Goal) -> tuple[plan.PlannedSegment, ...]:
        """Plan from where the robot stands, checked against all limits."""
        settings = self._settings
        if settings.continuous:
            parts = plan.continuous_plan(start, settings.timing, settings.pace, settings.limits)
        else:
            goals, away = settings.goals(start)
            parts = plan.prepare(plan.SEQUENCES[settings.sequence](goals, away, settings.timing),
                                 start, settings.pace, settings.limits)
        plan.check_wrench(parts, self._sensors.monitor.mean('wrench'), settings.limits)
        return parts

    def _show(self) -> str:
        """Say what a start would do, and publish its path; nothing moves."""
        self._make_ready()
        start = self._backend.measured()
        parts = self._plan(start)
        frame = self._sensors.frames['pose'] or self.get_parameter('motion.frame').value
        limits, now = self._settings.limits, self.get_clock().now()
        positions, rotations = plan.path_of(parts)
        self._path_out.publish(messages.path_message(positions, rotations, frame, now))
        self._markers_out.publish(messages.plan_markers(
            limits.workspace_min, limits.workspace_max, positions, frame, now))
        self._preview = Preview.of(self._values(), start)
        found = plan.outline(parts, limits.tip)
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
            if self._settings.identifies:
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
        self._inertia_out.publish(messages.tool_message(result, self.get_clock().now()))
        if result.observer is not None:
            self._gain_out.publish(messages.matrix_message(
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


main = partial(run, 'sequencer', Sequencer, PARAMETERS)
"""Runs the node; takes the arguments, by default those of the process, and returns the status."""


if __name__ == '__main__':
    raise SystemExit(main())
