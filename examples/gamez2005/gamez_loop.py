"""One contact task on the simulated rig, and the contact forces that its loop can feed back."""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import quaternion_from_matrix
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.law import Measurement, Regulator
from forcecal_ros.impedance.session import Program
from forcecal_ros.observe import (
    design,
    ObserverSettings,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    State,
)
from forcecal_ros.sim.rig.simulator import Samples, Simulator
from gamez_gains import with_printed_gain
import numpy as np

SOURCES = ('true', 'raw', 'static', 'printed', 'newton', 'kalman')
"""
Forces that are compared: the true one, which only a simulator knows; the sensor as read; the
sensor less bias and weight; the paper's observer with the gain that the paper prints, and with
that of the calibration; the six-axis Kalman observer.
"""


class Feedback(Protocol):
    """Turns samples of the sensors into the contact force along x of ft_sensor."""

    def update(self, samples: Samples) -> list[tuple[float, float]]:
        """Return stamps [s] and forces of the environment on the tool [N], in order of time."""


class Truth:
    """The true contact force, without noise or delay."""

    def update(self, samples: Samples) -> list[tuple[float, float]]:
        """Return the true force."""
        return list(zip(samples.contact_t.tolist(), samples.contact[:, 0].tolist()))


class Raw:
    """The sensor as read, bias included."""

    def update(self, samples: Samples) -> list[tuple[float, float]]:
        """Return the readings."""
        return list(zip(samples.wrench_t.tolist(), samples.wrench[:, 0].tolist()))


class Static:
    """The sensor less bias and weight: gravity compensation without an accelerometer."""

    def __init__(self, calibration: Calibration) -> None:
        self._bias = float(calibration.wrench_bias.value[0])
        self._weight = float(calibration.mass) * calibration.gravity

    def update(self, samples: Samples) -> list[tuple[float, float]]:
        """Subtract bias and weight, which follows from the newest measured pose."""
        # at rest and unloaded the wire reads m g, which points along -z of base
        weight = -self._weight * float(samples.R_base_sensor[-1][2, 0])
        force = samples.wrench[:, 0] - self._bias - weight
        return list(zip(samples.wrench_t.tolist(), force.tolist()))


class Observed:
    """The observer in mode ``newton`` or ``kalman``, by the step that its node runs."""

    def __init__(self, calibration: Calibration, mode: str) -> None:
        self._model = design(calibration, ObserverSettings(filter=mode))
        self._state = State()

    def update(self, samples: Samples) -> list[tuple[float, float]]:
        """Return the contact forces that these samples complete."""
        state, model, s = self._state, self._model, samples
        out: list[tuple[float, float]] = []
        for t, place, R in zip(s.pose_t.tolist(), s.position.tolist(), s.R_base_sensor):
            x, y, z, w = quaternion_from_matrix(R).tolist()
            state, done = on_pose(state, t, tuple(place), (x, y, z, w), model)
            out += [(one.t, one.contact[0]) for one in done]
        for t, slide in zip(s.optidrive_t.tolist(), s.optidrive.tolist()):
            state, done = on_displacement(state, t, slide, model)
            out += [(one.t, one.contact[0]) for one in done]
        for t, (x, y, z) in zip(s.accelerometer_t.tolist(), s.volts.tolist()):
            state, done = on_accelerometer(state, t, (x, y, z), model)
            out += [(one.t, one.contact[0]) for one in done]
        for t, row in zip(s.wrench_t.tolist(), s.wrench.tolist()):
            state, done = on_wrench(state, t, tuple(row), model)
            out += [(one.t, one.contact[0]) for one in done]
        self._state = state
        return out


def feedback_of(source: str, calibration: Calibration, accelerometer: str = 'acc1') -> Feedback:
    """
    Return one of :data:`SOURCES`; ``accelerometer`` says whose gain is the printed one.

    Raises
    ------
    ConfigError
        There is no such source, or the calibration does not hold what it needs.
    """
    if source == 'true':
        return Truth()
    if source == 'raw':
        return Raw()
    if source == 'static':
        return Static(calibration)
    if source == 'printed':
        return Observed(with_printed_gain(calibration, accelerometer), 'newton')
    if source in ('newton', 'kalman'):
        return Observed(calibration, source)
    raise ConfigError(f'feedback {source!r}: expected one of {", ".join(SOURCES)}')


@dataclass(frozen=True)
class ClosedLoopRun:
    """
    The recording of one run with what closed its loop.

    Attributes
    ----------
    recording : Recording
        Every sensor, the commands, the true contact wrench.
    feedback : Stream, shape (n, 1)
        Force fed back along x of ft_sensor, environment on tool [N].
    """

    recording: Recording
    feedback: Stream

    @property
    def tool(self) -> Stream:
        """Position of the tool along x of ft_sensor at home, shape (m, 1) [m]."""
        pose, slide = self.recording.pose, self.recording.optidrive
        assert pose is not None
        place = pose.position @ pose.R_base_sensor[0][:, :1]
        return Stream(pose.t, place if slide is None else place + slide.at(pose.t))

    @property
    def contact(self) -> Stream:
        """True contact wrench, shape (n, 6)."""
        assert self.recording.contact_truth is not None
        return self.recording.contact_truth


def run_closed_loop(rig: Rig, program: Program, feedback: Feedback, controller: Regulator, *,
                    accelerometer: str | None = None, seed: int | None = None, latency: int = 0
                    ) -> ClosedLoopRun:
    """
    Follow a program in closed loop, from the rig's home.

    The controller has the newest samples of each period; its command holds in the next one, or
    ``latency`` periods later.
    """
    simulator = Simulator(rig, accelerometer, seed)
    home, R = np.array(rig.home.position), rig.home.R_base_sensor
    period, axis = rig.robot.period, rig.home.R_base_sensor[:, 0]
    pending = deque([0.0] * (latency + 1))
    chunks: list[Samples] = []
    fed_back: list[tuple[float, float]] = []
    commands = []
    for k in range(round(program.duration / period)):
        commands.append(home + pending.popleft() * axis)
        simulator.command(commands[-1], R)
        samples = simulator.advance()
        chunks.append(samples)
        fed_back += feedback.update(samples)
        reference = program.at((k + 1) * period)
        pending.append(controller(reference, Measurement(
            float((samples.position[-1] - home) @ axis),
            float(samples.optidrive[-1]) if len(samples.optidrive) else 0.0,
            fed_back[-1][1] if fed_back else 0.0)))
    t = np.arange(len(commands), dtype=float) * period
    target = PoseStream(t, np.array(commands), np.broadcast_to(R, (len(t), 3, 3)))
    return ClosedLoopRun(
        _recording(Samples(*map(np.concatenate, zip(*chunks))), target, program),
        Stream(np.array([one[0] for one in fed_back]), np.array([[one[1]] for one in fed_back])))


def _recording(s: Samples, target: PoseStream, program: Program) -> Recording:
    begins = (0.0, *program.ends[:-1])
    return Recording(
        wrench=Stream(s.wrench_t, s.wrench, 'ft_sensor'),
        accelerometer=Stream(s.accelerometer_t, s.volts, 'accelerometer'),
        pose=PoseStream(s.pose_t, s.position, s.R_base_sensor, 'base'), target=target,
        optidrive=(Stream(s.optidrive_t, s.optidrive[:, np.newaxis], 'ft_sensor')
                   if len(s.optidrive) else None),
        contact_truth=Stream(s.contact_t, s.contact, 'ft_sensor'),
        phases=tuple(Phase(*row) for row in zip(
            (stage.phase for stage in program.stages), begins, program.ends)),
        source='simulation')
