"""The sequences that the sequencer can run, by name: for a calibration, and for a diagnosis."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.motion.plan import (
    calibration_plan,
    contact_plan,
    Goal,
    Segment,
    step_segments,
    Timing,
)
from forcecal_ros.motion.profiles import Pose
import numpy as np

SWEEP = ((0.020, 0.6), (0.014, 0.4), (0.009, 0.25), (0.006, 0.17), (0.004, 0.13), (0.003, 0.1))
"""Distance [m] and duration [s] of each move of a sweep, made out and back: slow first, fast
last."""

SHAKE = ((4e-4, 0.028), (3e-4, 0.024), (1.8e-4, 0.020))
"""Distance [m] and duration [s] of moves at 18 Hz to 25 Hz, which tell a delay from a low-pass."""

TURN = ((0.15, 0.6), (0.10, 0.4), (0.05, 0.25), (0.02, 0.15))
"""Angle [rad] and duration [s] of each rotation of a sweep, made out and back."""

TILT = (0.35, 2.5)
"""Largest angle [rad] and duration [s] of the slow rotations about y of ft_sensor, in both senses,
which let gravity pull along x."""

SLOW_REVERSAL = (0.02, 2.0)
"""Distance [m] and duration [s] of the slow reversals along x of ft_sensor."""

PUSH = (0.03, 0.25)
"""Share of the distance to what is touched that is moved in contact, and its duration [s]."""


def diagnosis_plan(goals: Mapping[str, Goal], away: Goal, timing: Timing
                   ) -> tuple[Segment, ...]:
    """
    Excite every effect that a diagnosis knows.

    Parameters
    ----------
    goals : mapping
        The first is where steps, sweeps and reversals are made.
    away : Pose or ndarray
        What is touched, where ``timing.contacts`` asks for that. Of joint vectors, the end of the
        longest sweep.
    """
    names = list(goals)
    home = goals[names[0]]
    plan = [Segment('move', f'to {names[0]}', home), Segment('settle', names[0]),
            Segment('measure', names[0], duration=timing.rest)]
    for name in names[1:]:
        plan += [Segment('move', f'to {name}', goals[name]), Segment('settle', name),
                 Segment('measure', name, duration=timing.measure)]
    plan += [Segment('move', f'to {names[0]}', home), Segment('settle', names[0])]
    step = _forward(home, away, timing.amplitude * timing.step_distance)
    plan += timing.steps * step_segments(home, step, timing)
    plan += _sweeps(home, away, timing)
    plan += timing.reversals * _reversals(home, away, timing.amplitude)
    for _ in range(int(timing.contacts)):
        plan += _touch(home, away, timing)
    plan += [Segment('settle', names[0]),
             Segment('measure', names[0], duration=timing.measure)]
    return tuple(plan)


def _out_and_back(phase: str, label: str, home: Goal, goal: Goal, duration: float
                    ) -> list[Segment]:
    return [Segment(phase, f'{label} out', goal, duration),
            Segment(phase, f'{label} back', home, duration)]


def _sweeps(home: Goal, away: Goal, timing: Timing) -> list[Segment]:
    if not isinstance(home, Pose):
        return timing.sweeps * [
            segment for share, (_, duration) in zip((1.0, 0.7, 0.45, 0.3, 0.2, 0.15), SWEEP)
            for segment in _out_and_back(
                'sweep', 'joints', home, _between(home, away, timing.amplitude * share),
                3.0 * duration)]
    out = []
    for i, axis in enumerate('xyz'):
        out += timing.sweeps * _moves(axis, home, i, timing.amplitude, SWEEP)
    for i, axis in (1, 'y'), (2, 'z'):
        for one in SHAKE:
            out += timing.shakes * _moves(f'{axis} quickly', home, i, timing.amplitude, (one,))
    for i, axis in enumerate('xyz'):
        for angle, duration in timing.turns * TURN:
            goal = _rotated(home, i, timing.amplitude * angle)
            out += _out_and_back('sweep', f'about {axis}', home, goal, duration)
    return out


def _moves(label: str, home: Pose, axis: int, amplitude: float,
           rows: tuple[tuple[float, float], ...]) -> list[Segment]:
    """Go along an axis of ft_sensor, out and back by each distance [m] in each duration [s]."""
    way = amplitude * home.R_base_sensor[:, axis]
    return [segment for distance, duration in rows for segment in _out_and_back(
        'sweep', label, home, Pose(home.position + distance * way, home.R_base_sensor), duration)]


def _reversals(home: Goal, away: Goal, amplitude: float) -> list[Segment]:
    if not isinstance(home, Pose):
        return 2 * _out_and_back('reverse', 'joints', home,
                                 _between(home, away, 0.5 * amplitude), 3.0)
    out: list[Segment] = []
    largest, duration = TILT
    for share in (1.0, -1.0, 0.5, -0.5):
        goal = _rotated(home, 1, share * amplitude * largest)
        out += _out_and_back('reverse', 'about y', home, goal, duration)
    distance, duration = SLOW_REVERSAL
    return out + 2 * _out_and_back(
        'reverse', 'x', home, _forward(home, away, amplitude * distance), duration)


def _touch(home: Goal, away: Goal, timing: Timing) -> list[Segment]:
    share, duration = PUSH
    less = _between(home, away, 1.0 - share)
    push = [Segment('contact', 'less', less, duration), Segment('contact', 'more', away, duration)]
    return [Segment('approach', 'out', away, timing.approach),
            Segment('contact', 'hold', duration=timing.contact), *push, *push,
            Segment('contact', 'hold', duration=0.5 * timing.contact),
            Segment('retract', 'back', home, timing.approach), Segment('settle', 'home')]


def _forward(home: Goal, away: Goal, distance: float) -> Goal:
    """Return the pose ``distance`` [m] along x of ft_sensor; of joint vectors, ``away``."""
    if not isinstance(home, Pose):
        return away
    return Pose(home.position + distance * home.R_base_sensor[:, 0], home.R_base_sensor)


def _rotated(home: Pose, axis: int, angle: float) -> Pose:
    return Pose(home.position, home.R_base_sensor @ rotation_from_vector(angle * np.eye(3)[axis]))


def _between(home: Goal, away: Goal, share: float) -> Goal:
    if isinstance(home, Pose):
        assert isinstance(away, Pose)
        return Pose(home.position + share * (away.position - home.position), home.R_base_sensor)
    assert isinstance(away, np.ndarray)
    return np.asarray(home + share * (away - home))


class Program(NamedTuple):
    """
    A sequence that can be run.

    Attributes
    ----------
    plan : callable
        Makes the segments of goals, a goal away from the first, and timing.
    distance : callable
        How far away that one is along x of ft_sensor, from the timing [m].
    identifies : bool
        Whether a calibration is identified from it.
    """

    plan: Callable[[Mapping[str, Goal], Goal, Timing], tuple[Segment, ...]]
    distance: Callable[[Timing], float]
    identifies: bool


SEQUENCES: Mapping[str, Program] = {
    'calibrate': Program(calibration_plan, lambda timing: timing.step_distance, True),
    'contact': Program(contact_plan, lambda timing: timing.contact_distance, False),
    'diagnose': Program(diagnosis_plan, lambda timing: timing.contact_distance, False),
}
"""Every sequence by its name in the parameter ``sequence``."""
