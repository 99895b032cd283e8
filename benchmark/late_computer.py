"""A sound rig, a sequencer and the wire between them on a computer that is late, without DDS.

The sequencer's own state machine, watch and stream run against the simulated rig, an event after
another on one seeded clock: commands come late, stamps jitter, streams pause, and both processes
are kept waiting as they are where others compete for the processor.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.core.geometry import matrix_from_quaternion, quaternion_of
from forcecal_ros.core.streams import Recording
from forcecal_ros.motion.monitor import Monitor
from forcecal_ros.motion.plan import check_wrench, prepare, SEQUENCES
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.motion.sequence import MotionSequence, next_in_phase, StreamClock
from forcecal_ros.nodes.collector import Collector
from forcecal_ros.nodes.demo import FOR_SIMULATION
from forcecal_ros.nodes.motion_node import Guard
from forcecal_ros.nodes.sequencer import PARAMETERS, settings_of
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import CommandSchedule, Simulator
import numpy as np

TICK = 4_000_000
SECOND = 10**9
START = 3 * SECOND
LONGEST = 90 * SECOND
LOOK = 5


@dataclass(frozen=True)
class Conditions:
    """
    What is late in one run.

    Attributes
    ----------
    latency : float
        Of every command [s].
    stall : float
        The wire holds all commands back for up to that long, every few seconds [s].
    jitter : float
        Stamps of the sensors are off by up to that much [s].
    pause : float
        One stream misses the samples of that long, three times [s].
    load : int
        Busy processes a core beside the two.
    """

    latency: float = 0.0
    stall: float = 0.0
    jitter: float = 0.0
    pause: float = 0.0
    load: int = 0


@dataclass(frozen=True)
class Outcome:
    """What a run came to: why it was aborted, else its recording."""

    conditions: Conditions
    aborted: str
    recording: Recording | None


def drawn(rng: np.random.Generator) -> Conditions:
    """Draw what is late: commands by up to 0.5 s, stamps by 3 ms, one stream misses 50 ms."""
    held = rng.random() < 0.5
    return Conditions(
        latency=0.0 if held else rng.uniform(0.0, 0.5),
        stall=rng.uniform(0.05, 0.5) if held else 0.0,
        jitter=rng.choice([0.0, rng.uniform(0.0, 3e-3)]),
        pause=rng.choice([0.0, rng.uniform(0.0, 0.05)]), load=int(rng.integers(0, 3)))


def waits(rng: np.random.Generator, load: int) -> np.ndarray:
    """
    Stretches in which a process waits for the processor, (n, 2) [ns].

    Measured for a process of 250 Hz beside one and two busy ones a core: it waits some four
    times a second for each of them, 12 ms on average.
    """
    return stretches(rng, 4.0 * load, lambda n: np.minimum(rng.exponential(0.012, n), 0.2))


def stretches(rng, rate, lengths) -> np.ndarray:
    """Draw stretches that begin so many times a second [1/s], (n, 2) [ns]."""
    n = rng.poisson(rate * LONGEST / SECOND)
    begin = np.sort(rng.uniform(0.0, LONGEST, n))
    return np.column_stack([begin, begin + SECOND * lengths(n)])


def within(spans: np.ndarray, now: int) -> bool:
    """Tell whether an instant lies in one of the stretches."""
    i = np.searchsorted(spans[:, 0], now, side='right')
    return bool((spans[:i, 1] > now).any())


class Rig:
    """The robot's side: takes commands as they arrive, says what its sensors say."""

    def __init__(self, conditions: Conditions, rng: np.random.Generator, accelerometer: str,
                 seed: int) -> None:
        self.rig = load_rig()
        self.simulator = Simulator(self.rig, accelerometer, seed)
        self.schedule = CommandSchedule(TICK, 0)
        self._conditions, self._rng = conditions, rng
        self._waits = waits(rng, conditions.load)
        self._held = stretches(rng, 0.25, lambda n: rng.uniform(0.2, 1.0, n) * conditions.stall)
        self._wire: list[tuple[int, int, tuple]] = []
        self._arrival, self._period = 0, 0

    def send(self, now: int, stamp: int, pose: tuple) -> None:
        """Put a command on the wire; commands stay in their order."""
        arrival = now + round(self._conditions.latency * SECOND)
        for begin, end in self._held[:np.searchsorted(self._held[:, 0], arrival)]:
            arrival = max(arrival, round(end)) if begin <= arrival < end else arrival
        self._arrival = max(self._arrival, arrival)
        self._wire.append((self._arrival, stamp, pose))

    def said(self, now: int) -> list[tuple[str, int, tuple]]:
        """Advance to an instant; returns channel, stamp and values of the samples since."""
        said: list[tuple[str, int, tuple]] = []
        if within(self._waits, now):
            return said
        while self._wire and self._wire[0][0] <= now:
            _, stamp, pose = self._wire.pop(0)
            self.schedule.add(stamp, now, self._period, pose)
        while (self._period + 1) * TICK <= now:
            command = self.schedule.take(self._period)
            if command is not None:
                self.simulator.command(command[:3], matrix_from_quaternion(np.array(command[3:])))
            s = self.simulator.advance()
            self._period += 1
            poses = [(*p, *quaternion_of(R)) for p, R in zip(s.position, s.R_base_sensor)]
            for name, t, rows in (('wrench', s.wrench_t, s.wrench),
                                  ('accelerometer', s.accelerometer_t, s.volts),
                                  ('optidrive', s.optidrive_t, s.optidrive[:, None]),
                                  ('pose', s.pose_t, poses)):
                said += [(name, round(x * SECOND), tuple(map(float, row)))
                         for x, row in zip(t, rows)]
        return said


class Wire:
    """What becomes of the samples on their way: stamps that jitter, stretches that are lost."""

    def __init__(self, conditions: Conditions, rng: np.random.Generator) -> None:
        self._jitter, self._rng = conditions.jitter * SECOND, rng
        self._newest: dict[str, int] = {}
        self._muted = rng.choice(['wrench', 'accelerometer', 'optidrive', 'pose'])
        begin = np.sort(rng.uniform(START, START + 18 * SECOND, 3))
        self._pauses = np.column_stack([begin, begin + conditions.pause * SECOND])

    def carry(self, samples: list[tuple[str, int, tuple]]) -> list[tuple[str, int, tuple]]:
        """Return what arrives; each stream's stamps keep their order, as on arrival."""
        arrived = []
        for name, stamp, values in samples:
            if name == self._muted and within(self._pauses, stamp):
                continue
            off = round(self._rng.uniform(-self._jitter, self._jitter)) if self._jitter else 0
            stamp = max(stamp + off, self._newest.get(name, 0) + 1000)
            self._newest[name] = stamp
            arrived.append((name, stamp, values))
        return arrived


def run(seed: int, conditions: Conditions | None = None, accelerometer: str = 'acc1') -> Outcome:  # noqa: C901 - one run, step by step
    """Calibrate the nominal rig with what is late drawn from a seed."""
    rng = np.random.default_rng(seed)
    conditions = conditions or drawn(rng)
    values = {row.name: row.default for row in PARAMETERS} | FOR_SIMULATION
    values['accelerometer.coupling'] = 'ac' if accelerometer == 'acc2' else 'dc'
    settings = settings_of(values)
    rig, wire = Rig(conditions, rng, accelerometer, seed), Wire(conditions, rng)
    now = [0]
    monitor = Monitor(settings.watch, settings.limits, {
        'wrench': 'wrench', 'pose': 'current_pose', 'accelerometer': 'accelerometer/raw'})
    collector, sequence = Collector('V', 1), MotionSequence(settings.stream)
    clock = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=now[0]))
    guard = Guard(
        SimpleNamespace(monitor=monitor, deadman=SimpleNamespace(fault=lambda steady: '')),
        SimpleNamespace(topic='target_frame', commands_of_others=0), sequence,
        clock, clock, False)
    stream, command, stillness, looked, phase = None, None, None, 0, ''
    waiting, inbox = waits(rng, conditions.load), []
    hear = {'wrench': monitor.wrench, 'pose': monitor.pose,
            'accelerometer': lambda *sample: monitor.other('accelerometer', *sample)}

    def announce(stamp: int) -> None:
        nonlocal phase
        if sequence.status.phase != phase:
            phase = sequence.status.phase
            collector.enter(phase, stamp)

    while now[0] < LONGEST:
        now[0] += TICK
        inbox += wire.carry(rig.said(now[0]))
        if within(waiting, now[0]):
            continue
        for name, stamp, values_ in inbox:
            if name in hear:
                hear[name](stamp * 1e-9, values_)
            if stream is not None:
                collector.add(name, stamp, values_)
        inbox = []
        monitor.tick(now[0] * 1e-9)
        if stream is None:
            if now[0] < START:
                continue
            monitor.begin(now[0] * 1e-9)
            xyzw = monitor.channels['pose'].values[3:]
            start = Pose(monitor.mean('pose'), matrix_from_quaternion(np.array(xyzw)))
            goals, away = settings.goals(start)
            parts = prepare(SEQUENCES['calibrate'](goals, away, settings.timing), start,
                            settings.pace, settings.limits)
            check_wrench(parts, monitor.mean('wrench'), settings.limits)
            collector.clear()
            sequence.start(parts, start, 'identification')
            guard.begin()
            stamp = next_in_phase(now[0], round(monitor.channels['pose'].stamp * SECOND), TICK)
            stream = StreamClock(TICK, now[0], stamp)
            announce(stamp)
        if not sequence.streaming:
            break
        if sequence.running and not sequence.moved and (
                fault := guard.check(command is not None and command.moving)):
            sequence.abort(fault.reason, at_once=fault.at_once)
        slipped = stream.slipped_ns
        due = stream.due(now[0])
        if stream.slipped_ns != slipped:
            sequence.restart()
        for _ in range(due):
            stamp = stream.next_stamp()
            if not sequence.settling:
                stillness = None
            elif stillness is None or looked % LOOK == 0:
                stillness = monitor.stillness()
            looked += 1
            command = sequence.step(stillness)
            if command is None:
                break
            announce(stamp)
            pose = (*command.pose.position.tolist(), *quaternion_of(command.pose.R_base_sensor))
            monitor.command(stamp * 1e-9, pose)
            collector.add('target', stamp, pose)
            rig.send(now[0], stamp, pose)
    if not sequence.moved:
        return Outcome(conditions, sequence.status.reason or 'it did not end', None)
    try:
        recording = collector.recording()
    except ForcecalError as error:
        return Outcome(conditions, str(error), None)
    return Outcome(conditions, '', replace(recording, source=f'run {seed}'))
