"""The contact experiment of [Gamez2005] V and VI: every feedback, either accelerometer."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.assess import assess, exceptions, Figures
from forcecal_ros.impedance.feedback import feedback_of, SOURCES
from forcecal_ros.impedance.law import Law
from forcecal_ros.impedance.program import Program, Stage, Task
from forcecal_ros.impedance.regulator import Regulator
from forcecal_ros.impedance.rehearsal import rehearse
from forcecal_ros.impedance.trial import run_trial, Trial

OSCILLATION = Program(tuple(
    Stage('free', 0.0 if k % 2 else -0.04, 0.3) for k in range(16)))
"""Back and forth in free space without a rest, as in Fig. 8."""


class Row(NamedTuple):
    """One line of the table."""

    accelerometer: str
    feedback: str
    figures: Figures


@dataclass(frozen=True)
class Experiment:
    """
    What the experiment gave.

    Attributes
    ----------
    program : Program
    calibrations : mapping of str to Calibration
        Identified from a simulated sequence, by accelerometer.
    trials : mapping of (str, str) to Trial
        By accelerometer and feedback.
    oscillations : mapping of str to Trial
        In free space with feedback ``kalman``, by accelerometer.
    rows : tuple of Row
    notes : mapping of str to tuple of str
        Where the Kalman observer does not come out first, by accelerometer.
    """

    program: Program
    calibrations: Mapping[str, Calibration]
    trials: Mapping[tuple[str, str], Trial]
    oscillations: Mapping[str, Trial]
    rows: tuple[Row, ...]
    notes: Mapping[str, tuple[str, ...]]


def conduct(rig: Rig, accelerometers: Sequence[str], law: Law, *,
            task: Task = Task(), seed: int = 0, latency: int = 0,
            tell: Callable[[str], None] = lambda what: None) -> Experiment:
    """
    Run the experiment.

    Parameters
    ----------
    rig : Rig
    accelerometers : sequence of str
        ``acc1``, ``acc2`` or both.
    law : Law
    task : Task
    seed : int
        Of the noise, the same in every run; the calibration has the next one.
    latency : int
        Periods that a command takes in addition.
    tell : callable
        Told what is done next.

    Returns
    -------
    Experiment
    """
    program = task.program()
    calibrations, trials, oscillations, rows = {}, {}, {}, []
    for name in accelerometers:
        tell(f'{name}: calibration')
        calibrations[name] = calibration = rehearse(rig, name, seed + 1)

        def follow(reference: Program, source: str) -> Trial:
            tell(f'{name}: {source}')
            return run_trial(rig, reference, feedback_of(source, calibration), Regulator(law),
                             accelerometer=name, seed=seed, latency=latency)

        for source in SOURCES:
            trials[name, source] = follow(program, source)
            rows.append(Row(name, source, assess(trials[name, source], trials[name, 'true'],
                                                 program)))
        oscillations[name] = follow(OSCILLATION, 'kalman')
    notes = {name: tuple(exceptions({row.feedback: row.figures for row in rows
                                     if row.accelerometer == name})) for name in accelerometers}
    return Experiment(program, calibrations, trials, oscillations, tuple(rows), notes)
