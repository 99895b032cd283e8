"""The contact experiment of [Gamez2005] V and VI: every force fed back, either accelerometer."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.streams import Phase, PoseStream
from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.law import Law, Regulator
from forcecal_ros.impedance.program import Program, Stage, Task
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import calibration_plan, prepare, Timing
from forcecal_ros.motion.poses import nominal_poses, step_goal
from forcecal_ros.motion.profiles import Move, Pace, Pose
from forcecal_ros.observe.design import with_kalman_gains
from forcecal_ros.reproduce.assess import assess, exceptions, Figures
from forcecal_ros.reproduce.closed_loop import ClosedLoopRun, feedback_of, run_closed_loop, SOURCES
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

OSCILLATION = Program(tuple(
    Stage('free', 0.0 if k % 2 else -0.04, 0.3) for k in range(16)))
"""Reference that goes back and forth in free space without a pause, [Gamez2005] Fig. 8."""


class Row(NamedTuple):
    """One line of the table."""

    accelerometer: str
    feedback: str
    figures: Figures


@dataclass(frozen=True)
class Experiment:
    """
    Runs and figures of the experiment.

    Attributes
    ----------
    calibrations : mapping of str to Calibration
        Identified from a simulated sequence, by accelerometer.
    runs : mapping of (str, str) to ClosedLoopRun
        By accelerometer and feedback.
    oscillations : mapping of str to ClosedLoopRun
        In free space with feedback ``kalman``, by accelerometer.
    notes : mapping of str to tuple of str
        Figures in which the Kalman observer is not the best, by accelerometer.
    """

    calibrations: Mapping[str, Calibration]
    runs: Mapping[tuple[str, str], ClosedLoopRun]
    oscillations: Mapping[str, ClosedLoopRun]
    rows: tuple[Row, ...]
    notes: Mapping[str, tuple[str, ...]]


def conduct(rig: Rig, accelerometers: Sequence[str], law: Law, *, seed: int = 0,
            latency: int = 0, tell: Callable[[str], None] = lambda what: None) -> Experiment:
    """
    Run the experiment with ``acc1``, ``acc2`` or both.

    Parameters
    ----------
    seed : int
        Of the noise, the same in every run; the calibration has the next one.
    latency : int
        Periods that a command takes beyond the robot's own delay.
    tell : callable
        Called with the name of each run before it starts.
    """
    program = Task().program()
    calibrations, runs, oscillations, rows = {}, {}, {}, []
    for name in accelerometers:
        tell(f'{name}: calibration')
        calibrations[name] = calibration = rehearse(rig, name, seed + 1)
        follow = partial(run_closed_loop, rig, accelerometer=name, seed=seed, latency=latency)
        for source in SOURCES:
            tell(f'{name}: {source}')
            runs[name, source] = follow(
                program, feedback_of(source, calibration, name), Regulator(law))
            rows.append(Row(name, source, assess(runs[name, source], runs[name, 'true'], program)))
        tell(f'{name}: oscillation')
        oscillations[name] = follow(
            OSCILLATION, feedback_of('kalman', calibration), Regulator(law))
    notes = {name: tuple(exceptions({row.feedback: row.figures for row in rows
                                     if row.accelerometer == name})) for name in accelerometers}
    return Experiment(calibrations, runs, oscillations, tuple(rows), notes)


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
