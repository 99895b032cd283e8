"""One contact task through the simulated rig, the loop closed at the rate of the robot."""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.feedback import Feedback
from forcecal_ros.impedance.law import Measurement
from forcecal_ros.impedance.program import Program, Reference
from forcecal_ros.recording.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.simulators.rig.simulator import Samples, Simulator
import numpy as np


class Controller(Protocol):
    """One control step a period, along x of ft_sensor from the start."""

    def __call__(self, reference: Reference, heard: Measurement) -> float:
        """Return the command of S [m]."""

    def sent(self, command: float) -> None:
        """Learn which command was really sent [m]."""


@dataclass(frozen=True)
class Trial:
    """
    What one run gave.

    Attributes
    ----------
    recording : Recording
        Every sensor, the commands, the true contact wrench.
    feedback : Stream
        (n, 1) force along x of ft_sensor that was fed back, environment on tool [N].
    reference : Stream
        (m, 1) from the start [m].
    """

    recording: Recording
    feedback: Stream
    reference: Stream

    @property
    def tool(self) -> Stream:
        """Where the tool is along x of ft_sensor at home, (m, 1): S and its displacement [m]."""
        pose, slide = self.recording.pose, self.recording.optidrive
        assert pose is not None
        place = pose.position @ pose.R_base_sensor[0][:, :1]
        return Stream(pose.t, place if slide is None else place + slide.at(pose.t))

    @property
    def contact(self) -> Stream:
        """True contact wrench, (n, 6)."""
        assert self.recording.contact_truth is not None
        return self.recording.contact_truth


def run_trial(rig: Rig, program: Program, feedback: Feedback, controller: Controller, *,
              accelerometer: str | None = None, seed: int | None = None, latency: int = 0
              ) -> Trial:
    """
    Follow a program in closed loop, from the rig's home.

    Parameters
    ----------
    rig : Rig
    program : Program
    feedback : Feedback
    controller : Controller
        Of the newest samples of each period; what it commands holds in the next one.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.
    seed : int, optional
        Of the noise.
    latency : int
        Periods that a command takes in addition.

    Returns
    -------
    Trial
    """
    simulator = Simulator(rig, accelerometer, seed)
    home, R = np.array(rig.home.position), rig.home.R_base_sensor
    period, axis = rig.robot.period, rig.home.R_base_sensor[:, 0]
    underway = deque([0.0] * (latency + 1))
    pieces: list[Samples] = []
    fed: list[tuple[float, float]] = []
    commands, references = [], []
    for k in range(round(program.duration / period)):
        commands.append(home + underway.popleft() * axis)
        simulator.command(commands[-1], R)
        samples = simulator.advance()
        pieces.append(samples)
        fed += feedback.hear(samples)
        reference = program.at((k + 1) * period)
        references.append(reference.position)
        underway.append(controller(reference, Measurement(
            float((samples.position[-1] - home) @ axis),
            float(samples.optidrive[-1]) if len(samples.optidrive) else 0.0,
            fed[-1][1] if fed else 0.0)))
    t = np.arange(len(commands), dtype=float) * period
    target = PoseStream(t, np.array(commands), np.broadcast_to(R, (len(t), 3, 3)))
    return Trial(
        _recording(Samples(*map(np.concatenate, zip(*pieces))), target, program),
        Stream(np.array([one[0] for one in fed]), np.array([[one[1]] for one in fed])),
        Stream(t + period, np.array(references)[:, np.newaxis]))


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
