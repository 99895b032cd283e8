"""A recording sequence for a rig, and what it is good for."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.core.geometry import rotation_about
from forcecal_ros.core.streams import Phase, PoseStream
from forcecal_ros.diagnose.plan.excitation import CLEAR, Excitation, excitation
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.motion.limits import check_move, Limits, pace_within, share_allowed
from forcecal_ros.motion.plan import diagnosis_plan, prepare, preview, Segment, Timing
from forcecal_ros.motion.poses import nominal_poses, orientation, step_goal
from forcecal_ros.motion.profiles import Move, Pace, Pose, shortest_duration
import numpy as np

PRESS = 0.006
"""How far the tip is sent beyond the wall [m]."""

SETTLE = 0.5
"""How long the tool is expected to settle [s]."""


LONG_REST = 15.0
"""Rest at the beginning where effects are asked for that only time shows [s]: a drift of 0.02 N/s
adds up to 0.3 N, the tolerance of a bias."""

PARTS: Mapping[str, frozenset[str]] = {
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
    """A sequence, what it shows, and the effects that it was asked for; none: all."""

    motion: PlannedMotion
    excitation: Excitation
    asked: tuple[str, ...] = ()

    @property
    def unclear(self) -> list[str]:
        """Effects asked for that do not show clearly, or look like another one of them."""
        asked = [s for s in self.excitation.shown if s.name in self.asked]
        confounded = {name for a in self.excitation.aliases if {a.one, a.other} <= set(self.asked)
                      for name in (a.one, a.other)}
        return [s.name for s in asked if s.name in confounded or (
            s.energy < CLEAR and set(s.excited_by) & {p.name for p in self.motion.phases})]


def plan_for(rig: Rig, *, contact: bool, effects: Collection[str] = (),
             limits: Limits | None = None) -> Planned:
    """
    Plan a recording for a rig, as :func:`motion_for` does, and say what it shows.

    Where effects are asked for, it has the parts that they need, and all parts where one of them
    shows clearly with all alone.
    """
    def planned(names: Collection[str]) -> Planned:
        motion = motion_for(rig, contact=contact, effects=names, limits=limits)
        return Planned(motion, excitation(rig, motion.target, motion.phases), tuple(effects))

    brief = planned(effects)
    if not effects or not brief.unclear:
        return brief
    full = planned(())
    return full if len(full.unclear) < len(brief.unclear) else brief


def parts_for(effects: Collection[str]) -> frozenset[str]:
    """Return the parts of a sequence that effects need; without any, all of them."""
    if not effects:
        return frozenset({'poses', 'shakes'}).union(*PARTS.values())
    parts: frozenset[str] = frozenset()
    for phases in (frozenset(EFFECTS[name].excited_by) for name in effects):
        if {'measure', 'move', 'sweep', 'reverse'} <= phases:  # any motion shows it
            parts |= {'poses', 'sweeps', 'turns'}
            continue
        parts = parts.union(*(PARTS.get(phase, frozenset()) for phase in phases))
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
    return replace(usual, **counts, rest=LONG_REST if 'rest' in parts else usual.rest)


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
    poses, left_out = _allowed(poses, pace, limits)
    far = -np.inf
    if contact:
        timing, far = _touching(rig, replace(timing, contacts=2 - brief))

    def segments(timing: Timing) -> tuple[Segment, ...]:
        return diagnosis_plan(poses, step_goal(home, timing.contact_distance), timing)

    timing = replace(timing, amplitude=_amplitude(segments(timing), limits))
    wide = replace(limits, workspace_max=np.maximum(limits.workspace_max, [far, -np.inf, -np.inf]))
    target, phases = preview(prepare(segments(timing), home, pace, wide),
                             1.0 / rig.robot.period, SETTLE)
    return PlannedMotion(poses, timing, limits, pace, target, phases, far, left_out)


def _touching(rig: Rig, timing: Timing) -> tuple[Timing, float]:
    """Return how far the wall is, and the X that the box has to reach beyond it [m]."""
    home = home_of(rig)
    reach = home.position + home.R_base_sensor @ np.array(rig.tool.tip)
    way = rig.wall.position + PRESS - float(reach[0])
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


def _allowed(poses: Mapping[str, Pose], pace: Pace, limits: Limits
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
