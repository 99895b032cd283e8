"""Simulated calibration runs: the motion of the sequencer, the sensors of the rig."""

from dataclasses import replace
from functools import cache

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.effects.rig import Rig
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import calibration_plan, prepare, Timing
from forcecal_ros.motion.profiles import nominal_poses, Pace, Pose, step_goal
from forcecal_ros.observe.design import with_kalman_gains
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

SETTLE = 1.0
PERIOD = 0.004


def motion(timing: Timing = Timing(), poses: dict[str, Pose] | None = None,
           settle: float = SETTLE, pace: Pace = Pace(), start: Pose | None = None
           ) -> tuple[PoseStream, tuple[Phase, ...]]:
    """Commands and phases of the calibration sequence; its home is the first pose."""
    poses = poses or nominal_poses()
    home = next(iter(poses.values()))
    plan = calibration_plan(poses, step_goal(home, timing.step_distance), timing)
    rest = start or home
    positions, rotations, phases, begin = [], [], [], 0.0
    for part in prepare(plan, rest, pace, Limits()):
        n = round((settle if part.duration is None else part.duration) / PERIOD)
        for k in range(n):
            pose = part.move.at(k * PERIOD).pose if part.move else rest
            positions.append(pose.position)
            rotations.append(pose.R_base_sensor)
        rest = part.goal
        phases.append(Phase(part.segment.phase, begin, begin + n * PERIOD))
        begin += n * PERIOD
    t = PERIOD * np.arange(len(positions))
    return PoseStream(t, np.array(positions), np.array(rotations)), tuple(phases)


@cache
def _usual_motion() -> tuple[PoseStream, tuple[Phase, ...]]:
    return motion()


def shifted(stream: Stream, delay: float) -> Stream:
    """Return the same readings, stamped later."""
    return replace(stream, t=stream.t + delay)


def run(rig: Rig | None = None, *, seed: int = 0, accelerometer: str = 'acc1',
        delay: float = 0.0, noise: bool = True, **options) -> Recording:
    """One calibration run; the accelerometer shows all ``delay`` after the wrench does."""
    target, phases = motion(**options) if options else _usual_motion()
    recording = simulate(rig or load_rig(), target, accelerometer=accelerometer, seed=seed,
                         noise=noise)
    late = 'accelerometer' if delay > 0 else 'wrench'
    return replace(recording, phases=phases,
                   **{late: shifted(getattr(recording, late), abs(delay))})


def slow_rig(rate: float = 250.0) -> Rig:
    """Return the nominal rig with sensors at a lower rate [Hz]."""
    rig = load_rig()
    return replace(rig, **{name: replace(getattr(rig, name), rate=rate) for name in (
        'wrench_sensor', 'accelerometer', 'optidrive')})


def brief_run() -> Recording:
    """Calibrate as briefly as may be, all sensors at 250 Hz."""
    return run(slow_rig(), seed=3, timing=Timing(measure=0.4, ring=0.3), settle=0.8)


def rehearse(rig: Rig, accelerometer: str = 'acc1', seed: int = 0) -> Calibration:
    """Calibrate a simulated rig as the sequencer would, nothing known beforehand."""
    coupling = 'ac' if rig.accelerometer.model(accelerometer).highpass > 0.0 else 'dc'
    return with_kalman_gains(identify(run(rig, seed=seed, accelerometer=accelerometer),
                                      IdentificationSettings(coupling=coupling)))
