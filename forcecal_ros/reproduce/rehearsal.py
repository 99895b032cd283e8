"""A calibration run in simulation: the sequencer's motion, the rig's sensors, identification."""

from dataclasses import replace

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.effects.rig import Rig
from forcecal_ros.identify.pipeline import identify
from forcecal_ros.identify.settings import IdentificationSettings
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import calibration_plan, prepare, Timing
from forcecal_ros.motion.poses import nominal_poses, step_goal
from forcecal_ros.motion.profiles import Move, Pace, Pose
from forcecal_ros.observe.gains import with_kalman_gains
from forcecal_ros.recording.streams import Phase, PoseStream
from forcecal_ros.simulators.rig.offline import simulate
import numpy as np

SETTLE = 1.0
"""Wait before each measurement, until the tool has stopped ringing on its spring [s]."""


def calibration_motion(period: float) -> tuple[PoseStream, tuple[Phase, ...]]:
    """Return the commands of the sequencer's default sequence, one a ``period`` [s]."""
    timing, poses = Timing(), nominal_poses()
    home = next(iter(poses.values()))
    plan = calibration_plan(poses, step_goal(home, timing.step_distance), timing)
    commands: list[Pose] = []
    phases: list[Phase] = []
    rest = home
    for part in prepare(plan, home, Pace(), Limits()):
        begin = len(commands) * period
        n = round((SETTLE if part.duration is None else part.duration) / period)
        if isinstance(part.move, Move):
            commands += [part.move.at(k * period).pose for k in range(n)]
            rest = part.move.goal
        else:
            commands += [rest] * n
        phases.append(Phase(part.segment.phase, begin, len(commands) * period))
    return PoseStream(np.arange(len(commands), dtype=float) * period,
                      np.array([pose.position for pose in commands]),
                      np.array([pose.R_base_sensor for pose in commands])), tuple(phases)


def rehearse(rig: Rig, accelerometer: str | None = None, seed: int | None = None) -> Calibration:
    """
    Calibrate a simulated rig as the sequencer would, nothing known beforehand.

    ``accelerometer`` is ``acc1``, ``acc2`` or, where None, the one that the rig file mounts.
    """
    target, phases = calibration_motion(rig.robot.period)
    recording = replace(simulate(rig, target, accelerometer=accelerometer, seed=seed),
                        phases=phases)
    coupling = 'ac' if rig.accelerometer.model(accelerometer).highpass > 0.0 else 'dc'
    return with_kalman_gains(identify(recording, IdentificationSettings(coupling=coupling)))
