"""A third-party simulator, run with the recorded commands and with other numbers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import time
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import pair, size
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.dataset import (
    Dataset,
    make_dataset,
    motion_groups,
    require_wrench_and_pose,
    span,
    split_datasets,
)
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.judge.named_effects import AT_BOUND, estimated, NamedEffect, Parameter
from forcecal_ros.diagnose.recordings import (
    Corrected,
    even_stamps,
    joint_names,
    keep_common_joints,
    keep_comparable_imus,
    keep_compared_streams,
    missing_joint_notes,
    require_axes_of,
    select_joints,
)
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.sources.simulated_tool import (
    SIMULATE_IT,
    simulated_tool,
    SimulatedTool,
    TURN,
)
from forcecal_ros.diagnose.sources.source import Ready, RECALIBRATION_SIGMA, Source
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.rerun import (
    INTEGRATION_STEP,
    MAX_RUNS,
    Numbers,
    refuse_too_many,
    Rerun,
    Runs,
    runs_short,
    simulated_robot,
    SimulatedRobot,
)
from forcecal_ros.sim.rigid_tool import beyond
from forcecal_ros.sim.signals import BLOCK
from forcecal_ros.sim.third_party import STREAMS, ThirdParty
import numpy as np

TIED = 'are nearly confounded in this motion'
"""What a note states of numbers of which the data tell little but a combination."""

IMPACTS = ('{:.1f} s of impacts or stick-slip of the simulated tool are left out: with half the '
           'integration step, its wrench changes by more than 1 N; touch more softly or slide '
           'less')
"""Note on contact that identifies no number of a simulator."""


class Changed(NamedTuple):
    """
    A parameter of the simulator as it was, as it should be, and its standard error.

    Where it is at its bound, that shows nothing.
    """

    name: str
    unit: str
    before: float
    after: float
    std: float
    at_bound: bool = False

    def __str__(self) -> str:
        std, unit = (not self.at_bound) * self.std, '' if self.unit == '1' else f' {self.unit}'
        text = f'{self.name} {self.before:.5g} -> {pair(self.after, std)}{unit}'
        return text if std else f'{text} ({AT_BOUND})'


@dataclass(frozen=True, kw_only=True)
class RerunReady(Ready):
    """A recording made ready, and the simulator under its commands."""

    runs: Runs
    simulation: Rerun
    tool: SimulatedTool
    impacts_s: float
    remarks: tuple[str, ...] = ()

    def run(self, numbers: Numbers) -> None:
        """Run the simulator with these numbers: its signals are then exact there."""
        self.runs.exact(numbers)
        self.simulation.forget()

    def try_all(self, numbers: Numbers) -> None:
        """Linearise the simulator in all parameters about these numbers."""
        self.runs.try_all(numbers)
        self.simulation.forget()


class SimulatorSource(Source):
    """
    Runs a third-party simulator with the recorded commands.

    Recordings hold commands, wrench and pose; an accelerometer in m/s^2 along ft_sensor.

    Parameters
    ----------
    simulator : ThirdParty
    rig : Rig
        Gives the tolerances of tool and sensors.

    Raises
    ------
    ConfigError
        By ``diagnose``: the simulator does not keep to the protocol, does not repeat itself, or
        has so many parameters that it would be run too often.
    """

    ready: tuple[RerunReady, ...] = ()

    def __init__(self, simulator: ThirdParty, rig: Rig) -> None:
        super().__init__(rig, 'm/s^2')
        self.simulator = simulator.on_linear_scale()
        self.explained_by = simulator.name
        self.task = f'running {simulator.name} with other parameter values'
        self._recomputed: float | None = None

    def prepare(self, recordings: Sequence[Recording]) -> Sequence[Ready]:
        """Run the simulator as it is, and identify its tool."""
        recordings = keep_common_joints(recordings)
        for one in recordings:
            require_wrench_and_pose(one, 'the recording lacks wrench or measured pose; record '
                                    'wrench, current_pose and commands')
        stamps = [even_stamps(one) for one in recordings]
        self.simulator = self.simulator.acting([inputs_of(one.recording) for one in stamps])
        refuse_too_many(self.simulator, len(recordings))
        ready: list[RerunReady] = []
        for given, stamp in zip(recordings, stamps):
            ready.append(self._prepare(given, stamp, ready[0].tool if ready else None))
        return ready

    def _prepare(self, given: Recording, stamps: Corrected, tool: SimulatedTool | None
                 ) -> RerunReady:
        real, simulator = stamps.recording, self.simulator
        start, n = span(real)
        assert real.pose is not None
        inputs = inputs_of(real)
        runs = Runs(simulator, inputs, real.pose)
        made = runs.exact(simulator.nominal)
        known = tool or simulated_tool(made, start, n, self.rig, TURN)
        require_axes_of(known.rigid_tool, real, other_tool=SIMULATE_IT)
        simulation = Rerun(runs, start, n, known.simulated)
        imus, _, note = keep_comparable_imus(real, made)
        simulation.accelerated = imus.accelerometer is not None
        compared = replace(real, target=None, optidrive=None, accelerometer=imus.accelerometer,
                           joints=select_joints(real.joints, simulation.joints))
        robot = simulated_robot(known.rigid_tool, simulator.parameters)
        if tool is None:
            known = known.zeroed(beyond(real, simulation.signals(robot)))
            robot = replace(robot, wrench_sensor=known.rigid_tool.wrench_sensor)
        dataset = make_dataset(real, compared, simulation, robot,
                               motion_groups(simulation.signals(robot)))
        impacts = simulation.knocking(robot)
        dataset.measured.present[impacts] = False
        impacts_s = BLOCK * float(impacts.sum())
        left_out = IMPACTS.format(impacts_s) if impacts_s else ''
        given = replace(keep_compared_streams(given, dataset.measured.streams),
                        joints=select_joints(given.joints, simulation.joints))
        return RerunReady(dataset, stamps, given, tuple(filter(None, (note, left_out))), runs=runs,
                          simulation=simulation, tool=known, impacts_s=impacts_s,
                          remarks=simulator.remarks(inputs))

    def search(self) -> Outcome:
        """Try all numbers about their nominal values, and search."""
        self._recomputed = None
        self.ready[0].runs.refuse_unsteady()
        judged = split_datasets([one.dataset for one in self.ready])
        for one in self.ready:
            one.try_all(self.simulator.nominal)
        outcome = super().search()
        if self.changes(outcome):
            self._recomputed = _recomputed(outcome, self._squares(judged, outcome))
        return outcome

    def _squares(self, judged: Sequence[Dataset], outcome: Outcome) -> Array:
        """
        Run it as it was found, and sum squares on judged blocks, in the noise.

        Returns
        -------
        ndarray, shape (3,)
            Recalibrated, as predicted and as it is when run.
        """
        squares, noise = np.zeros(3), outcome.noise
        for one, dataset, before, linear in zip(self.ready, judged, outcome.recalibrated,
                                                outcome.explained):
            assert noise is not None
            one.run(_numbers_of(outcome.rig))
            exact = dataset.measured.residual(one.simulation.signals(outcome.rig))
            for i, blocks in enumerate((before, linear, exact)):
                rows = np.where(dataset.measured.present, blocks, 0.0)[dataset.held]
                squares[i] += float(np.sum((rows / np.where(noise > 0.0, noise, np.inf)) ** 2))
        return squares

    def explain(self, diagnosis: Diagnosis, outcome: Outcome) -> Diagnosis:
        """Add what the user should know of simulator and numbers."""
        effects = tuple(replace(e, parameters=self._in_numbers(e)) for e in diagnosis.effects)
        remarks = tuple(dict.fromkeys(x for one in self.ready for x in one.remarks))
        notes = (*self.simulator.notes, *remarks, *recalibrated_notes(self.simulator, outcome),
                 *dict.fromkeys(note for one in self.ready for note in one.notes),
                 *filter(None, [runs_short([one.runs for one in self.ready])]))
        named = replace(diagnosis, joints=(
            tuple(self.ready[0].simulation.joints) if self.ready[0].given.joints else ()))
        reason, limited = diagnosis.reason, limited_parameters(self.simulator, outcome)
        if diagnosis.verdict == 'no_gap' and limited:
            word, semicolon, more = reason.partition('; ')
            reason = (f'{word}, with {" and ".join(limited)} at the limit of the tolerance'
                      f'{semicolon}{more}')
        impacts_s = sum(one.impacts_s for one in self.ready)
        return replace(
            named, effects=effects, reason=named.label(reason), remarks=remarks,
            notes=tuple(map(named.label, (*diagnosis.notes, *notes))),
            at_tolerance=(*diagnosis.at_tolerance, *limited),
            not_compared=((f'{impacts_s:.1f} s of impacts and slipping contact',)
                          if impacts_s else ()))

    def _in_numbers(self, effect: NamedEffect) -> dict[str, Parameter]:
        """Return the parameters of an effect as the simulator's own numbers."""
        p = next((one for one in self.simulator.parameters if one.name == effect.name), None)
        if p is None:
            return effect.parameters
        own = {key: p.from_linear(x.value, x.std) for key, x in effect.parameters.items()}
        return {key: replace(effect.parameters[key], value=value, std=std, nominal=p.nominal)
                for key, (value, std) in own.items()}

    def changes(self, outcome: Outcome) -> tuple[Changed, ...]:
        """List the parameters that a named effect moves."""
        found = {e.name: e.parameters['value'] for e in outcome.diagnosis.effects
                 if 'value' in e.parameters}
        return tuple(
            Changed(p.name, p.unit, p.nominal, found[p.name].value, found[p.name].std,
                    found[p.name].at_bound) for p in self.simulator.parameters if p.name in found)

    def details(self, outcome: Outcome) -> dict[str, Any]:
        """Return the numbers to change, how often it was run, and what that explains when run."""
        return {'parameters': [one._asdict() for one in self.changes(outcome)],
                'runs': sum(one.runs.count for one in self.ready),
                'recomputed': self._recomputed if self.ready else None, 'model': None}

    def files(self, outcome: Outcome) -> dict[str, str]:
        """Return the model with the numbers to change, if the simulator writes one."""
        changed = {one.name: one.after for one in self.changes(outcome)}
        text = self.simulator.patched([changed.get(p.name, p.nominal) for p in
                                       self.simulator.parameters]) if changed else None
        return {} if text is None else {'model_patched.xml': text}


def _named(outcome: Outcome) -> set[str]:
    return {e.name for e in outcome.diagnosis.effects}


def limited_parameters(simulator: ThirdParty, outcome: Outcome) -> list[str]:
    """List the parameters, not named, that would move further than three of their sigma."""
    return [p.name for p in simulator.parameters
            if p.name in outcome.at_tolerance and p.name not in _named(outcome)]


def recalibrated_notes(simulator: ThirdParty, outcome: Outcome) -> Iterator[str]:
    """Say which parameters are off by no more than they may be."""
    named, limited, changes = _named(outcome), limited_parameters(simulator, outcome), []
    for p in simulator.parameters:
        x, std = outcome.recalibrations.get(p.name, (0.0, 0.0))
        if p.name not in (*named, *limited) and _is_moved(outcome, p.name):
            changes.append(str(Changed(p.name, p.unit, p.nominal,
                                       *p.from_linear(p.nominal + x, std))))
    if changes:
        yield f'recalibrated, within the tolerances: {"; ".join(changes)}'
    if limited:
        yield (f'{", ".join(limited)} exceeds its tolerance, but its error is too large to call '
               'it a cause')
    own = {p.name for p in simulator.parameters} | {'robot.delay'}
    reported = {*named, *limited, *(name for name in own if _is_moved(outcome, name))}
    for group in outcome.aliases:
        if group & reported and len(tied := sorted(group & own)) > 1:
            yield (f'{", ".join(tied)} {TIED}: their errors include this')
    if _is_moved(outcome, INTEGRATION_STEP):
        finer = estimated(*outcome.recalibrations[INTEGRATION_STEP], '')
        yield (f'{finer} times the change from halving the integration step was subtracted: a '
               'smaller step is closer to the robot')
    if 'robot_delay' not in named and _is_moved(outcome, 'robot.delay'):
        late, std = outcome.recalibrations['robot.delay']
        yield (f'the robot is {estimated(abs(late), std, "s")} '
               f'{"later" if late > 0.0 else "earlier"} than its simulation')


def _is_moved(outcome: Outcome, name: str) -> bool:
    """Say whether a number was recalibrated for certain."""
    x, std = outcome.recalibrations.get(name, (0.0, 0.0))
    return abs(x) > RECALIBRATION_SIGMA * std


def inputs_of(recording: Recording) -> Inputs:
    """
    Take the commands of a recording, from its first stamp to its last.

    Raises
    ------
    DataError
        It holds none.
    """
    commands = [s for s in (recording.target, recording.joint_commands)
                if s is not None and len(s)]
    if not commands:
        raise DataError('the recording holds no commands; record those of the joints, and name '
                        'them with --topic joint_commands=NAME')
    streams = [s.t for s in (recording.wrench, recording.pose) if s is not None]
    start = min(float(commands[0].t[0]), *(float(t[0]) for t in streams))
    return Inputs(start, max(float(t[-1]) for t in streams), recording.target,
                  recording.joint_commands, joint_names(recording.joints))


def _numbers_of(rig: Rig) -> Numbers:
    assert isinstance(rig, SimulatedRobot)
    return rig.numbers


def _recomputed(outcome: Outcome, squares: Array) -> float | None:
    """
    Say which share of the misfit is gone where the simulator is run with what was found.

    The share that the diagnosis states, times what the run explains of the squares on judged
    blocks for what its linear prediction explains of them.
    """
    gap, (before, linear, exact) = outcome.diagnosis.gap, squares.tolist()
    explained = before - linear
    return gap.closed * (before - exact) / explained if gap and explained > 0.0 else None


UNITS = {'force': 'N', 'torque': 'N m', 'position': 'm', 'turn': 'rad', 'joints': 'rad'}
"""Of what a parameter moves, as ``--check`` lists it."""


class Conformance(NamedTuple):
    """
    How a simulator does under recorded commands.

    Attributes
    ----------
    seconds : float
        Processor time of one run [s].
    length : float
        Of the recording [s].
    sensitivity : mapping of str to mapping of str to float
        What one sigma of each parameter does to each of UNITS, RMS.
    """

    name: str
    seconds: float
    length: float
    streams: tuple[str, ...]
    sensitivity: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` prints."""
        return {**self._asdict(), 'sensitivity': [
            {'name': name, **moved} for name, moved in self.sensitivity.items()]}

    def __str__(self) -> str:
        return '\n'.join([
            f'{self.name}: meets the protocol, and repeated runs are equal',
            f'simulates {", ".join(self.streams)}',
            f'{self.length:.0f} s of commands take {self.seconds:.2g} s',
            (f'a diagnosis runs it about {MAX_RUNS} times per recording, at most: '
             f'{MAX_RUNS * self.seconds:.0f} s'),
            'change by one sigma of a parameter, RMS:',
            *(f'  {name}  {self._moves(moved)}' for name, moved in self.sensitivity.items()),
            *(f'note: {note}' for note in self.notes)])

    def _moves(self, moved: Mapping[str, float]) -> str:
        listed = [('joints ' if what == 'joints' else '') + size(value, UNITS[what])
                  for what, value in moved.items() if what != 'joints' or what in self.streams]
        return '  '.join(listed if any(moved.values()) else [*listed, '(nothing)'])


def conformance(simulator: ThirdParty, recording: Recording, rig: Rig) -> Conformance:
    """
    Run a simulator a few times, and say whether a diagnosis can rely on it.

    Parameters
    ----------
    recording : Recording
        With commands, wrench and pose; its joints, where it has any, are simulated, too.
    rig : Rig
        Gives the tolerances.

    Raises
    ------
    ConfigError
        It does not keep to the protocol, or answers otherwise the second time.
    DataError
        The recording holds no commands, or the wrench no weight of a tool.
    """
    real = even_stamps(recording).recording
    start, n = span(real)
    assert real.pose is not None
    inputs = inputs_of(real)
    simulator = simulator.acting([inputs])
    runs = Runs(simulator, inputs, real.pose)
    began = time.process_time()
    made = runs.exact(simulator.nominal)
    seconds = time.process_time() - began
    runs.refuse_unsteady()
    simulated_tool(made, start, n, rig, TURN)
    runs.try_all(simulator.nominal)
    streams = tuple(name for name in (*STREAMS, 'joints') if getattr(made, name) is not None)
    lacking = missing_joint_notes(inputs.measured_joints,
                            () if made.joints is None else made.joints.names)
    return Conformance(
        simulator.name, seconds, inputs.end - inputs.start, streams,
        {p.name: {what: _rms(rows) for what, rows in zip(UNITS, (
            c['wrench'][:, :3], c['wrench'][:, 3:], c['position'], c['turn'],
            c.get('joints', np.zeros((1, 1)))))}
         for p, c in zip(simulator.parameters, runs.changes(simulator.nominal))},
        (*simulator.notes, *lacking))


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(rows ** 2, axis=1))))
