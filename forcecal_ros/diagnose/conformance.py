"""Whether somebody's simulator can be compared with a robot: it is run a few times."""

from collections.abc import Iterator
from dataclasses import replace
import time
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import size
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.by_simulator import inputs_of
from forcecal_ros.diagnose.inputs.motion_dataset import span
from forcecal_ros.diagnose.inputs.simulated_tool import simulated_tool, TURN
from forcecal_ros.diagnose.recordings import even_stamps, missing_joint_notes
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.run_limit import MOST
from forcecal_ros.sim.runs import refuse_unsteady, Runs
from forcecal_ros.sim.third_party import STREAMS, ThirdParty
import numpy as np


class Sensitivity(NamedTuple):
    """What one sigma of a parameter does, RMS [N], [N m], [m], [rad]; to all joints [rad]."""

    name: str
    force: float
    torque: float
    position: float
    turn: float
    joints: float = 0.0


class Conformance(NamedTuple):
    """
    How a simulator does under recorded commands.

    Attributes
    ----------
    seconds : float
        Processor time of one run [s].
    length : float
        Of the recording [s].
    """

    name: str
    seconds: float
    length: float
    streams: tuple[str, ...]
    sensitivity: tuple[Sensitivity, ...]
    notes: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` prints."""
        return {**self._asdict(), 'sensitivity': [s._asdict() for s in self.sensitivity]}

    def __str__(self) -> str:
        runs = min(MOST, 2 * (len(self.sensitivity) + 2))
        return '\n'.join([
            f'{self.name}: keeps to the protocol and does the same again',
            f'simulates {", ".join(self.streams)}',
            f'{self.length:.0f} s of commands take {self.seconds:.2g} s',
            f'a diagnosis runs it at most {runs} times a recording: {runs * self.seconds:.0f} s',
            'one sigma of a parameter moves, RMS:',
            *(f'  {s.name}  ' + '  '.join(self._moves(s)) for s in self.sensitivity),
            *(f'note: {note}' for note in self.notes)])

    def _moves(self, s: Sensitivity) -> Iterator[str]:
        for value, unit in ((s.force, 'N'), (s.torque, 'N m'), (s.position, 'm'), (s.turn, 'rad')):
            yield size(value, unit)
        if 'joints' in self.streams:
            yield f'joints {size(s.joints, "rad")}'
        if not any(s[1:]):
            yield '(nothing)'


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
    refuse_unsteady(runs)
    simulated_tool(replace(made, accelerometer=None), start, n, rig, TURN)
    runs.try_all(simulator.nominal)
    streams = tuple(name for name in (*STREAMS, 'joints') if getattr(made, name) is not None)
    lacking = missing_joint_notes(inputs.measured_joints,
                            () if made.joints is None else made.joints.names)
    return Conformance(simulator.name, seconds, inputs.end - inputs.start, streams, tuple(
        Sensitivity(p.name, _rms(c.wrench[:, :3]), _rms(c.wrench[:, 3:]), _rms(c.position),
                    _rms(c.turn), 0.0 if c.joints is None else _rms(c.joints))
        for p, c in zip(simulator.parameters, runs.changes(simulator.nominal))),
        (*simulator.notes, *lacking))


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(rows ** 2, axis=1))))
