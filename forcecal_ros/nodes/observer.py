"""The contact-force observer as a lifecycle node around the chain of forcecal_ros.observe."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError, with_id
from forcecal_ros.core.geometry import combine
from forcecal_ros.core.parameters import Parameter, parameters_of, section_of
from forcecal_ros.io.calibration_file import DAY, load, parse, refuse_old
from forcecal_ros.nodes import inputs, runtime
from forcecal_ros.nodes import observer_outputs as outputs
from forcecal_ros.nodes.messages import matrix_message
from forcecal_ros.nodes.runtime import LATCHED, OUTPUT, STEADY
from forcecal_ros.nodes.runtime import live_parameter as _live
from forcecal_ros.nodes.wire import Inbox, Sample, Writer
from forcecal_ros.observe import ContactSample, design, noise_levels
from forcecal_ros.observe.design import accuracy, with_bias
from forcecal_ros.observe.frames import agreed, Frames, Mounting
from forcecal_ros.observe.live import LiveObserver, Samples, Values
from forcecal_ros.observe.payload import PayloadSettings
from forcecal_ros.observe.sample import INVALID, NO_ACCELEROMETER
from forcecal_ros.observe.settings import FILTERS, MODES, ObserverSettings
from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

PARAMETERS = (
    runtime.EXECUTOR,
    Parameter('autostart', True, 'Configure and activate at start; false: leave it to a '
              'lifecycle manager'),
    _live('calibration.file', '', 'calibration.yaml to load when configured; empty: wait for '
          'sequencer/calibration'),
    _live('calibration.max_age', 0.0, 'Largest age of the recording of calibration.file; 0: any',
          'd', 0.0, 36500.0),
    Parameter('calibration.follow', True, 'Use each calibration that the sequencer publishes '
              'while running'),
    Parameter('tools', '', 'Folder of calibrations of the same sensor, one NAME.yaml per tool'),
    _live('tool', '',
          'NAME in tools of the mounted tool; the bias is kept at a change; '
          'empty: that of the calibration; tracked: that of observer/tool or, with payload.track, '
          "the node's own estimate"),
    Parameter('payload.track',
              False, 'Track changes of the mass and centre of mass of the tool, and '
              'publish them on observer/tool'),
    Parameter('payload.largest', 0.0, "Largest payload that is expected; 0: the tool's own mass",
              'kg', 0.0, 1e4),
    Parameter('payload.floor_force', PayloadSettings().floor[0], 'Expected residual force '
              'in free motion, averaged over 0.2 s', 'N', 0.0, 1e3),
    Parameter('payload.floor_torque', PayloadSettings().floor[1], 'Expected residual torque '
              'in free motion, averaged over 0.2 s', 'N m', 0.0, 1e3),
    Parameter('accelerometer.source', 'auto', 'Topic accelerometer/raw in volts, imu/data_raw or '
              'accel in m/s^2; auto: by the unit of the calibration',
              choices=('auto', *inputs.ACCELEROMETERS, 'none')),
    *inputs.POSE_PARAMETERS[:-1],
    inputs.SENSOR_FROM_POSE._replace(
        description='x y z [m] qx qy qz qw of ft_sensor in the frame whose pose is measured; '
        '[0.0]: that of the calibration'),
    Parameter('poll_rate', 0.0,
              'Rate of polling topics, which halves the load and adds half a period of '
              'latency; 0: process each message on arrival', 'Hz', 0.0, 2000.0),
    Parameter('optidrive.joint', 'optidrive', 'Name in the JointState of the compliant tool; '
              'empty: no such sensor'),
    Parameter('publish.inertial_wrench', False, 'Publish observer/inertial_wrench, the wrench of '
              "the tool's weight and inertia"),
    Parameter('publish.innovation', False, 'Publish observer/innovation'),
    Parameter('publish.frames', [''],
              'Publish observer/contact_wrench/FRAME in each of these frames, '
              'about its origin'),
    Parameter('publish.frame_poses', [0.0], 'x y z [m] qx qy qz qw of each of publish.frames in '
              'ft_sensor; omit it for the last one if that is the frame of current_pose'),
    Parameter('publish.marker_rate', 20.0,
              'Rate of observer/markers, which draws the contact force '
              'and its uncertainty; 0: never', 'Hz', 0.0, 100.0),
    Parameter('publish.transform', False, 'Publish the pose of ft_sensor from current_pose on '
              '/tf; requires tf2_msgs'),
    _live('observer.mode', '',
          'Observer that publishes; empty: that of the calibration', choices=('', *MODES)),
    *parameters_of('observer', ObserverSettings(), 'bandwidth_hz', 'contact_walk',
                   'bandwidth_min_hz', 'bandwidth_max_hz', 'adaptive', 'offset',
                   'accelerometer_timeout', 'pose_timeout', 'skew'),
    _live('gravity.filter', 'none',
          'Filter that replaces the observer: ukf and ekf also estimate the biases, static '
          'does not filter; none: the observer',
          choices=('none', *(name for name in FILTERS if name not in MODES))),
    _live('limits.force', 0.0, 'Measuring range of the force per axis; 0: unknown', 'N',
          0.0, 1e6),
    _live('limits.torque', 0.0, 'Measuring range of the torque per axis; 0: unknown', 'N m', 0.0,
          1e5),
    _live('limits.accelerometer', 0.0, 'Measuring range of the accelerometer about zero, in its '
          'unit; 0: unknown', '', 0.0, 1e5),
    _live('tare.duration', 0.5, 'Averaging time of a tare at rest, at least 20 samples',
          's', 0.1, 10.0),
    _live('takeover.duration', 0.5, 'Fade-in time of a new calibration or setting',
          's', 0.01, 10.0),
    _live('stale_timeout', 0.5, 'Timeout after which /diagnostics reports a sensor stale', 's',
          0.01, 60.0),
)


def settings_of(value: Mapping[str, Any]) -> ObserverSettings:
    """
    Make settings of the values of all ``PARAMETERS``, by name.

    Raises
    ------
    ConfigError
        A value is out of range.
    """
    force, torque = value['limits.force'], value['limits.torque']
    name = value['gravity.filter']
    return replace(
        section_of(ObserverSettings, value, 'observer'),
        filter=value['observer.mode'] or None if name == 'none' else name,
        wrench_limit=((force or inf,) * 3 + (torque or inf,) * 3 if force or torque else None),
        accelerometer_limit=value['limits.accelerometer'] or None)


def file_of(tool: str) -> str:
    """Return the name among ``tools`` that the parameter ``tool`` names; empty: none."""
    return '' if tool == outputs.TRACKED else tool


def payload_settings_of(value: Mapping[str, Any]) -> PayloadSettings:
    """Make settings of the payload's tracking of the values of all ``PARAMETERS``, by name."""
    return PayloadSettings(
        floor=(value['payload.floor_force'], value['payload.floor_torque']),
        largest=value['payload.largest'] or None)


def accelerometer_for(calibration: Calibration, chosen: str) -> str:
    """
    Return which of ``ACCELEROMETERS`` a calibration needs, or ``none``.

    Raises
    ------
    ConfigError
        The chosen one has another unit than the calibration is for.
    """
    needed = calibration.accelerometer
    if needed is None or chosen == 'none':
        return 'none'
    if chosen == 'auto':
        return 'raw' if needed.unit == 'V' else 'imu'
    if inputs.ACCELEROMETERS[chosen][2] != needed.unit:
        raise ConfigError(
            f'accelerometer.source {chosen} is in {inputs.ACCELEROMETERS[chosen][2]}, the '
            f'calibration is for {needed.unit}; calibrate with the same sensor')
    return chosen


OPTIONAL_OUTPUTS = {'inertial_wrench': 'inertial', 'innovation': 'innovation'}
"""Topics that a parameter switches on, and the field of a sample that they carry."""


class CalibrationSource(NamedTuple):
    """A calibration, and the file or topic it was read from."""

    calibration: Calibration
    name: str


class Observer(runtime.ManagedNode):
    """Publishes the contact wrench of every wrench, as soon as it has a calibration."""

    def __init__(self) -> None:
        super().__init__('observer')
        runtime.declare(self, PARAMETERS, self._check_changes)
        self._chain = LiveObserver(self._value('tare.duration'), self._value('takeover.duration'))
        self._source: CalibrationSource | None = None
        self._text = ''
        self._failure = ''
        self._active = False
        self._accelerometer: Any = None
        self._mounting: Mounting | None = None
        self._pose = 'current_pose'
        self._frames: outputs.FrameOutputs | None = None
        self._markers: outputs.ContactMarkers | None = None
        self._transform: outputs.SensorTransform | None = None
        self._tool = outputs.ToolOnSensor(self, self._chain)
        self._received: dict[str, outputs.LastMessage] = {}
        self._inbox = Inbox(self, polled=self._value('poll_rate') > 0)
        self._origin: int | None = None
        self._waiting = runtime.Waiting(self)
        self.add_post_set_parameters_callback(self._on_changed)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT)
        if self._value('poll_rate') > 0:
            self.create_timer(1 / self._value('poll_rate'), self._inbox.drain, clock=STEADY)
        self.create_timer(1.0, self._report, clock=STEADY)
        for name, answer in (('tare', self._tare), ('reset', self._reset),
                             ('reload_calibration', self._reload)):
            self.create_service(Trigger, f'~/{name}', runtime.answering(answer))
        if self._value('autostart'):
            self._start()

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _start(self) -> None:
        self.trigger_configure()
        if self._failure:
            raise ConfigError(self._failure)
        self.trigger_activate()

    def destroy_node(self) -> None:
        """End the subscriptions, then the node."""
        self._inbox.close()
        super().destroy_node()  # type: ignore[no-untyped-call]

    # Lifecycle ------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the calibration where a file is given; create publishers and subscriptions."""
        self._failure = ''
        try:
            self._mounting, poses = inputs.mounting_parameter(self), inputs.pose_source(self)
            if self._value('publish.transform'):
                self._transform = outputs.SensorTransform(self, poses.topic)
            frames = Frames(self._value('publish.frames'), self._value('publish.frame_poses'))
            self._tool.configure(self._value('payload.track'))
            self._tool.use(self._value('tool') == outputs.TRACKED)
            if self._value('calibration.file') or file_of(self._value('tool')):
                self._take_over(self._load(file_of(self._value('tool'))))
        except ForcecalError as error:
            self._failure = with_id(error)
            self.get_logger().error(self._failure)
            self._release()
            return TransitionCallbackReturn.FAILURE
        self._out = self.create_lifecycle_publisher(WrenchStamped, '~/contact_wrench', OUTPUT)
        self._optional = [
            (field, self.create_lifecycle_publisher(WrenchStamped, f'~/{name}', OUTPUT))
            for name, field in OPTIONAL_OUTPUTS.items() if self._value(f'publish.{name}')]
        self._accuracy = self.create_lifecycle_publisher(Float64MultiArray, '~/accuracy', LATCHED)
        self._frames = outputs.FrameOutputs(self, frames)
        if self._value('publish.marker_rate') > 0:
            self._markers = outputs.ContactMarkers(self, self._value('publish.marker_rate'))
        wrench = inputs.plain_input('wrench', 'wrench', WrenchStamped)
        self._inputs = [self._subscribe(wrench, self._chain.on_wrench),
                        self._subscribe(poses, self._on_pose)]
        self._pose = poses.topic
        if poses.static is not None:
            self._inputs.append(poses.static)
        if joint := self._value('optidrive.joint'):
            self._inputs.append(self._subscribe(
                inputs.optidrive_input(joint), self._chain.on_displacement))
        if self._value('calibration.follow') or self._source is None:
            self._inputs.append(self.create_subscription(
                String, 'sequencer/calibration', self._on_calibration, LATCHED))
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to estimate and publish."""
        self._reset()
        self._tool.restart()
        self._active = True
        self.get_logger().info('up: publishes observer/contact_wrench for each wrench')
        answer = super().on_activate(state)
        self._tell_accuracy()
        return answer

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop estimating; the calibration stays."""
        self._active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release topics and calibration."""
        self._release()
        return TransitionCallbackReturn.SUCCESS

    on_shutdown = on_cleanup

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release all after an exception in a transition, which rclpy keeps to itself."""
        self.get_logger().error('a lifecycle transition failed; the observer is unconfigured')
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def _release(self) -> None:
        self._active = False
        for subscription in (*getattr(self, '_inputs', ()), self._accelerometer):
            if subscription is not None:
                self._inbox.unsubscribe(subscription)
        self.end_publishers()
        self._inputs, self._accelerometer = [], None
        self._markers = self._transform = self._source = None
        self._tool.release()
        self._chain.let_go()
        self._origin = None

    # Calibration ----------------------------------------------------------------------------

    def _load(self, tool: str) -> CalibrationSource:
        path = Path(self._value('calibration.file')).expanduser()
        if tool:
            if not self._value('tools') or Path(tool).name != tool:
                raise ConfigError(f'tool {tool} is not found; set tools to the folder of '
                                  'calibrations, and tool to a file name in it, without .yaml')
            path = Path(self._value('tools')).expanduser() / f'{tool}.yaml'
        calibration = load(path)
        if self._value('calibration.max_age') > 0:
            refuse_old(calibration, self._value('calibration.max_age') * DAY,
                       self.get_clock().now().nanoseconds * 1e-9, str(path))
        return CalibrationSource(calibration, str(path))

    def _parse(self) -> CalibrationSource:
        name = 'sequencer/calibration'
        return CalibrationSource(parse(self._text, name), name)

    def _on_calibration(self, message: String) -> None:
        self._text = message.data
        try:
            self._take_over(self._parse())
        except ForcecalError as error:
            self.get_logger().error(with_id(error, f'not used: {error}'))

    def _take_over(self, source: CalibrationSource, same_sensor: bool = False) -> None:
        """Use another calibration, faded in where one is in use; the same sensor keeps a bias."""
        calibration = source.calibration
        model = design(calibration, self._settings())
        if same_sensor and self._chain.model is not None:
            model = with_bias(model, self._chain.model.bias)
        accelerometer = accelerometer_for(calibration, self._value('accelerometer.source'))
        mounting = agreed(inputs.mounting_parameter(self), calibration, source.name)
        self._chain.take_over(model, calibration.wrench_sign, calibration.gravity_direction,
                              calibration.sensor_rotation)
        self._source, self._mounting = source, mounting
        self._tool.calibrated(calibration, payload_settings_of(
            runtime.values_of(self, PARAMETERS)))
        self._write = Writer(WrenchStamped, calibration.sensor_frame)
        self._subscribe_accelerometer(accelerometer)
        self._tell_accuracy()
        self.get_logger().info(f'calibration taken from {source.name}: mass '
                               f'{float(calibration.mass):.4f} kg')

    def _settings(self, changes: dict[str, Any] | None = None) -> ObserverSettings:
        return settings_of(runtime.values_of(self, PARAMETERS) | (changes or {}))

    def _check_changes(self, changes: dict[str, Any]) -> None:
        settings = self._settings(changes)
        source = self._source
        named = file_of(changes.get('tool', ''))
        if changes.get('tool', self._value('tool')) != self._value('tool') and (named or source):
            source = self._of_tool(named)
        if source is not None:
            design(source.calibration, settings)
            agreed(inputs.mounting_parameter(self), source.calibration, source.name)

    def _of_tool(self, tool: str) -> CalibrationSource:
        """Load the calibration of another tool, which has to be of the sensor that is in use."""
        source = self._named(tool)
        if self._source is not None:
            now, then = self._source.calibration, source.calibration
            if (now.sensor_frame, now.wrench_sign) != (then.sensor_frame, then.wrench_sign):
                raise ConfigError(
                    f'tool {tool}: {source.name} is for {then.sensor_frame!r} with sign '
                    f'{then.wrench_sign}, the calibration in use for {now.sensor_frame!r} with '
                    f'{now.wrench_sign}; calibrate both on one sensor')
            accelerometer_for(then, self._value('accelerometer.source'))
        return source

    def _on_changed(self, parameters: list[Any]) -> None:
        self._chain.window.seconds = self._value('tare.duration')
        self._chain.fade_duration = self._value('takeover.duration')
        if any(parameter.name == 'tool' for parameter in parameters):
            self._tool.use(self._value('tool') == outputs.TRACKED)
            named = file_of(self._value('tool'))
            if self._source is not None or (self._active and named):
                self._take_over(self._of_tool(named), same_sensor=True)
        elif self._source is not None and any(
                parameter.name.startswith(('observer.', 'limits.', 'gravity.'))
                for parameter in parameters):
            self._chain.take_settings(design(self._source.calibration, self._settings()))
            self._tool.apply()
            self._tell_accuracy()

    def _tell_accuracy(self) -> None:
        """Publish what is to be expected of the contact wrench, where it is estimated now."""
        if self._active and self._source is not None and self._chain.model is not None:
            found = accuracy(self._source.calibration, self._chain.model, self._settings())
            covariance = np.full((6, 6), np.nan) if found is None else found.covariance
            self._accuracy.publish(matrix_message(
                covariance, *2 * ['force x, y, z [N], torque x, y, z [N m]']))
            if self._markers is not None:
                self._markers.covariance = covariance

    def _subscribe_accelerometer(self, chosen: str) -> None:
        one, _ = inputs.accelerometer_input(chosen)
        if self._accelerometer is not None:
            if one is not None and self._accelerometer.topic_name.endswith(f'/{one.topic}'):
                return
            self._inbox.unsubscribe(self._accelerometer)
            self._accelerometer = None
        if one is not None:
            self._accelerometer = self._subscribe(one, self._chain.on_accelerometer)

    # Samples --------------------------------------------------------------------------------

    def _subscribe(self, one: inputs.Input, take: Callable[[float, Values], Samples]) -> Any:
        """Pass the samples of a topic to the chain, and publish the estimates they complete."""
        topic = one.topic

        def use(sample: Sample) -> None:
            if not self._active or self._chain.model is None:
                return
            self._received[topic] = outputs.LastMessage(STEADY.now().nanoseconds, sample.frame)
            if self._origin is None:
                self._origin = sample.stamp_ns
            for estimate in take((sample.stamp_ns - self._origin) * 1e-9, sample.values):
                self._publish(estimate)
            self._tool.tell()

        return self._inbox.subscribe(one.message_type, topic, one.taker(use))

    def _on_pose(self, t: float, values: Values) -> Samples:
        assert self._frames is not None
        values = combine(values, self._mounting) if self._mounting else values
        frame = self._received[self._pose].frame
        self._frames.on_pose(t, values, frame)
        if self._transform is not None and self._source is not None and self._origin is not None:
            self._transform.publish(self._origin + round(t * 1e9), values, frame,
                                    self._source.calibration.sensor_frame)
        return self._chain.on_pose(t, values)

    def _publish(self, sample: ContactSample) -> None:
        assert self._origin is not None and self._chain.model is not None
        assert self._frames is not None
        stamp = self._origin + round(sample.t * 1e9)
        self._out.publish(self._write(stamp, sample.contact))
        if not sample.status & INVALID:
            for field, publisher in self._optional:
                publisher.publish(self._write(stamp, getattr(sample, field)))
        self._frames.publish(stamp, sample.t, sample.contact, self._chain.model.pose_timeout)
        if self._markers is not None and self._source is not None:
            self._markers.publish(stamp, sample.contact, self._source.calibration.sensor_frame)

    # Services -------------------------------------------------------------------------------

    def _tare(self) -> str:
        model = self._chain.model
        if model is None or self._source is None:
            raise DataError('there is no calibration yet; run the sequencer')
        if 'wrench' in self._silent() or 'wrench' not in self._received:
            raise DataError('wrench: nothing received; start its driver')
        result = self._chain.tare(model, noise_levels(self._source.calibration.noise))
        shift = ', '.join(f'{x:.3f}' for x in result.shift)
        return f'bias shifted by {shift} (N, N m) until the next calibration'

    def _reset(self) -> str:
        self._chain.reset()
        if self._frames is not None:
            self._frames.forget()
        self._origin = None
        return 'the filter is restarted'

    def _reload(self) -> str:
        source = self._named(file_of(self._value('tool')))
        self._take_over(source)
        return f'calibration taken from {source.name}'

    def _named(self, tool: str) -> CalibrationSource:
        """Return the calibration of a tool; of none, the one that is configured or published."""
        if tool or self._value('calibration.file'):
            return self._load(tool)
        if self._text:
            return self._parse()
        raise DataError('no calibration to reload: calibration.file is empty and nothing was '
                        'received on sequencer/calibration')

    # Diagnostics ----------------------------------------------------------------------------

    def _missing(self) -> str:
        """Return what estimates wait for: a calibration, or topics; empty: nothing."""
        if not self._active:
            return ''
        if self._source is None:
            return 'a calibration, from calibration.file or sequencer/calibration'
        silent = self._silent()
        return ' and '.join(topic for topic in ('wrench', self._pose)
                            if topic in silent or topic not in self._received)

    def _silent(self) -> list[str]:
        """Return the topics that have fallen silent."""
        oldest = STEADY.now().nanoseconds - self._value('stale_timeout') * 1e9
        return [topic for topic, received in self._received.items() if received.steady_ns < oldest]

    def _report(self) -> None:
        self._waiting.of(self._missing())
        count, status = self._chain.report()
        if self._accelerometer is None:  # none is configured
            status &= ~NO_ACCELEROMETER
        values = {'estimates a second': count,
                  'calibration': self._source.name if self._source else 'none'}
        for topic, refused in zip(('wrench', 'accelerometer', 'pose', 'optidrive'),
                                  self._chain.refused):
            values[f'{topic} samples not used'] = refused
        calibrated = self._source.calibration.sensor_frame if self._source else None
        if self._chain.bandwidth == self._chain.bandwidth:
            values['bandwidth [Hz]'] = self._chain.bandwidth
            values['noise over calibrated'] = self._chain.noise_level
        of_tool, warning = self._tool.report()
        self._diagnostics.publish(runtime.diagnostic_array(self, '', *outputs.health(
            self._active, calibrated, self._received, self._silent(), status,
            [warning] if warning else []), values | of_tool))


main = partial(runtime.run, 'observer', Observer, PARAMETERS)
"""Runs the node; takes the arguments, by default those of the process, and returns the status."""


if __name__ == '__main__':
    raise SystemExit(main())
