"""One contact task on the simulated rig, the loop closed at the rate of the robot."""

from collections import deque
from dataclasses import dataclass

from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.law import Controller, Measurement
from forcecal_ros.impedance.program import Program
from forcecal_ros.recording.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.reproduce.feedback import Feedback
from forcecal_ros.simulators.rig.simulator import Samples, Simulator
import numpy as np


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


def run_closed_loop(rig: Rig, program: Program, feedback: Feedback, controller: Controller, *,
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
