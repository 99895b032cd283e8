"""What to record for a diagnosis: a sequence, what it shows, what separates two effects."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
import math
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.core.geometry import Array, rotation_about
from forcecal_ros.core.quantity import rounded, scaled
from forcecal_ros.core.streams import Phase, PoseStream
from forcecal_ros.diagnose.dataset import split_by_phase
from forcecal_ros.diagnose.judge.coverage import VISIBLE_ENERGY
from forcecal_ros.diagnose.model.hypotheses import CLIPPING, hypotheses, Hypothesis
from forcecal_ros.diagnose.model.jacobian import Column
from forcecal_ros.diagnose.model.linearised import linearised_model, LinearisedModel
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.sources.rig import prepare_commanded
from forcecal_ros.effects import applicable, Effect, EFFECTS, Quantity
from forcecal_ros.effects.rig import Rig
from forcecal_ros.motion.limits import check_move, Limits, pace_within, share_allowed
from forcecal_ros.motion.optimal_design import sequencer_parameters
from forcecal_ros.motion.plan import diagnosis_plan, prepare, preview, Segment, Timing
from forcecal_ros.motion.profiles import (
    Move,
    nominal_poses,
    orientation,
    Pace,
    Pose,
    shortest_duration,
    step_goal,
)
from forcecal_ros.sim.rig.simulator import simulate
from forcecal_ros.sim.signals import UNSEEN
import numpy as np
from numpy.typing import NDArray

CLEAR_ENERGY = 80.0
"""Whitened energy from which a plan shows an effect clearly."""

CONFOUNDED_DEG = 20.0
"""Angle below which the directions of two effects are confounded: hard to separate [deg]."""


class Visibility(NamedTuple):
    """
    How well one effect shows.

    Attributes
    ----------
    size : str
        Of the parameter that shows best: what the energy is stated at.
    energy : float
        Whitened, nuisances taken out as far as their tolerances allow; NaN where stamps or values
        show it without a model.
    weakest : str
        Parameter of it that shows worst.
    excited_by : tuple of str
        Phases.
    """

    name: str
    size: str
    energy: float
    weakest: str
    weakest_energy: float
    excited_by: tuple[str, ...]

    @property
    def word(self) -> str:
        """How well, in a word."""
        if np.isnan(self.energy):
            return 'by its stamps or values'
        return ('clearly' if self.energy >= CLEAR_ENERGY else
                'barely' if self.energy >= VISIBLE_ENERGY else 'not')


class Alias(NamedTuple):
    """Two effects that come close to each other, and the angle between them."""

    one: str
    other: str
    angle_deg: float


def excitation(rig: Rig, target: PoseStream, phases: tuple[Phase, ...]
               ) -> tuple[tuple[Visibility, ...], tuple[Alias, ...]]:
    """
    Judge a sequence for a rig by simulating it.

    Parameters
    ----------
    target : PoseStream
        Commands.

    Returns
    -------
    shown : tuple of Visibility
        Every effect that applies to the rig.
    aliases : tuple of Alias
        Closest first.
    """
    recording = replace(simulate(rig, target, seed=0), phases=phases)
    model = linearised_model(rig, (split_by_phase(prepare_commanded(recording, rig)),))
    tried = hypotheses(model)
    found = {h.name: _directions(model, h) for h in tried}
    information, parts = _information(model, found)
    energy = np.diag(information)
    shown = [_visibility(h.effect, found[h.name], energy[parts[h.name]]) for h in tried]
    for name, effect in EFFECTS.items():
        if name not in found and applicable(effect, rig):
            none = np.nan if name in (*UNSEEN, *CLIPPING) else 0.0
            shown.append(Visibility(name, '', none, '', none, effect.excited_by))
    order = list(EFFECTS)
    return (tuple(sorted(shown, key=lambda s: order.index(s.name))),
            _aliases(information, parts))


class _Direction(NamedTuple):
    """One thing that an effect can do: a column and its scale, of a parameter's typical size."""

    column: Column
    scale: float
    quantity: Quantity
    size: float


def _directions(model: LinearisedModel, h: Hypothesis) -> list[_Direction]:
    """Return the directions of an effect; one that lifts nuisances' priors has theirs."""
    if not h.releases:
        atom = h.atoms[0]
        return [_Direction(one, 1.0, h.effect.parameters[i], float(atom.start[i]))
                for one, i in zip(atom.columns[0], atom.free)]
    released = [i for i, n in enumerate(model.nuisances) if n.name in h.releases[0]]
    return [_Direction(model.jacobian[0][i], (q.typical - q.nominal) / float(model.prior_std[i]),
                       q, q.typical) for q, i in zip(h.effect.parameters, released)]


def _information(model: LinearisedModel, found: Mapping[str, list[_Direction]]
                 ) -> tuple[Array, dict[str, NDArray[np.intp]]]:
    """Return the information of all typical sizes, and where each effect's are in it."""
    m, every = len(model.nuisances), [one for several in found.values() for one in several]
    size = np.append(np.ones(m), [one.scale for one in every])
    matrix = model.gram([[one.column for one in every]]).matrix * np.outer(size, size)
    # nuisances are taken out as far as their nominal tolerances allow
    projected = matrix - matrix[:, :m] @ np.linalg.solve(matrix[:m, :m] + np.eye(m), matrix[:m])
    ends = m + np.cumsum([len(several) for several in found.values()])
    return np.asarray(projected), {name: np.arange(end - len(several), end)
                                   for (name, several), end in zip(found.items(), ends)}


def _visibility(effect: Effect, directions: list[_Direction], energy: Array) -> Visibility:
    best, worst = int(energy.argmax()), int(energy.argmin())
    q, size = directions[best].quantity, directions[best].size
    shown, factor = scaled(size, q.unit)
    return Visibility(effect.name, f'{q.name} {factor * size:.3g} {shown}', float(energy[best]),
                      directions[worst].quantity.name, float(energy[worst]), effect.excited_by)


def _aliases(information: Array, parts: Mapping[str, NDArray[np.intp]]) -> tuple[Alias, ...]:
    seen = {name: part[np.diag(information)[part] > VISIBLE_ENERGY]
            for name, part in parts.items()}
    pairs = combinations([name for name, part in seen.items() if len(part)], 2)
    angles = (Alias(one, other, _angle(information, seen[one], seen[other]))
              for one, other in pairs)
    return tuple(sorted((a for a in angles if a.angle_deg < CONFOUNDED_DEG),
                        key=lambda a: a.angle_deg))


def _angle(information: Array, one: NDArray[np.intp], other: NDArray[np.intp]) -> float:
    """Smallest angle between what two effects can do [deg]."""
    cosines = np.linalg.svd(_whitened(information, one).T
                            @ information[np.ix_(one, other)]
                            @ _whitened(information, other), compute_uv=False)
    return float(np.degrees(np.arccos(np.clip(cosines.max(), 0.0, 1.0))))


def _whitened(information: Array, part: NDArray[np.intp]) -> Array:
    values, vectors = np.linalg.eigh(information[np.ix_(part, part)])
    kept = values > 1e-9 * values.max()
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))


SETTLE_S = 0.5
"""How long the tool is expected to settle [s]."""


LONG_REST_S = 15.0
"""Rest at the beginning where effects are requested that only time shows [s]: a drift of 0.02 N/s
adds up to 0.3 N, the tolerance of a bias."""

PARTS_OF_PHASE: Mapping[str, frozenset[str]] = {
    'measure': frozenset({'poses'}), 'step': frozenset({'steps'}),
    'sweep': frozenset({'sweeps', 'turns'}), 'reverse': frozenset({'reversals'})}
"""Parts of a sequence by the phase as which they are recorded."""


class PlannedMotion(NamedTuple):
    """
    A sequence as it will be commanded.

    Attributes
    ----------
    limits : Limits
        Those of the sequencer.
    reach : float
        How far out in X the box has to go for contact [m]; -inf without.
    left_out : tuple of str
        Poses that the limits forbid.
    """

    poses: Mapping[str, Pose]
    timing: Timing
    limits: Limits
    pace: Pace
    target: PoseStream
    phases: tuple[Phase, ...]
    reach: float = -np.inf
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class Planned:
    """
    A sequence, what it shows, and the effects that it was requested for.

    Attributes
    ----------
    shown : tuple of Visibility
        Every effect that applies to the rig.
    aliases : tuple of Alias
        Closest first.
    requested : tuple of str
        None: all.
    """

    motion: PlannedMotion
    shown: tuple[Visibility, ...]
    aliases: tuple[Alias, ...]
    requested: tuple[str, ...] = ()

    @property
    def of_interest(self) -> list[Visibility]:
        """What it shows of the effects requested."""
        return [s for s in self.shown if not self.requested or s.name in self.requested]

    @property
    def confounded(self) -> list[Alias]:
        """The pairs that are hard to separate, of the effects requested."""
        return [a for a in self.aliases
                if not self.requested or {a.one, a.other} & set(self.requested)]

    @property
    def unclear(self) -> list[str]:
        """Effects requested that do not show clearly, or look like another one of them."""
        confounded = {name for a in self.aliases
                      if {a.one, a.other} <= set(self.requested) for name in (a.one, a.other)}
        return [s.name for s in self.of_interest if s.name in confounded or (
            s.energy < CLEAR_ENERGY and set(s.excited_by) & {p.name for p in self.motion.phases})]


def plan_for(rig: Rig, *, contact: bool, effects: Collection[str] = (),
             limits: Limits | None = None) -> Planned:
    """
    Plan a recording for a rig, as :func:`motion_for` does, and say what it shows.

    Where effects are requested, it has the parts that they need, and all parts where one of them
    shows clearly with all alone.
    """
    def planned(names: Collection[str]) -> Planned:
        motion = motion_for(rig, contact=contact, effects=names, limits=limits)
        return Planned(motion, *excitation(rig, motion.target, motion.phases), tuple(effects))

    brief = planned(effects)
    if not effects or not brief.unclear:
        return brief
    full = planned(())
    return full if len(full.unclear) < len(brief.unclear) else brief


def parts_for(effects: Collection[str]) -> frozenset[str]:
    """Return the parts of a sequence that effects need; without any, all of them."""
    if not effects:
        return frozenset({'poses', 'shakes'}).union(*PARTS_OF_PHASE.values())
    parts: frozenset[str] = frozenset()
    for phases in (frozenset(EFFECTS[name].excited_by) for name in effects):
        if {'measure', 'move', 'sweep', 'reverse'} <= phases:  # any motion shows it
            parts |= {'poses', 'sweeps', 'turns'}
            continue
        parts = parts.union(*(PARTS_OF_PHASE.get(phase, frozenset()) for phase in phases))
        if 'measure' in phases and 'sweep' not in phases:
            parts |= {'rest'}
        if 'step' in phases and 'reverse' not in phases:  # lags, which quick moves tell apart
            parts |= {'shakes'}
    return parts


def timing_for(effects: Collection[str]) -> Timing:
    """Return the timing of a sequence with the parts that effects need."""
    parts, usual = parts_for(effects), Timing(measure=1.0)
    counts = {name: getattr(usual, name) if name in parts else 0
              for name in ('steps', 'sweeps', 'shakes', 'turns', 'reversals')}
    return replace(usual, **counts, rest=LONG_REST_S if 'rest' in parts else usual.rest)


def motion_for(rig: Rig, *, contact: bool, brief: bool = False, effects: Collection[str] = (),
               limits: Limits | None = None) -> PlannedMotion:
    """
    Plan the motion that shows a diagnosis what it needs.

    Parameters
    ----------
    rig : Rig
        From whose home it starts.
    contact : bool
        Whether the wall is to be touched.
    brief : bool
        Without slow reversals and turns, and with one touch instead of two.
    effects : collection of str
        It is to show; none: all.
    limits : Limits, optional
        Of the robot; distances and angles are reduced to what they allow. The default is that of
        the sequencer.

    Raises
    ------
    DataError
        The wall is not in front of the tool.
    MotionError
        The rig's home leaves no room within the limits.
    """
    timing, limits = timing_for(effects), limits or Limits(tip=np.array(rig.tool.tip))
    if brief:
        timing = replace(timing, reversals=0, turns=0)
    poses = poses_of(rig) if 'poses' in parts_for(effects) else {'v': home_of(rig)}
    home, pace = home_of(rig), pace_within(limits)
    poses, left_out = _allowed_poses(poses, pace, limits)
    far = -np.inf
    if contact:
        timing, far = _timing_with_contact(rig, replace(timing, contacts=2 - brief))

    def segments(timing: Timing) -> tuple[Segment, ...]:
        return diagnosis_plan(poses, step_goal(home, timing.contact_distance), timing)

    timing = replace(timing, amplitude=_amplitude(segments(timing), limits))
    wide = replace(limits, workspace_max=np.maximum(limits.workspace_max, [far, -np.inf, -np.inf]))
    target, phases = preview(prepare(segments(timing), home, pace, wide),
                             1.0 / rig.robot.period, SETTLE_S)
    return PlannedMotion(poses, timing, limits, pace, target, phases, far, left_out)


def _timing_with_contact(rig: Rig, timing: Timing) -> tuple[Timing, float]:
    """Return how far the wall is, and the X that the box has to reach beyond it [m]."""
    home = home_of(rig)
    reach = home.position + home.R_base_sensor @ np.array(rig.tool.tip)
    way = rig.wall.position + 0.006 - float(reach[0])  # 6 mm beyond the wall
    if not 0.0 < way < 0.5 or home.R_base_sensor[0, 0] < 0.9:
        raise DataError(f'the wall at X = {rig.wall.position:g} m is not in front of the tip '
                        f'at X = {reach[0]:.3f} m; plan without contact')
    return replace(timing, contact_distance=round(way, 4)), float(reach[0]) + way + 0.004


def _amplitude(segments: tuple[Segment, ...], limits: Limits) -> float:
    """Return the share of all distances and angles that the limits allow, at most 1."""
    shares, here = [1.0], segments[0].goal
    for segment in segments:
        if segment.goal is None:
            continue
        if segment.phase in ('step', 'sweep', 'reverse') and segment.duration:
            assert isinstance(here, Pose) and isinstance(segment.goal, Pose)
            shares.append(share_allowed(Move(here, segment.goal, segment.duration), limits))
        here = segment.goal
    return float(np.floor(1e4 * min(shares)) / 1e4)


def _allowed_poses(poses: Mapping[str, Pose], pace: Pace, limits: Limits
             ) -> tuple[dict[str, Pose], tuple[str, ...]]:
    """Return the poses that may be gone to, one after the other and back, and the other names."""
    home, *others = poses.items()
    allowed = dict([home])
    for name, pose in others:
        try:
            for one, other in (list(allowed.values())[-1], pose), (pose, home[1]):
                check_move(Move(one, other, shortest_duration(one, other, pace)), limits, name)
        except MotionError:
            continue
        allowed[name] = pose
    return allowed, tuple(name for name in poses if name not in allowed)


def home_of(rig: Rig) -> Pose:
    """Return the pose that a rig starts at."""
    return Pose(np.array(rig.home.position), rig.home.R_base_sensor)


def poses_of(rig: Rig) -> dict[str, Pose]:
    """Place the paper's poses at the rig's home, and three more that turn gravity sideways."""
    place, home = home_of(rig)
    nominal = nominal_poses()
    first = nominal['v'].R_base_sensor
    turns = {'v': np.eye(3), 'h': first.T @ nominal['h'].R_base_sensor,
             'tilt': first.T @ orientation(np.radians(-60.0), np.radians(105.0)),
             'left': rotation_about('x', 0.9), 'right': rotation_about('x', -0.9)}
    return {name: Pose(place, home @ turn) for name, turn in turns.items()}


NEEDS_CONTACT = 'it shows in contact only: add --contact'
COLUMNS = ('effect', 'at a size of', 'std. errors', 'shows', 'weakest')
"""What an effect's energy is the square of: how many standard errors of its parameter it is."""


def plan_text(planned: Planned) -> str:
    """Return what a sequence shows as a table, then what it could not show or separate."""
    rows = [COLUMNS, *map(_row, planned.of_interest)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(COLUMNS))]
    lines = ['  '.join(cell.rjust(w) if i == 2 else cell.ljust(w)
                       for i, (cell, w) in enumerate(zip(row, widths))).rstrip() for row in rows]
    lines += ['', f'closer than {CONFOUNDED_DEG:g} deg to each other, hard to separate:']
    lines += [f'  {a.one} / {a.other}: {a.angle_deg:.1f} deg' for a in planned.confounded] \
        or ['  none']
    return '\n'.join([*lines, *limitations(planned)])


def limitations(planned: Planned) -> list[str]:
    """Say which of the effects requested do not show, and what the limits took away."""
    lines, motion = [], planned.motion
    shown = {s.name: s for s in planned.shown}
    for name in planned.requested or shown:
        if name not in shown:
            lines.append(f'{name}: does not apply to a rig with a rigid tool')
        elif shown[name].energy < VISIBLE_ENERGY:
            why = (NEEDS_CONTACT if EFFECTS[name].excited_by == ('contact',) and not
                   motion.timing.contacts else 'these limits leave too little motion')
            lines.append(f'{name}: does not show; {why}')
    if motion.timing.amplitude < 1.0:
        lines.append(f'the limits allow {motion.timing.amplitude:.0%} of the usual distances')
    if motion.left_out:
        lines.append(f'outside the limits and left out: {", ".join(motion.left_out)}')
    return lines


def plan_document(planned: Planned) -> dict[str, Any]:
    """Return a plan as a dictionary."""
    return {
        'format': 'forcecal-plan/1',
        'duration': float(planned.motion.target.t[-1] - planned.motion.target.t[0]),
        'effects': [{
            'name': s.name, 'size': s.size, 'shows': s.word, 'excited_by': list(s.excited_by),
            'energy': None if math.isnan(s.energy) else s.energy, 'weakest': s.weakest,
            'weakest_energy': None if math.isnan(s.weakest_energy) else s.weakest_energy,
        } for s in planned.of_interest],
        'alike': [{'effects': [a.one, a.other], 'angle_deg': a.angle_deg}
                  for a in planned.confounded],
        'cannot': limitations(planned)}


def plan_parameters(planned: Planned) -> str:
    """
    Return a plan as a parameter file of the sequencer; the table stands in its comments.

    Returns
    -------
    str
        YAML.
    """
    m = planned.motion
    heading = f'Recording for forcecal diagnose.\n{plan_text(planned)}'
    return (sequencer_parameters('diagnose', m.poses, m.timing, m.pace, m.limits, heading)
            + wider_box(m.limits, m.reach))


def wider_box(limits: Limits, reach: float) -> str:
    """Return the comment with the box that contact needs, where that of the limits is smaller."""
    x, y, z = limits.workspace_max.tolist()
    if reach <= x:
        return ''
    return ('    # The path to the wall leaves the box. Check that the cell is free up to here,\n'
            '    # then uncomment these lines.\n    # limits:\n'
            f'    #   workspace_max: [{reach:.3f}, {y}, {z}]\n')


def _row(s: Visibility) -> tuple[str, str, str, str, str]:
    if math.isnan(s.energy):
        return s.name, '', '', s.word, ''
    weak = (f'{s.weakest}: {rounded(math.sqrt(s.weakest_energy))}'
            if s.weakest_energy < s.energy else '')
    return s.name, s.size, rounded(math.sqrt(s.energy)), s.word, weak


def advice(diagnosis: Diagnosis) -> str:
    """
    Say what to record next.

    Returns
    -------
    str
        One sentence with one phase of the planned sequence; empty where nothing is missing.
    """
    shown: dict[str, list[str]] = {}
    for name in diagnosis.not_excited:
        for phase in EFFECTS[name].excited_by if name in EFFECTS else ():
            shown.setdefault(phase, []).append(name)
    if not shown:
        return ''
    phase = max(shown, key=lambda one: len(shown[one]))
    contact = ' --contact' if phase == 'contact' else ''
    listed = ' and '.join(', '.join(shown[phase]).rsplit(', ', 1))
    return (f'Record phase {phase} of the sequence that forcecal plan{contact} -o plan.yaml '
            f'writes: it shows {listed}, which this recording cannot show.')
