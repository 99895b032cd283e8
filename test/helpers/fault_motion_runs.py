"""One fault in one phase over DDS: simulated rig, sequencer and observer as processes."""

from dataclasses import dataclass
import signal

from forcecal_ros.core.geometry import rotation_about
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import WatchSettings
from forcecal_ros.motion.profiles import flatten_poses, nominal_poses, Pose
from forcecal_ros.nodes.runtime import OUTPUT
from geometry_msgs.msg import PoseStamped
from live import Live, ON_RIG_TIME, RIG_TIME, speeds
import numpy as np

CALIBRATE = ('move', 'settle', 'measure', 'step')
CONTACT = ('approach', 'contact', 'retract')
PHASES = (*CALIBRATE, *CONTACT)

STOP = 0.1
"""Commands may move for that long after a fault [s]."""

PERIOD = 0.004
ONE_SECOND = 250
"""Poses, or commands."""

PROMPT = {'delayed': ('watch__pause_timeout', WatchSettings().pause_timeout),
          'to sim': ('watch__clock_timeout', 1.0)}
"""Where patience is not the point: what is late pauses at once, a clock that is gone is not waited
for."""

TRIES = 10
LIMITS = Limits(workspace_max=[1.35, 0.4, 1.4])

SENSORS = ('wrench', 'accelerometer', 'pose')
KINDS = ('off', 'stuck', 'garbage', 'wrong', 'slow', 'delayed', 'intermittent')
SIGNALS = {'SIGINT': signal.SIGINT, 'SIGTERM': signal.SIGTERM, 'SIGKILL': signal.SIGKILL}
NODES = ('sequencer', 'sim', 'observer')
SECOND, FOREIGN, ABORT = 'second sequencer', 'foreign commands', 'sequencer/abort'

FAULTS = (
    *(f'{sensor} {kind}' for sensor in SENSORS for kind in KINDS),
    'robot stuck', 'robot runaway', 'clock stopped', 'clock forward', 'clock back',
    *(f'{name} to {node}' for node in NODES for name in SIGNALS), SECOND, FOREIGN, ABORT)

HARMLESS = {
    'wrench wrong', 'wrench slow', 'accelerometer wrong', 'accelerometer slow',
    'SIGINT to observer', 'SIGTERM to observer', 'SIGKILL to observer', SECOND}
"""Faults that the motion need not end for: nothing leaves the limits."""

GRADUAL = {'robot stuck'}
"""Faults that end the motion only once it is off by the limits on tracking."""

RECOVERING = {'pose slow', *(f'{sensor} intermittent' for sensor in SENSORS)}
"""Faults that come and go: the motion stands each time, and ends when that is too often."""


@dataclass(frozen=True)
class Outcome:
    """
    What one fault in one phase came to.

    Attributes
    ----------
    fault, phase : str
    end : str
        ``stopped``, ``went on``, or ``FAILED: why``.
    moving : float
        How long commands moved after the fault [s].
    reason : str
        What the sequencer said.
    """

    fault: str
    phase: str
    end: str
    moving: float
    reason: str

    @property
    def survived(self):
        return not self.end.startswith('FAILED')


def quick_poses():
    """Home and a pose 20 degrees from it, so that every phase comes soon."""
    home = nominal_poses()['v']
    tilted = Pose(home.position, home.R_base_sensor @ rotation_about('y', np.radians(20)))
    return flatten_poses({'v': home, 'tilt': tilted})


class Bench:
    """
    Nodes that are made anew where a fault has damaged them.

    Parameters
    ----------
    clock : bool
        Whether the sim's clock drives all.
    patient : bool
        Whether that clock waits for commands that a busy machine makes late.
    """

    def __init__(self, clock=False, patient=False):
        self.clock, self.patient = clock, patient
        self.live = Live()
        self.commands, self.poses = [], []
        self.other = None
        self.live.hear(PoseStamped, 'target_frame', self._on_command)
        self.live.hear(PoseStamped, 'current_pose', lambda *sample: self.poses.append(sample))

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.live.__exit__(*error)

    def _on_command(self, stamp, values):
        if stamp:
            self.commands.append((stamp, values))

    def run(self, fault, phase):
        """Let one fault happen in one phase, and return what it came to."""
        prompt = {name: value for end, (name, value) in PROMPT.items()
                  if self.patient and fault.endswith(end)}
        self._heal(fault)
        if prompt:
            assert all(one.successful for one in self.live.set('sequencer', **prompt))
        self._begin(phase)
        recover, first = self._inject(fault)
        outcome = self._judge(fault, phase, first)
        if prompt:
            self.live.set('sequencer', **{name: ON_RIG_TIME[name] for name in prompt})
        recover()
        return outcome

    def tried(self, fault, phase):
        """Run it; what could not be brought about is an outcome too."""
        try:
            return self.run(fault, phase)
        except AssertionError as error:
            return Outcome(fault, phase, f'FAILED: {str(error)[:60]}', 0.0, '')

    # Before the fault -----------------------------------------------------------------------

    def _heal(self, fault):
        """Start what is not there, and wait for an idle sequencer and a robot that stands."""
        live = self.live
        gone = [module for module in NODES if module not in live.processes]
        for module in gone:
            live.diagnostics.pop(module, None)
            self._start(module)
        if 'observer' in gone:  # a signal that meets a node's imports is nobody's
            live.until(lambda: 'observer' in live.diagnostics, 'an observer')
        if 'sequencer' in gone:
            for service in [*live.clients]:
                live.node.destroy_client(live.clients.pop(service))
            live.phases.clear()
            live.until(lambda: live.phases, 'a new sequencer')
            live.spin(1.0)
        if fault == SECOND and SECOND not in live.processes:
            self._start_sequencer(SECOND, ['__node:=second'])
        if fault == SECOND:  # known before the motion begins, which it is to disturb
            live.client('second/start')
        if fault == FOREIGN and self.other is None:  # known to all before the motion begins
            self.other = live.node.create_publisher(PoseStamped, 'target_frame', OUTPUT)
            live.until(lambda: self.other.get_subscription_count() >= 3, 'discovery')
            live.spin(1.0)
        self.poses.clear()
        live.until(lambda: len(self.poses) > 100, 'a simulated rig')

    def _start(self, module):
        if module == 'sim':
            self.live.start('sim', seed=1, **(RIG_TIME if self.patient else {
                'clock__publish': self.clock}))
        elif module == 'sequencer':
            self._start_sequencer('sequencer', [])
        else:
            self.live.start(module, use_sim_time=self.clock)

    def _start_sequencer(self, name, remap):
        self.live.start(
            'sequencer', name, remap, timing__measure=0.4, timing__ring=0.25, settle__window=0.1,
            timing__approach=1.0, timing__contact=0.6, poses__names='[v, tilt]',
            poses__values=quick_poses(), limits__workspace_max=LIMITS.workspace_max.tolist(),
            **(ON_RIG_TIME if self.patient else {'use_sim_time': self.clock,
                                                 'watch__lost_timeout': 0.6,
                                                 'watch__most_pauses': 5}))

    def _begin(self, phase):
        """Reach the phase; a machine that is too busy for healthy sensors gets more chances."""
        for _ in range(TRIES):
            if self._reached(phase):
                return
        raise AssertionError(f'{phase} was not reached: {self.live.reasons}')

    def _reached(self, phase):
        live = self.live
        name = 'contact' if phase in CONTACT else 'calibrate'
        assert live.set('sequencer', sequence=name)[0].successful
        live.phases.clear()
        live.until(lambda: live.call('sequencer/start').success, 'start')
        live.phases.clear()
        live.reasons.clear()
        self.commands.clear()
        live.until(lambda: {phase, 'aborted'} & {*live.phases}, phase)
        if phase not in ('settle', 'measure', 'contact'):
            live.until(lambda: self.moving(-12).all() or 'aborted' in live.phases, 'motion')
        return 'aborted' not in live.phases

    def moving(self, first=0):
        """Whether each command differs from the one before."""
        if len(self.commands[first:]) < 2:
            return np.zeros(1, dtype=bool)
        values = np.array([values for _, values in self.commands[first:]])
        return (np.abs(np.diff(values, axis=0)) > 1e-9).any(axis=1)

    # The fault ------------------------------------------------------------------------------

    def _inject(self, fault):
        """Let it happen; return how to recover, and which command was the next to be heard."""
        live = self.live
        part, _, kind = fault.partition(' ')
        if part in (*SENSORS, 'robot', 'clock'):
            assert live.set('sim', **{f'fault__{part}': kind})[0].successful
            first = len(self.commands)
            if part in SENSORS or kind == 'stopped':
                return lambda: live.set('sim', **{f'fault__{part}': 'none'}), first
            return lambda: self._kill('sim'), first
        if part in SIGNALS:
            process = live.processes.pop(kind.removeprefix('to '))
            process.send_signal(SIGNALS[part])
            if kind != 'to sim':
                return process.wait, len(self.commands)
            while process.poll() is None:  # it goes on for a while: its last pose tells how long
                live.spin()
            last = self.poses[-1][0]
            return process.wait, sum(stamp <= last for stamp, _ in self.commands)
        if fault == FOREIGN:
            self.other.publish(PoseStamped())
            return lambda: None, len(self.commands)
        service = {SECOND: 'second/start', ABORT: 'sequencer/abort'}[fault]
        started = live.call(service).success
        assert started or fault == SECOND
        return lambda: None, len(self.commands)

    def _kill(self, module):
        process = self.live.processes.pop(module)
        process.kill()
        process.wait()

    # After the fault ------------------------------------------------------------------------

    def _judge(self, fault, phase, first):
        live = self.live
        killed = fault == 'SIGKILL to sequencer'
        if fault in HARMLESS or killed:
            heard = len(self.poses)
            live.until(lambda: len(self.poses) > heard + ONE_SECOND, 'a second of the rig')
        else:
            live.until(lambda: live.phases[-1] in ('aborted', 'done'), f'{fault} in {phase}')
            live.spin(0.3)
        end, moving = self._verdict(fault, first)
        reason = live.reasons[-1] if live.reasons else ''
        if live.phases[-1] != 'aborted' and not killed:
            live.call('sequencer/abort')
            live.spin(0.3)
        return Outcome(fault, phase, end, moving, reason)

    def _verdict(self, fault, first):
        """Return how it ended, and how long commands moved after the fault [s]."""
        moving = self.moving(max(first - 1, 0))
        total = float(moving.sum() * PERIOD)
        _, speed, spin = speeds(self.commands)
        if speed.max() > LIMITS.speed or spin.max() > LIMITS.angular_speed:
            return 'FAILED: commands jumped', total
        if fault in HARMLESS | GRADUAL | RECOVERING and self.live.phases[-1] != 'aborted':
            return 'went on', total
        if fault not in RECOVERING | GRADUAL | HARMLESS:
            if total > STOP:
                return f'FAILED: moved for {total:.3f} s', total
            if np.count_nonzero(np.diff(moving.astype(int)) == 1):
                return 'FAILED: moved again', total
        if moving[-10:].any() and fault != 'SIGKILL to sequencer':
            return 'FAILED: no rest', total
        if self.live.phases[-1] != 'aborted' and fault != 'SIGKILL to sequencer':
            return f'FAILED: {self.live.phases[-1]}', total
        return 'stopped', total
