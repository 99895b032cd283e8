"""Two recordings of the same commands: the robot's, and one by another simulator."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from forcecal_ros.checks.entry import computed
from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.quantity import sizes
from forcecal_ros.core.streams import JointStream, Phase, PoseStream, Recording, Stream
from forcecal_ros.diagnose.dataset import Dataset, motion_groups, require_wrench_and_pose, span
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.localise import compare_motions, Tracking
from forcecal_ros.diagnose.recordings import (
    even_stamps,
    keep_comparable_imus,
    keep_compared_streams,
    require_axes_of,
)
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.sources.contact import (
    compare_contact,
    Contact,
    joined,
    Touch,
    touch_of_robot,
    touch_of_simulation,
    touching_of_robot,
    with_contact,
)
from forcecal_ros.diagnose.sources.rig import motion_dataset
from forcecal_ros.diagnose.sources.simulated_tool import (
    SIMULATE_IT,
    simulated_tool,
    SimulatedTool,
)
from forcecal_ros.diagnose.sources.source import Ready, recalibration_notes, Source
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.measured_motion import express_in_base, RecordedSimulation
from forcecal_ros.sim.rigid_tool import beyond, MARGIN_S
from forcecal_ros.sim.signals import BLOCK
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar
from scipy.signal import correlate

UNTESTED = ('how the simulator executes its commands (friction, gains and gears of joints) '
            'is not tested; --mujoco and --simulator test it')

BIAS = 'wrench.bias'
"""The nuisances of a sensor's bias."""


@dataclass(frozen=True, kw_only=True)
class PairReady(Ready):
    """A pair made ready, how it was aligned, how the motions differ, and the simulated tool."""

    alignment: 'Alignment'
    tracking: Tracking
    tool: SimulatedTool
    simulated: Recording

    @property
    def simulation(self) -> RecordedSimulation:
        """The simulated tool along the measured motion."""
        assert isinstance(self.dataset.simulation, RecordedSimulation)
        return self.dataset.simulation

    def touches(self, rig: Rig) -> tuple[Touch, Touch]:
        """Return the contact of the robot, of a rig as diagnosed, and of its simulation."""
        near = self.simulation.touching
        return (touch_of_robot(self.dataset.recording, self.simulation, rig, near),
                touch_of_simulation(self.simulated, self.simulation, self.tool.simulated))


class PairSource(Source):
    """
    Compares the robot's wrench with what another simulator recorded, along the measured motion.

    Parameters
    ----------
    rig : Rig
        Gives the tolerances.
    simulated : Recording
        What the simulator recorded of the commands of the first recording, and of the second.
    """

    task = 'comparing the wrench with the simulated'
    explained_by = 'simulated recording'
    ready: tuple[PairReady, ...] = ()

    def __init__(self, rig: Rig, *simulated: Recording) -> None:
        super().__init__(rig, 'm/s^2')
        self._simulated = simulated
        self._contact: Contact | None = None

    def prepare(self, recordings: Sequence[Recording]) -> Sequence[Ready]:
        """Align each pair, and identify the simulator's tool from the first."""
        pairs: list[PairReady] = []
        for real, simulated in zip(recordings, self._simulated):
            pairs.append(_prepare(real, simulated, pairs[0].tool if pairs else None, self.rig))
        return pairs

    def search(self) -> Outcome:
        """Search in free motion, and compare contact."""
        outcome, self._contact = super().search(), None
        touching = [one for one in self.ready if one.simulation.touching.any()]
        if outcome.selection is None or not touching:
            return outcome
        robot, simulated = map(joined, zip(*(one.touches(outcome.rig) for one in touching)))
        self._contact = compare_contact(robot, simulated, self.rig.spreads, outcome.selection)
        return replace(outcome, diagnosis=with_contact(outcome.diagnosis, self._contact))

    def explain(self, diagnosis: Diagnosis, outcome: Outcome) -> Diagnosis:
        """Add recalibrations, how the recordings were compared and how the motions differ."""
        contact, apart = self._contact, self.ready[0].tracking.size
        moved = (note for note in recalibration_notes(outcome, self.unit) if BIAS not in note)
        return replace(
            diagnosis, reason=f'{diagnosis.reason}; the motion differs by {apart} from the '
            'simulated one',
            notes=(*diagnosis.notes, *moved, *_about(self.ready, outcome),
                   *(contact.notes() if contact else ()), UNTESTED),
            not_compared=(
                *((f'{max(contact.seconds):.1f} s of contact',)
                  if contact and contact.why_not else ()),
                f'the motions, {apart} apart (--mujoco and --simulator compare them)'))

    def details(self, outcome: Outcome) -> dict[str, Any]:
        """Return the simulator's tool, and how the motions differ."""
        if not self.ready:
            return {}
        found, contact = self.ready[0].tool, self._contact
        tool = found.rigid_tool.tool
        return {
            **({'contact': contact.document()} if contact else {}),
            'simulated_tool': {'mass': tool.mass, 'com': list(tool.com),
                               'inertia': [list(row) for row in tool.inertia],
                               'left': dict(zip(('force', 'torque'), found.unexplained))},
            'tracking': [{
                'aligned_by': one.alignment.by, 'correlation': one.alignment.correlation,
                **{name: part.document() for name, part in one.tracking._asdict().items()}}
                         for one in self.ready]}


def _prepare(real: Recording, simulated: Recording, tool: SimulatedTool | None, rig: Rig
             ) -> PairReady:
    stamps = even_stamps(real)
    try:
        made = computed(simulated)
    except DataError as error:
        raise DataError(f'the simulated recording: {error}') from error
    for one, whose in ((stamps.recording, "the robot's"), (made, 'the simulated')):
        require_wrench_and_pose(one, f'{whose} recording lacks wrench or measured pose; record '
                                'wrench and current_pose in both')
    made, alignment = align(stamps.recording, made)
    measured, pose = stamps.recording.pose, made.pose
    assert measured is not None
    assert pose is not None
    pose = express_in_base(measured, pose)
    compared, made, note = keep_comparable_imus(stamps.recording, replace(made, pose=pose))
    tracking = compare_motions(measured, pose, alignment.by != 'pose')
    # what is beyond a rigid tool comes with the motion, by so much later
    made = shift_times(made, tracking.delay)
    dataset, tool = prepare_pair(compared, made, tool, rig)
    return PairReady(dataset, stamps, keep_compared_streams(real, dataset.measured.streams),
                     (note,) if note else (), alignment=alignment, tool=tool, simulated=made,
                     tracking=tracking)


def prepare_pair(recording: Recording, simulated: Recording, tool: SimulatedTool | None,
                 rig: Rig) -> tuple[Dataset, SimulatedTool]:
    """
    Make a recording of the robot, and its simulator's, ready; all blocks are for training.

    Parameters
    ----------
    recording, simulated : Recording
        With wrench and pose, on one clock.
    tool : SimulatedTool or None
        The simulator's tool if it is known already.
    rig : Rig
        Gives the tolerances.

    Returns
    -------
    Dataset
        Its pose is an input; accelerometers are compared if both have one, and nothing where the
        simulated tool touches something.
    SimulatedTool
        The simulator's tool.

    Raises
    ------
    DataError
        Wrench and pose overlap for too short a time.
    """
    first, n = span(recording, simulated, margin=MARGIN_S)
    known = tool or simulated_tool(simulated, first, n, rig)
    require_axes_of(known.rigid_tool, recording, other_tool=SIMULATE_IT)
    moved = replace(recording, accelerometer=None)
    simulation = RecordedSimulation(moved, simulated, first, n, 'acc1', known.simulated)
    if tool is None:
        known = known.zeroed(beyond(moved, simulation.signals(known.rigid_tool)))
    groups = motion_groups(simulation.signals(known.rigid_tool))
    dataset = motion_dataset(recording, simulation, known.rigid_tool, groups,
                             recording.accelerometer)
    simulation.touching |= touching_of_robot(moved, simulation, known.rigid_tool)
    dataset.measured.present[simulation.touching] = False
    return dataset, known


def _about(pairs: Sequence[PairReady], outcome: Outcome) -> Iterator[str]:
    """Report how the recordings were compared, and how the motions differ."""
    force, torque = pairs[0].tool.unexplained
    # more than the noise of a good sensor [N]
    if force > 0.1 and not any(one.simulation.touching.any() for one in pairs):
        yield (f'{force:.2g} N and {torque:.2g} N m of the simulated wrench are not those of a '
               'rigid tool (contact, backlash, an implicit integrator, noise or another frame); '
               'they are compared unchanged')
    bias = [median + outcome.recalibrations.get(f'{BIAS}.{i}', (0.0, 0.0))[0]
            for i, median in enumerate(pairs[0].tool.zero)]
    yield (f'bias of the wrench against the simulated: {sizes(bias[:3], "N")} and '
           f'{sizes(bias[3:], "N m")} (x, y, z); removed')
    yield from dict.fromkeys(note for one in pairs for note in one.notes)
    for one in pairs:
        for name, part, unit in zip(one.tracking._fields, one.tracking, ('mm', 'mrad')):
            motion = f'{name}: {1e3 * part.rms:.2g} {unit} from the simulated'
            yield motion + (' after alignment: a delay of the robot is not identifiable unless '
                            'both recordings hold target_frame or joint_commands'
                            if one.alignment.by == 'pose' else part.delay_words(unit))


MIN_CORRELATION = 0.98
"""
Correlation of the speeds of two recordings of one motion, at least: an arm in MuJoCo with half the
gains and no friction kept 0.9999 with its simulation, a motion of the same kind but half a radian
off in phase had 0.95 to 0.96, four random motions of that arm 0.54 to 0.62 with each other.
"""

CLOCKS = (('target', 'commands'), ('joint_commands', 'commands'), ('pose', 'motions'))
"""Streams that two recordings are aligned by, the first that both hold, and what they hold."""


class Alignment(NamedTuple):
    """
    How a simulated recording was brought to the clock of the robot's.

    Attributes
    ----------
    shift : float
        Added to the simulated stamps [s].
    by : str
        ``target`` or ``joint_commands`` if both hold these commands: a delay of the robot is then
        its own. Else ``pose``: the motions are aligned, and a common delay cannot show.
    correlation : float
        Of the speeds.
    """

    shift: float
    by: str
    correlation: float


def align(recording: Recording, simulated: Recording) -> tuple[Recording, Alignment]:
    """
    Bring a simulated recording to the clock of the robot's.

    Parameters
    ----------
    recording : Recording
        Of the robot.
    simulated : Recording
        Of the simulator, driven by the same commands.

    Returns
    -------
    Recording
        The simulated one, its times counted as the robot's are.
    Alignment

    Raises
    ------
    DataError
        Neither commands nor poses are in both, or they are not of the same motion.
    """
    for by, what in CLOCKS:
        speeds = _speeds(getattr(recording, by), getattr(simulated, by))
        if all(speed is not None and speed[1].any() for speed in speeds):
            break
    else:
        raise DataError('the two recordings cannot be aligned: neither commands nor poses that '
                        'move are in both; record target_frame or joint_commands in both')
    one, other = (speed for speed in speeds if speed is not None)
    shift, correlation = _best_shift(one, other)
    if correlation < MIN_CORRELATION:
        raise DataError(
            f'the {what} of the simulated recording are not those of the robot: their speeds '
            f'correlate by {below(correlation, MIN_CORRELATION, 2)}, expected {MIN_CORRELATION:g} '
            'or more; run the simulator with the recorded commands')
    return shift_times(simulated, shift), Alignment(shift, by, correlation)


def shift_times(recording: Recording, shift: float) -> Recording:
    """Add so many seconds to all times of a recording."""
    changed: dict[str, Any] = {}
    for field in fields(recording):
        part = getattr(recording, field.name)
        if isinstance(part, Stream | PoseStream | JointStream):
            changed[field.name] = replace(part, t=part.t + shift)
    phases = tuple(Phase(p.name, p.start + shift, p.end + shift) for p in recording.phases)
    return replace(recording, **changed, phases=phases)


_Speed = tuple[float, Array] | None


def _speeds(one: Any, other: Any) -> tuple[_Speed, _Speed]:
    """Return the speeds of two streams of poses, or of those joints that both have."""
    if isinstance(one, JointStream) and isinstance(other, JointStream):
        common = [name for name in one.names if name in other.names]
        if common:
            one, other = (replace(s, values=s.values[:, [s.names.index(n) for n in common]])
                          for s in (one, other))
        elif one.values.shape[1] != other.values.shape[1]:
            return None, None
    return _speed(one), _speed(other)


def _speed(stream: PoseStream | JointStream | None) -> tuple[float, Array] | None:
    """Return when a grid of blocks begins, and the speed in each: the same in any base."""
    if stream is None or len(stream) < 20:
        return None
    n = max(2, int((stream.t[-1] - stream.t[0]) / BLOCK))
    t = stream.t[0] + BLOCK * np.arange(n)
    if isinstance(stream, JointStream):
        q = np.stack([np.interp(t, stream.t, x) for x in np.nan_to_num(stream.values).T], axis=1)
        speed = np.linalg.norm(np.diff(q, axis=0), axis=1)
    else:
        there = stream.at(t)
        p, R = there.position, there.R_base_sensor
        turns = rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:])
        # at the length of a tool, 0.2 m, turning counts as much as moving
        speed = (0.2 * np.linalg.norm(turns, axis=1)
                 + np.linalg.norm(np.diff(np.nan_to_num(p), axis=0), axis=1))
    return float(t[0]), np.asarray(gaussian_filter1d(speed, 0.02 / BLOCK) / BLOCK)


def _best_shift(one: tuple[float, Array], other: tuple[float, Array]) -> tuple[float, float]:
    """Return by how much the other has to be shifted, and how well they then correlate."""
    (start, a), (its_start, b) = one, other
    product = correlate(a - a.mean(), b - b.mean(), method='fft')
    coarse = start - its_start + BLOCK * (int(np.argmax(product)) - (len(b) - 1))
    spline = CubicSpline(its_start + BLOCK * np.arange(len(b)), b)
    t = start + BLOCK * np.arange(len(a))

    def unlike(shift: float) -> float:
        at = t - shift
        both = (at >= its_start) & (at <= spline.x[-1])
        if both.sum() < 20 or not a[both].std():
            return 1.0
        there = spline(at[both])
        return 1.0 - float(np.corrcoef(a[both], there)[0, 1]) if there.std() else 1.0

    fine = minimize_scalar(unlike, bounds=(coarse - 2 * BLOCK, coarse + 2 * BLOCK),
                           method='bounded', options={'xatol': 1e-6})
    return float(fine.x), 1.0 - float(fine.fun)
