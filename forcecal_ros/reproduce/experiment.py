"""The contact experiment of [Gamez2005] V and VI: every force fed back, either accelerometer."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.law import Law
from forcecal_ros.impedance.program import Program, Stage, Task
from forcecal_ros.impedance.regulator import Regulator
from forcecal_ros.reproduce.assess import assess, exceptions, Figures
from forcecal_ros.reproduce.closed_loop import ClosedLoopRun, run_closed_loop
from forcecal_ros.reproduce.feedback import feedback_of, SOURCES
from forcecal_ros.reproduce.rehearsal import rehearse

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
