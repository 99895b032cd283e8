"""From a recording and a simulator that can be run to a diagnosis."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.by_motion import in_unit
from forcecal_ros.diagnose.engine import diagnose_datasets, Outcome
from forcecal_ros.diagnose.imitations import judged_beside, tried
from forcecal_ros.diagnose.inputs.accelerometer import as_compared, imus_compared
from forcecal_ros.diagnose.inputs.dataset import Dataset, made_up
from forcecal_ros.diagnose.inputs.measured_joints import (
    compared,
    measured_joints,
    named_joints,
    of_same_joints,
)
from forcecal_ros.diagnose.inputs.motion_dataset import (
    held_out,
    kinds,
    moves,
    require_wrench_and_pose,
    span,
)
from forcecal_ros.diagnose.inputs.requirements import require_same_sensors
from forcecal_ros.diagnose.inputs.residuals import MeasuredBlocks
from forcecal_ros.diagnose.inputs.simulated_tool import (
    refuse_other_wrench,
    simulated_tool,
    SimulatedTool,
    TURN,
)
from forcecal_ros.diagnose.inputs.stamps import Corrected, evened
from forcecal_ros.diagnose.numbers_found import Changed, changes, held, recalibrated
from forcecal_ros.diagnose.refit import Bent, bent, refitted, widened
from forcecal_ros.diagnose.say.result import Diagnosis, NO_MOTION
from forcecal_ros.diagnose.say.verdict import FIRST
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.rerun import Rerun
from forcecal_ros.sim.rigid_tool import beyond
from forcecal_ros.sim.run_limit import refuse_too_many, runs_short
from forcecal_ros.sim.runs import Numbers, refuse_unsteady, Runs
from forcecal_ros.sim.signals import BLOCK
from forcecal_ros.sim.simulated_robot import simulated_robot, SimulatedRobot
from forcecal_ros.sim.third_party import ThirdParty
import numpy as np
from numpy.typing import NDArray

ROUNDS = 2
"""
Times that all parameters are tried, at the nominal ones and then at those found: 30 parameters and
two recordings then take 124 runs.
"""

ROUGH = 0.1
"""
Misfit of the linear prediction at the parameters found, in that of the nominal ones, from which
they are all tried again there: a tenth leaves the explained share within a hundredth.
"""

LESS = 0.05
"""
Share of the misfit that is gone in the prediction and not when the simulator is run, from which
all parameters are tried again: the width of most confidence intervals of that share.
"""

SETTLED = 1.0
"""
Standard errors that a number would still move, where the simulator was run as it was found, from
which it is fitted once more about there: half of what chance makes of it.
"""

REFITS = 3
"""
Times that numbers named are fitted once more: each leaves the square of what was left before, so
that three settle whatever two rounds came near.
"""

KNOCKS = ('for {:.1f} s the simulated tool knocks at something, or sticks and slips, so that half '
          'the step of its integration changes its wrench by more than 1 N: left out, as that is '
          'chance; touch more softly or slide less')
"""What is said of contact that no number of a simulator is told by."""

class RerunDiagnosis(NamedTuple):
    """
    A diagnosis, and what the simulator should be told.

    Attributes
    ----------
    changed : tuple of Changed
        Parameters that a named effect moves.
    runs : int
        How often it was run.
    recomputed : float or None
        Share of the misfit that is gone when it is run with them; None where none is changed.
    """

    outcome: Outcome
    changed: tuple[Changed, ...] = ()
    runs: int = 0
    recomputed: float | None = None

    @property
    def numbers(self) -> Numbers:
        """Values of all parameters of the simulator as they were found."""
        assert isinstance(self.outcome.rig, SimulatedRobot)
        return self.outcome.rig.numbers

    def document(self) -> dict[str, Any]:
        """Return what ``diagnosis.json`` says of it, beside the diagnosis."""
        return {'parameters': [one._asdict() for one in self.changed], 'runs': self.runs,
                'recomputed': self.recomputed}


def diagnose_rerun(recording: Recording, heldout: Recording | None, simulator: ThirdParty,
                   rig: Rig) -> RerunDiagnosis:
    """
    Find out what a robot has that somebody's simulator of it has not.

    Parameters
    ----------
    recording : Recording
        To fit on: commands, wrench and pose; an accelerometer in m/s^2 along ft_sensor.
    heldout : Recording or None
        To judge on; every other second of ``recording`` where none is given.
    rig : Rig
        Gives the tolerances.

    Returns
    -------
    RerunDiagnosis
        Data that cannot answer come out as such, with the reason.

    Raises
    ------
    ConfigError
        The simulator does not keep to the protocol, answers otherwise the second time, or has so
        many parameters that it would be run too often.
    """
    given = of_same_joints([one for one in (recording, heldout) if one is not None])
    try:
        require_same_sensors(given)
        for one in given:
            _require_wrench_and_pose(one)
        stamps = [evened(one) for one in given]
        simulator = simulator.acting([inputs_of(one.recording) for one in stamps])
        refuse_too_many(simulator, len(given))
        first = _prepared(stamps[0], simulator, None, rig)
        ready = [first, *(_prepared(one, simulator, first.tool, rig) for one in stamps[1:])]
    except DataError as error:
        return RerunDiagnosis(Outcome(Diagnosis('invalid_data', str(error)), rig))
    datasets = [one.dataset for one in ready]
    if not moves(datasets):
        return RerunDiagnosis(Outcome(NO_MOTION, rig))
    refuse_unsteady(first.runs)
    joints = first.simulation.joints
    given = [replace(as_compared(one, dataset.measured.streams),
                     joints=compared(one.joints, joints))
             for one, dataset in zip(given, datasets)]
    return _searched(ready, held_out(datasets), given, simulator)


def _searched(ready: Sequence['_Prepared'], judged: tuple[Dataset, ...],
              given: Sequence[Recording], simulator: ThirdParty) -> RerunDiagnosis:
    """Try all parameters, where they are and, if that was too far off, where they should be."""
    robot = ready[0].robot
    outcome, point, short = Outcome(NO_MOTION, robot), robot.numbers, ''
    changed: tuple[Changed, ...] = ()
    squares, recomputed = np.zeros(3), None
    for _ in range(ROUNDS):
        if short := runs_short(simulator, [one.runs for one in ready]):
            break
        for one in ready:
            one.runs.try_all(point)
            one.simulation.forget()
        outcome = diagnose_datasets(robot, judged, [one.stamps for one in ready], given)
        changed = changes(simulator, outcome)
        if not isinstance(outcome.rig, SimulatedRobot):
            break
        point = outcome.rig.numbers
        straight = _predicted(ready, point)  # before it is run there
        squares = _squares(ready, judged, outcome) if changed else np.zeros(3)
        if straight and not _falls_short(outcome, squares) and not _might_bend(outcome):
            break
    remarks = tuple(dict.fromkeys(x for one in ready for x in one.remarks))
    if changed:
        outcome, squares = _settled(ready, judged, outcome, squares, again=not short)
        recomputed = _recomputed(outcome, squares)
        if other := tried([one.simulation for one in ready], judged, outcome, simulator):
            outcome = judged_beside(outcome, other, squares)
        changed = changes(simulator, outcome)
    notes = (*outcome.diagnosis.notes, *simulator.notes, *remarks,
             *recalibrated(simulator, outcome),
             *dict.fromkeys(filter(None, [*(x for one in ready for x in one.notes), short])),
             *named_joints(ready[0].simulation.joints, given))
    told = in_unit('m/s^2', outcome.diagnosis)
    if told.verdict == 'no_gap' and (limited := held(simulator, outcome)):
        word, apart, more = told.reason.partition('; ')
        told = replace(told, reason=f'{word}, with {" and ".join(limited)} as far off as three '
                                    f'sigma allow{apart}{more}')
    if remarks and told.verdict in ('unknown', 'partial'):
        told = replace(told, reason=f'{told.reason}; {FIRST}{remarks[0]}')
    outcome = replace(outcome, diagnosis=replace(told, notes=notes))
    return RerunDiagnosis(outcome, changed, sum(one.runs.count for one in ready), recomputed)


def _settled(ready: Sequence['_Prepared'], judged: tuple[Dataset, ...], outcome: Outcome,
             squares: Array, *, again: bool) -> tuple[Outcome, Array]:
    """Fit the numbers named about where they were found, and say what a line leaves wrong."""
    off, simulator = _bent(ready, outcome), ready[0].runs.simulator
    for _ in range(REFITS if again else 0):
        if not (_moves(off) or _falls_short(outcome, squares)) \
                or runs_short(simulator, [one.runs for one in ready]):
            break
        assert isinstance(outcome.rig, SimulatedRobot)
        for one in ready:
            one.runs.try_all(outcome.rig.numbers)
            one.simulation.forget()
        anew = refitted(outcome)
        # half the step of integration may do something else there: both are asked about it
        squares, there = (_squares(ready, judged, one) for one in (outcome, anew))
        if there[-1] >= squares[-1]:
            break
        outcome, squares, off = anew, there, _bent(ready, anew)
    return widened(outcome, off), squares


def _moves(off: Mapping[str, Bent]) -> bool:
    """Say whether a number would still move by more than its standard error."""
    return any(abs(one.shift) > SETTLED * one.std for one in off.values())


def _bent(ready: Sequence['_Prepared'], outcome: Outcome) -> dict[str, Bent]:
    """Run the simulator as it was found, and say how far its named numbers would still move."""
    if outcome.selection is None or not isinstance(outcome.rig, SimulatedRobot):
        return {}
    for one in ready:
        one.runs.exact(outcome.rig.numbers)
        one.simulation.forget()
    return bent(outcome.selection)


class _Prepared(NamedTuple):
    dataset: Dataset
    stamps: Corrected
    runs: Runs
    simulation: Rerun
    tool: SimulatedTool
    robot: SimulatedRobot
    notes: tuple[str, ...]
    remarks: tuple[str, ...]


def _prepared(stamps: Corrected, simulator: ThirdParty, tool: SimulatedTool | None, rig: Rig
              ) -> _Prepared:
    real = stamps.recording
    start, n = span(real)
    assert real.pose is not None
    runs = Runs(simulator, inputs_of(real), real.pose)
    made = runs.exact(simulator.nominal)
    known = tool or simulated_tool(
        replace(made, accelerometer=None), start, n, rig, TURN).with_accelerometer()
    refuse_other_wrench(real, known)
    simulation = Rerun(runs, start, n, known.simulated)
    felt, _, note = imus_compared(real, made)
    simulation.accelerated = felt.accelerometer is not None
    seen = replace(real, target=None, optidrive=None,
                   accelerometer=felt.accelerometer,
                   joints=compared(real.joints, simulation.joints))
    robot = simulated_robot(known.rigid_tool, simulator.parameters)
    if tool is None:
        known = known.zeroed(beyond(real, simulation.signals(robot)))
        robot = replace(robot, wrench_sensor=known.rigid_tool.wrench_sensor)
    groups = kinds(simulation.signals(robot))
    dataset = Dataset(real, simulation, MeasuredBlocks(seen, start, n), robot, groups,
                      real.phases or made_up(groups, start), np.ones(n, bool), np.zeros(n, bool))
    notes = tuple(filter(None, (note, _without_knocking(dataset, simulation.knocking(robot)))))
    return _Prepared(dataset, stamps, runs, simulation, known, robot, notes,
                     simulator.remarks(inputs_of(real)))


def _without_knocking(dataset: Dataset, knocking: NDArray[np.bool_]) -> str:
    """Leave out what is chance in the simulation, and say for how long."""
    dataset.measured.present[knocking] = False
    seconds = BLOCK * float(knocking.sum())
    return KNOCKS.format(seconds) if seconds else ''


def _require_wrench_and_pose(recording: Recording) -> None:
    require_wrench_and_pose(recording, 'the recording lacks wrench or measured pose; record '
                            'wrench and current_pose beside the commands')


def inputs_of(recording: Recording) -> Inputs:
    """
    Take the commands of a recording, from its first stamp to its last.

    Raises
    ------
    DataError
        It holds none.
    """
    told = [s for s in (recording.target, recording.joint_commands) if s is not None and len(s)]
    if not told:
        raise DataError('the recording holds no commands; record those of the joints, and name '
                        'them with --topic joint_commands=NAME')
    streams = [s.t for s in (recording.wrench, recording.pose) if s is not None]
    start = min(float(told[0].t[0]), *(float(t[0]) for t in streams))
    return Inputs(start, max(float(t[-1]) for t in streams), recording.target,
                  recording.joint_commands, measured_joints(recording.joints))


def _predicted(ready: Sequence[_Prepared], point: Numbers) -> bool:
    """Say whether the linear prediction holds at the parameters found."""
    for one in ready:
        linear, nominal = one.runs.at(point), one.runs.exact(one.robot.numbers)
        for a, b, c in zip(*map(_rows, (linear, one.runs.exact(point), nominal))):
            if np.linalg.norm(a - b) > ROUGH * np.linalg.norm(b - c):
                return False
    return True


def _might_bend(outcome: Outcome) -> bool:
    """Say whether what is unexplained may be what a line about the nominal numbers leaves."""
    return outcome.diagnosis.verdict == 'unknown'


def _falls_short(outcome: Outcome, squares: Array) -> bool:
    """Say whether a run with what was found leaves more than was predicted."""
    gap, recomputed = outcome.diagnosis.gap, _recomputed(outcome, squares)
    return gap is not None and recomputed is not None and recomputed < gap.closed - LESS


def _rows(recording: Recording) -> tuple[Array, Array]:
    assert recording.wrench is not None
    assert recording.pose is not None
    return recording.wrench.values, recording.pose.position


def _recomputed(outcome: Outcome, squares: Array) -> float | None:
    """
    Say which share of the misfit is gone where the simulator is run with what was found.

    The share that the diagnosis states, times what the run explains of the squares on judged
    blocks for what its linear prediction explains of them.
    """
    gap, (before, linear, exact) = outcome.diagnosis.gap, squares.tolist()
    explained = before - linear
    return gap.closed * (before - exact) / explained if gap and explained > 0.0 else None


def _squares(ready: Sequence[_Prepared], judged: Sequence[Dataset], outcome: Outcome) -> Array:
    """Sum the squares on judged blocks: recalibrated, as predicted and as it is when run."""
    noise, robot, squares = outcome.noise, outcome.rig, np.zeros(3)
    assert isinstance(robot, SimulatedRobot)
    assert noise is not None
    for one, dataset, before, linear in zip(ready, judged, outcome.recalibrated,
                                            outcome.explained):
        one.runs.exact(robot.numbers)
        one.simulation.forget()
        exact = dataset.measured.residual(one.simulation.signals(robot))
        for i, blocks in enumerate((before, linear, exact)):
            rows = np.where(dataset.measured.present, blocks, 0.0)[dataset.held]
            squares[i] += float(np.sum((rows / np.where(noise > 0.0, noise, np.inf)) ** 2))
    return squares
