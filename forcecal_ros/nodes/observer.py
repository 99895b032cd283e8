"""The contact-force observer as a lifecycle node around its one pure step."""

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from struct import error as StructError
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.calibration.file import DAY, load, parse, refuse_old
from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import ConfigError, DataError, ForcecalError
from forcecal_ros.gravity.compensation import compensated, Compensation, compensation_of, rebiased
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.observer_settings import PARAMETERS, settings_of
from forcecal_ros.nodes.parameters import declare
from forcecal_ros.nodes.reporting import diagnostic_array
from forcecal_ros.nodes.runtime import LATCHED, OUTPUT, run, SECOND, STEADY
from forcecal_ros.nodes.sensors import ACCELEROMETERS
from forcecal_ros.nodes.wire import frame_of, JointReader, Reader, Writer
from forcecal_ros.observe import (
    ContactSample,
    describe,
    design,
    level,
    Model,
    noise_levels,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    Settings,
    State,
    tare,
    with_bias,
)
from forcecal_ros.observe.fade import begin_fade, Fade, faded, rebased
from forcecal_ros.observe.rest import refuse_motion
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

EXTRA = {'inertial_wrench': ContactSample._fields.index('inertial'),
         'innovation': ContactSample._fields.index('innovation')}
"""Topics published when asked for, and which part of an estimate they carry."""


class Source(NamedTuple):
    """One calibration and where it came from."""

    calibration: Calibration
    name: str


class Observer(LifecycleNode):
    """Publishes the contact wrench of every wrench it hears, as soon as it has a calibration."""

    def __init__(self) -> None:
        super().__init__('observer')
        declare(self, PARAMETERS, self._check_changes)
        self._source: Source | None = None
        self._text = ''
        self._model: Model | None = None
        self._gravity: Compensation | None = None
        self._failure = ''
        self._active = False
        self._accelerometer: Any = None
        self._heard: dict[str, int] = {}
        self._frames: dict[str, str] = {}
        self._inbox = Inbox(self, polled=self._value('poll_rate') > 0)
        self._clear()
        self.add_post_set_parameters_callback(self._on_changed)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT)
        if self._value('poll_rate') > 0:
            self.create_timer(1 / self._value('poll_rate'), self._inbox.drain, clock=STEADY)
        self.create_timer(1.0, self._report, clock=STEADY)
        for name, answer in (('tare', self._tare), ('reset', self._reset),
                             ('reload_calibration', self._reload)):
            self.create_service(Trigger, f'observer/{name}', _service(answer))
        if self._value('autostart'):
            self._start()

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _clear(self) -> None:
        """Forget all samples."""
        self._state = State()
        self._origin: int | None = None
        self._last: ContactSample | None = None
        self._shown = (0.0,) * 6
        self._fade: Fade | None = None
        self._changed = False
        self._status = 0
        self._count = 0
        self._recent: deque[ContactSample] = deque()
        self._poses: deque[tuple[float, tuple[float, ...]]] = deque()
        self._window = self._value('tare.duration')

    def _start(self) -> None:
        self.trigger_configure()
        if self._failure:
            raise ConfigError(self._failure)
        self.trigger_activate()

    def destroy_node(self) -> None:
        """Free what the node holds."""
        self._inbox.close()
        super().destroy_node()

    # Lifecycle ------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the calibration where a file is given, and get ready to hear and to speak."""
        self._failure = ''
        try:
            if self._value('calibration.file'):
                self._load()
        except ForcecalError as error:
            self._failure = str(error)
            self.get_logger().error(self._failure)
            return TransitionCallbackReturn.FAILURE
        self._out = self.create_lifecycle_publisher(
            WrenchStamped, 'observer/contact_wrench', OUTPUT)
        self._extra = []
        for name in EXTRA:
            if self._value(f'publish.{name}'):
                self._extra.append((EXTRA[name], self.create_lifecycle_publisher(
                    WrenchStamped, f'observer/{name}', OUTPUT)))
        self._inputs = [
            self._hear('wrench', WrenchStamped, self._on_wrench),
            self._hear('current_pose', PoseStamped, self._on_pose)]
        if self._value('optidrive.joint'):
            self._inputs.append(self._hear('optidrive', JointState, self._on_optidrive))
        if self._value('calibration.follow') or self._source is None:
            self._inputs.append(self.create_subscription(
                String, 'sequencer/calibration', self._on_calibration, LATCHED))
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to estimate."""
        self._clear()
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Cease to estimate; the calibration stays."""
        self._active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of topics and calibration."""
        self._let_go()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of everything."""
        self._let_go()
        return TransitionCallbackReturn.SUCCESS

    def _let_go(self) -> None:
        self._active = False
        for subscription in (*getattr(self, '_inputs', ()), self._accelerometer):
            if subscription is not None:
                self._inbox.unsubscribe(subscription)
        publishers = [publisher for _, publisher in getattr(self, '_extra', ())]
        if hasattr(self, '_out'):
            publishers.append(self._out)
        for publisher in publishers:
            self.destroy_lifecycle_publisher(publisher)
        self._inputs, self._extra, self._accelerometer = [], [], None
        del self._out
        self._source = self._model = self._gravity = None
        self._clear()

    # Calibration ----------------------------------------------------------------------------

    def _load(self) -> None:
        path = Path(self._value('calibration.file')).expanduser()
        calibration = load(path)
        if self._value('calibration.max_age') > 0:
            refuse_old(calibration, self._value('calibration.max_age') * DAY,
                       self.get_clock().now().nanoseconds * 1e-9, str(path))
        self._take(Source(calibration, str(path)))

    def _on_calibration(self, message: String) -> None:
        self._text = message.data
        try:
            self._take(Source(parse(message.data, 'sequencer/calibration'),
                              'sequencer/calibration'))
        except ForcecalError as error:
            self.get_logger().error(f'not taken over: {error}')
            return

    def _take(self, source: Source) -> None:
        """Take over a calibration, faded in where one was in use."""
        model, chosen = design(source.calibration, self._settings()), self._chosen(source)
        gravity = self._gravity_of(source.calibration)
        self._set_model(model)
        self._source, self._gravity = source, gravity
        self._sign = source.calibration.wrench_sign
        self._write = Writer(WrenchStamped, source.calibration.sensor_frame)
        self._listen_to_accelerometer(chosen)
        self.get_logger().info(f'calibration taken from {source.name}: mass '
                               f'{float(source.calibration.mass):.4f} kg')

    def _gravity_of(self, calibration: Calibration, changes: dict[str, Any] | None = None
                    ) -> Compensation | None:
        """Return the filter that publishes instead of the observer, where one is asked for."""
        name = (changes or {}).get('gravity.filter', self._value('gravity.filter'))
        if name == 'none':
            return None
        return compensation_of(calibration, name, self._settings(changes))

    def _set_model(self, model: Model) -> None:
        self._changed = self._model is not None and self._last is not None
        self._model = model

    def _settings(self, changes: dict[str, Any] | None = None) -> Settings:
        return settings_of({row.name: self._value(row.name) for row in PARAMETERS}
                           | (changes or {}))

    def _check_changes(self, changes: dict[str, Any]) -> None:
        settings = self._settings(changes)
        if self._source is not None:
            design(self._source.calibration, settings)
            self._gravity_of(self._source.calibration, changes)

    def _on_changed(self, parameters: list[Any]) -> None:
        self._window = self._value('tare.duration')
        if self._source is not None and any(
                parameter.name.startswith(('observer.', 'limits.', 'gravity.'))
                for parameter in parameters):
            bias = self._model.bias
            self._set_model(design(self._source.calibration, self._settings())
                            ._replace(bias=bias))
            self._gravity = rebiased(self._gravity_of(self._source.calibration), bias)

    def _chosen(self, source: Source) -> str:
        """Return which source of acceleration fits a calibration."""
        wanted = source.calibration.accelerometer
        chosen = self._value('accelerometer.source')
        if wanted is None or chosen == 'none':
            return 'none'
        if chosen == 'auto':
            return 'raw' if wanted.unit == 'V' else 'imu'
        if ACCELEROMETERS[chosen][2] != wanted.unit:
            raise ConfigError(
                f'accelerometer.source {chosen} speaks {ACCELEROMETERS[chosen][2]}, the '
                f'calibration is for {wanted.unit}; calibrate with the same sensor')
        return str(chosen)

    def _listen_to_accelerometer(self, chosen: str) -> None:
        topic, message_type, _ = ACCELEROMETERS.get(chosen, ('', None, ''))
        if self._accelerometer is not None:
            if self._accelerometer.topic_name.endswith(f'/{topic}') and topic:
                return
            self._inbox.unsubscribe(self._accelerometer)
            self._accelerometer = None
        if topic:
            self._accelerometer = self._hear(topic, message_type, self._on_accelerometer)

    # Samples --------------------------------------------------------------------------------

    def _hear(self, topic: str, message_type: Any,
              take: Callable[[float, tuple[float, ...]], tuple[State, Any]]) -> Any:
        """Subscribe; ``take`` makes a new state and estimates of time and values."""
        if message_type is JointState:
            read: Any = JointReader(self._value('optidrive.joint'))
        else:
            read = Reader(message_type)

        def on_sample(raw: bytes) -> None:
            if not self._active or self._model is None:
                return
            try:
                sample = read(raw)
            except StructError:
                return
            if sample is None:
                return
            stamp_ns, values = sample
            if topic not in self._heard:
                self._frames[topic] = frame_of(raw)
            self._heard[topic] = STEADY.now().nanoseconds
            if self._origin is None:
                self._origin = stamp_ns
            self._state, estimates = take((stamp_ns - self._origin) * 1e-9, values)
            for estimate in estimates:
                self._publish(estimate)

        return self._inbox.subscribe(message_type, topic, on_sample)

    def _on_wrench(self, t: float, values: tuple[float, ...]) -> Any:
        if self._sign < 0:
            a, b, c, d, e, f = values
            values = (-a, -b, -c, -d, -e, -f)
        return on_wrench(self._state, t, values, self._model)

    def _on_accelerometer(self, t: float, values: tuple[float, ...]) -> Any:
        return on_accelerometer(self._state, t, values, self._model)

    def _on_pose(self, t: float, values: tuple[float, ...]) -> Any:
        self._poses.append((t, values))
        while not t - self._poses[0][0] <= self._window:
            self._poses.popleft()
        return on_pose(self._state, t, values[:3], values[3:], self._model)

    def _on_optidrive(self, t: float, values: tuple[float, ...]) -> Any:
        return on_displacement(self._state, t, values[0], self._model)

    def _publish(self, sample: ContactSample) -> None:
        if self._changed and self._last is not None:
            before, self._changed = self._shown, False
            self._state, sample = rebased(self._state, self._last, sample)
            self._fade = begin_fade(sample.t, self._value('takeover.duration'), before,
                                    sample.contact)
        contact = sample.contact
        if self._gravity is not None:
            self._gravity, contact = compensated(self._gravity, sample,
                                                 self._state.motion.rotation)
        if self._fade is not None:
            smooth = faded(self._fade, sample.t, contact)
            if smooth is None:
                self._fade = None
            else:
                contact = smooth
        stamp = self._origin + round(sample.t * 1e9)
        self._out.publish(self._write(stamp, contact))
        for field, publisher in self._extra:
            publisher.publish(self._write(stamp, sample[field]))
        self._last, self._shown = sample, contact
        self._recent.append(sample)
        while not sample.t - self._recent[0].t <= self._window:
            self._recent.popleft()
        self._status |= sample.status
        self._count += 1

    # Services -------------------------------------------------------------------------------

    def _require_model(self) -> tuple[Model, Source]:
        if self._model is None or self._source is None:
            raise DataError('there is no calibration yet; give calibration.file or run the '
                            'sequencer')
        return self._model, self._source

    def _tare(self) -> str:
        model, source = self._require_model()
        seconds = self._value('tare.duration')
        newest = self._recent[-1].t if self._recent else 0.0
        self._refuse_stale('wrench')
        refuse_motion([pose for t, pose in self._poses if newest - seconds <= t], 'tare')
        result = tare(tuple(self._recent), model, noise_levels(source.calibration.noise), seconds)
        self._model = with_bias(model, result.bias)
        self._gravity = rebiased(self._gravity, result.bias)
        self._recent.clear()
        shift = ', '.join(f'{x:.3f}' for x in result.shift)
        return f'bias shifted by {shift} (N, N m) until the next calibration'

    def _refuse_stale(self, topic: str) -> None:
        silent = (STEADY.now().nanoseconds - self._heard.get(topic, 0)) / SECOND
        if silent > self._value('stale_timeout'):
            raise DataError(f'{topic}: nothing received; is its driver running?')

    def _reset(self) -> str:
        self._clear()
        return 'the filter starts anew'

    def _reload(self) -> str:
        if self._value('calibration.file'):
            self._load()
        elif self._text:
            self._take(Source(parse(self._text, 'sequencer/calibration'),
                              'sequencer/calibration'))
        else:
            raise DataError('no calibration to reload: calibration.file is empty and nothing was '
                            'received on sequencer/calibration')
        return f'calibration taken from {self._source.name}'

    # Diagnostics ----------------------------------------------------------------------------

    def _report(self) -> None:
        now = STEADY.now().nanoseconds
        silent = [topic for topic, heard in self._heard.items()
                  if now - heard > self._value('stale_timeout') * SECOND]
        values = {'estimates a second': self._count,
                  'calibration': self._source.name if self._source else 'none'}
        for topic, dropped in zip(('wrench', 'accelerometer', 'pose', 'optidrive'),
                                  self._state.refusals.counts):
            values[f'{topic} samples not used'] = dropped
        self._diagnostics.publish(diagnostic_array(
            self, '', *self._verdict(silent), values))
        self._status, self._count = 0, 0

    def _verdict(self, silent: list[str]) -> tuple[str, str]:
        """Return level and message."""
        if not self._active:
            return 'stale', 'not active'
        if self._model is None:
            return 'warn', 'waiting for a calibration'
        if 'wrench' in silent or 'wrench' not in self._heard:
            return 'error', 'wrench: nothing received'
        sentences = [f'{topic}: nothing received' for topic in silent]
        sentences += describe(self._status)
        frame, calibrated = self._frames['wrench'], self._source.calibration.sensor_frame
        if frame and frame != calibrated:
            sentences.append(f'wrench is of {frame!r}, the calibration of {calibrated!r}: is it '
                             'the same sensor?')
        grade = level(self._status)
        if len(sentences) > len(describe(self._status)) and grade == 'ok':
            grade = 'warn'
        return grade, '; '.join(sentences) or 'estimating'


def _service(answer: Callable[[], str]) -> Callable[..., Trigger.Response]:
    """Turn a function that returns a sentence, or raises, into a Trigger service."""
    def on_request(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = answer(), True
        except ForcecalError as error:
            response.message, response.success = str(error), False
        return response

    return on_request


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('observer', Observer, arguments)


if __name__ == '__main__':
    raise SystemExit(main())
