"""A sequence that excites what a simulator may leave out: poses, a step, sweeps, reversals."""

from collections.abc import Mapping

from forcecal_ros.geometry import rotation_from_vector
from forcecal_ros.motion.plan import Goal, Segment, step_segments, Timing
from forcecal_ros.motion.profiles import Pose
import numpy as np

SWEEP = ((0.020, 0.6), (0.014, 0.4), (0.009, 0.25), (0.006, 0.17), (0.004, 0.13), (0.003, 0.1))
"""Distance [m] and duration [s] of each move of a sweep, made out and back: slow first, fast
last."""

SHAKE = ((4e-4, 0.028), (3e-4, 0.024), (1.8e-4, 0.020))
"""Distance [m] and duration [s] of moves at 18 Hz to 25 Hz, which tell a delay from a low-pass."""

SHAKE_REPEATS = 15
"""How often each move of the shaking goes out and back: 0.6 s to 0.8 s at its frequency."""

TURN = ((0.15, 0.6), (0.10, 0.4), (0.05, 0.25), (0.02, 0.15))
"""Angle [rad] and duration [s] of each rotation of a sweep, made out and back."""

TILT = (0.35, 2.5)
"""Largest angle [rad] and duration [s] of the slow rotations about y of ft_sensor, in both senses,
which let gravity pull along x."""

SLOW_REVERSAL = (0.02, 2.0)
"""Distance [m] and duration [s] of the slow reversals along x of ft_sensor."""

PUSH = (0.03, 0.25)
"""Share of the distance to what is touched that is moved in contact, and its duration [s]."""

REST = 3.0
"""Rest at the beginning, in which the noise is measured, in multiples of ``timing.measure``."""


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
            Segment('measure', names[0], duration=REST * timing.measure)]
    for name in names[1:]:
        plan += [Segment('move', f'to {name}', goals[name]), Segment('settle', name),
                 Segment('measure', name, duration=timing.measure)]
    plan += [Segment('move', f'to {names[0]}', home), Segment('settle', names[0]),
             *step_segments(home, _forward(home, away, timing.step_distance), timing)]
    plan += _sweeps(home, away)
    plan += _reversals(home, away)
    for _ in range(int(timing.contacts)):
        plan += _touch(home, away, timing)
    plan += [Segment('settle', names[0]),
             Segment('measure', names[0], duration=timing.measure)]
    return tuple(plan)


def _out_and_back(phase: str, label: str, home: Goal, goal: Goal, duration: float
                    ) -> list[Segment]:
    return [Segment(phase, f'{label} out', goal, duration),
            Segment(phase, f'{label} back', home, duration)]


def _sweeps(home: Goal, away: Goal) -> list[Segment]:
    out: list[Segment] = []
    if not isinstance(home, Pose):
        for share, (_, duration) in zip((1.0, 0.7, 0.45, 0.3, 0.2, 0.15), SWEEP):
            out += _out_and_back('sweep', 'joints', home, _between(home, away, share),
                                   3.0 * duration)
        return out
    for i, axis in enumerate('xyz'):
        for distance, duration in SWEEP:
            goal = Pose(home.position + distance * home.R_base_sensor[:, i], home.R_base_sensor)
            out += _out_and_back('sweep', axis, home, goal, duration)
    for i, axis in (1, 'y'), (2, 'z'):
        for distance, duration in SHAKE:
            goal = Pose(home.position + distance * home.R_base_sensor[:, i], home.R_base_sensor)
            out += SHAKE_REPEATS * _out_and_back('sweep', f'{axis} quickly', home, goal, duration)
    for i, axis in enumerate('xyz'):
        for angle, duration in TURN:
            goal = _rotated(home, i, angle)
            out += _out_and_back('sweep', f'about {axis}', home, goal, duration)
    return out


def _reversals(home: Goal, away: Goal) -> list[Segment]:
    if not isinstance(home, Pose):
        return 2 * _out_and_back('reverse', 'joints', home, _between(home, away, 0.5), 3.0)
    out: list[Segment] = []
    largest, duration = TILT
    for angle in (largest, -largest, 0.5 * largest, -0.5 * largest):
        out += _out_and_back('reverse', 'about y', home, _rotated(home, 1, angle), duration)
    distance, duration = SLOW_REVERSAL
    for _ in range(2):
        out += _out_and_back('reverse', 'x', home, _forward(home, away, distance), duration)
    return out


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
