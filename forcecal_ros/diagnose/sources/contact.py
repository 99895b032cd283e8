"""
Contact in two recordings: the law of the touched surface in each, and how the two differ.

At a point x of the tool, with n the surface's normal, f the force, d = -n x the depth along n and
v its rate, a surface at d0 of stiffness k, damping c and friction mu pushes by

    n f = k (d - d0) + c v,    f - (n f) n = -mu (n f) v_t / |v_t|.

The first is fitted as d = d0 + n f / k - (c / k) v: forces are measured better than depths, and
what is noisy must not be a regressor. The differences are weighed as effects of the library are.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.estimation import BLOCKS, jacobian, robust_fit
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.judge.named_effects import MAX_RELATIVE_STD, NamedEffect, Parameter
from forcecal_ros.diagnose.model.linearised import EFFECT
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.search.calibration import Features
from forcecal_ros.diagnose.search.posterior import listed_once, Posterior, weighed, WORTH
from forcecal_ros.diagnose.verdict import NAMED, percent, UNKNOWN
from forcecal_ros.effects import EFFECTS, named_effects, Quantity
from forcecal_ros.effects.library import FORCES
from forcecal_ros.effects.rig import NominalTolerances, Rig
from forcecal_ros.sim.measured_motion import contact_blocks, CONTACT_FORCE_N, RecordedSimulation
from forcecal_ros.sim.rigid_tool import beyond, CarriedTool, RigidTool
from forcecal_ros.sim.signals import BLOCK, block_means, RATE, slow
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag
from scipy.ndimage import binary_erosion, label
from scipy.stats import multivariate_normal

FRICTION = 'contact_friction'
"""The difference of two coefficients of friction: a rig's wall has none, so no library has it."""

QUANTITIES: Mapping[str, Quantity] = {
    **{name: EFFECTS[name].parameters[0]
       for name in ('contact_stiffness', 'contact_damping', 'wall_position')},
    FRICTION: Quantity('coefficient', '', 0.0, -2.0, 2.0, 0.1)}
"""Each difference by its name, in the order of the columns of all numbers here."""

UNITS = ('N/m', 'N s/m', 'm', '')
"""Of a surface's stiffness, damping, place along its normal, and friction."""

MIN_CONTACT_S = 0.5
"""Contact of each recording, at least, that makes a law [s]: one press."""

MIN_STIFFNESS_N_M = 500.0
"""Stiffness from which a force that only the robot has is contact [N/m]: no cable is as stiff."""

MIN_SLIDING_M_S = 0.003
"""Speed along a surface from which friction has a direction [m/s]: ten times poses' noise."""

MIN_SLIDE_M = 1e-3
"""RMS of a way along a surface that no force explains, from which its slope shows [m]."""

MIN_COSINE = 0.8
"""Cosine up to which forces are of one flat surface: 37 deg, a friction of 0.75."""

MAX_UNEXPLAINED, ROUGH_M = 0.45, 2e-4
"""RMS of the depth, in its scatter and in metres [m], that a law may leave: a fifth of the
variance, or the noise of poses where a force is held."""

WHOSE = ('robot', 'simulation')
"""The two recordings."""

LATE = ('wrench_delay', 'wrench_lowpass')
"""Effects that would make damping of stiffness: the delay of the wrench is estimated instead."""


class Touch(NamedTuple):
    """
    Where one recording touches something, in block means.

    Attributes
    ----------
    force, torque : ndarray, shape (n, 3)
        On the tool, in S, about its origin [N], [N m].
    position, velocity : ndarray, shape (n, 3)
        Of S in base [m], [m/s].
    R_base_sensor : ndarray, shape (n, 3, 3)
    omega : ndarray, shape (n, 3)
        In S [rad/s].
    delay : tuple of float
        Of the wrench behind the pose, and its standard error [s].
    """

    force: Array
    torque: Array
    position: Array
    velocity: Array
    R_base_sensor: Array
    omega: Array
    delay: tuple[float, float]

    @property
    def seconds(self) -> float:
        """How long it touches [s]."""
        return BLOCK * len(self.force)

    @property
    def in_base(self) -> Array:
        """The force along base, shape (n, 3)."""
        return np.asarray(np.einsum('nij,nj->ni', self.R_base_sensor, self.force))


def touching_of_robot(recording: Recording, simulation: RecordedSimulation, tool: RigidTool
                      ) -> NDArray[np.bool_]:
    """
    Tell blocks in which the robot's tool touches what its simulation touches, or any surface.

    While the simulated tool touches nothing, a burst of force is contact if it follows a depth:
    else it may be an effect.

    Parameters
    ----------
    recording : Recording
        Of the robot.
    tool : RigidTool
        Of its simulation.

    Returns
    -------
    ndarray of bool, shape (n_blocks,)
    """
    own = contact_blocks(beyond(recording, simulation.signals(tool))
                         + block_means(simulation.beyond))
    if simulation.touching.any():
        runs, _ = label(own)
        return np.asarray(own & np.isin(runs, runs[simulation.touching]))
    try:
        fit = fit_surface([touch_of_robot(recording, simulation, tool, own)], 0.0)[1]
    except DataError:
        return own & False
    return np.asarray(own & (0.0 < fit.law[1] < 1.0 / MIN_STIFFNESS_N_M))


def touch_of_robot(recording: Recording, simulation: RecordedSimulation, rig: Rig,
                   near: NDArray[np.bool_]) -> Touch:
    """
    Return the contact of the robot.

    Parameters
    ----------
    rig : Rig
        Tool and sensor, with what free motion shows of them.
    near : ndarray of bool, shape (n_blocks,)
        Contact, and what is near it.
    """
    rig = replace(rig, effects=tuple(one for one in rig.effects if one[0] not in LATE))
    s, simulated = simulation.signals(rig), block_means(simulation.beyond)
    pose, position = recording.pose, s.position
    if pose is not None and pose.has_position:
        # what is merged from two poses rings where contact begins; noise of a depth does no harm
        t = s.start + (1.0 + np.arange(len(position))) / RATE
        position = CubicSpline(pose.t, pose.position)(t)
    named = named_effects(rig.effects).get('wrench_gain', {})
    gain = np.array(rig.wrench_sensor.gain) * [1.0 + named.get(axis, 0.0) for axis in FORCES]
    return _touch(beyond(recording, s) + simulated, block_means(s.wrench) - simulated, gain,
                  (position, s.velocity, s.R_base_sensor, s.omega), near)


def touch_of_simulation(simulated: Recording, simulation: RecordedSimulation, tool: RigidTool
                        ) -> Touch:
    """Return the contact of a simulated tool, whose recording is on the robot's clock."""
    bare = replace(simulated, accelerometer=None)
    own = CarriedTool(bare, simulation.start, simulation.n_blocks, 'acc1')
    wire = own.wire(tool)
    return _touch(block_means(own.recorded_wrench(bare) - wire), block_means(wire), np.ones(6),
                  (own.position, own.velocity, own.R_base_sensor, own.omega), simulation.touching)


def _touch(apart: Array, expected: Array, gain: Array, motion: tuple[Array, ...],
           near: NDArray[np.bool_]) -> Touch:
    """Keep what is surely contact of a wrench beyond its tool's, in block means (n, 6)."""
    apart = apart - np.median(apart[~near], axis=0)
    rate = np.gradient(expected, BLOCK, axis=0)[~near]
    late = robust_fit(-rate[:, :, np.newaxis], apart[~near])
    size = np.linalg.norm(apart[:, :3], axis=1)
    limit = max(CONTACT_FORCE_N, 5.0 * float(np.sqrt(np.mean(size[~near] ** 2))))
    # forces below 12.5 Hz ring for 40 ms at both ends
    kept = binary_erosion(near & (size > limit), iterations=10)
    position, velocity, R, omega = motion
    return Touch((apart / gain)[kept, :3], (apart / gain)[kept, 3:],
                 block_means(slow(position, RATE))[kept], block_means(velocity)[kept],
                 R[round(BLOCK * RATE) // 2::round(BLOCK * RATE)][kept],
                 block_means(omega)[kept], (float(late.theta[0]), float(late.std[0])))


class _Rows(NamedTuple):
    """
    Rows of both regressions, of m recordings.

    Attributes
    ----------
    own : ndarray of int, shape (n,)
        Which recording each row is of.
    depth : ndarray, shape (n,)
    regressors : ndarray, shape (n, 4 m + s)
        Of each recording 1, force and approach, then how fast each slides; of all the slopes of
        the surface along the s directions in which the tool slides.
    plane : ndarray, shape (3, 2)
        Directions along the surface, these first.
    tangential : ndarray, shape (n, 2)
        Force along the surface.
    rubbing : ndarray, shape (n, 2, m + 2)
        Friction of each, two slopes of all; NaN where it does not slide.
    """

    own: NDArray[np.intp]
    depth: Array
    regressors: Array
    plane: Array
    tangential: Array
    rubbing: Array


class _Fit(NamedTuple):
    """
    What the regressions found.

    Attributes
    ----------
    law, friction : ndarray, shape (4 m + s,), (m + 2,)
    covariance : ndarray, shape (4 m, 4 m)
        Of d0, 1 / k and c / k of each recording, then of each friction.
    scale : ndarray, shape (2,)
        Of the first recording's residual, in depth and along the surface.
    """

    law: Array
    friction: Array
    covariance: Array
    scale: Array


def _rows(touches: Sequence[Touch], normal: Array, point: Array) -> _Rows:
    """Write both laws for a normal in base, and a point of the tool in S."""
    m, R = len(touches), np.concatenate([one.R_base_sensor for one in touches])
    own = np.repeat(np.arange(m), [len(one.force) for one in touches])
    each = (own[:, np.newaxis] == np.arange(m)).astype(float)
    force = np.concatenate([one.in_base for one in touches])
    x = np.concatenate([one.position for one in touches]) + R @ point
    velocity = np.concatenate([one.velocity for one in touches]) + np.einsum(
        'nij,nj->ni', R, np.cross(np.concatenate([one.omega for one in touches]), point))
    push, plane = force @ normal, np.linalg.svd(normal[np.newaxis])[2][1:].T
    law = np.stack([np.ones(len(own)), push, velocity @ normal], axis=1)
    pace = np.linalg.norm(velocity @ plane, axis=1, keepdims=True)
    # sliding lifts a tool where friction is simulated by a pyramid
    law = np.hstack([(each[:, :, np.newaxis] * law[:, np.newaxis]).reshape(-1, 3 * m),
                     each * pace])
    # of the way along the surface what no force explains: the rest is depth by another name
    along = (x - x.mean(axis=0)) @ plane
    along = along - law @ np.linalg.lstsq(law, along, rcond=None)[0]
    _, sizes, ways = np.linalg.svd(along, full_matrices=False)
    plane, slides = plane @ ways.T, int((sizes > MIN_SLIDE_M * np.sqrt(len(own))).sum())
    regressors = np.hstack([law, (along @ ways.T)[:, :slides]])
    way = -push[:, np.newaxis] * (velocity @ plane) / np.where(
        pace > MIN_SLIDING_M_S, pace, np.nan)
    rubbing = np.concatenate([way[:, :, np.newaxis] * each[:, np.newaxis],
                              push[:, np.newaxis, np.newaxis] * np.eye(2)], axis=2)
    return _Rows(own, -x @ normal, regressors, plane, force @ plane, rubbing)


def _fit(rows: _Rows, kept: NDArray[np.bool_]) -> _Fit:
    """Fit both laws to some rows, robustly."""
    own, m = rows.own[kept], int(rows.own.max()) + 1
    middle = rows.depth.mean()
    # blocks of half a second; where contact is short, a few more than there are unknowns
    blocks = int(np.clip(2.0 * BLOCK * len(own), 4 * m + 8, BLOCKS))
    columns = rows.regressors.shape[1]
    law = robust_fit(rows.regressors[kept][:, np.newaxis], rows.depth[kept, np.newaxis] - middle,
                     np.zeros(columns), blocks, groups=own, channels=1)
    theta = law.theta.copy()
    theta[:3 * m:3] += middle
    covariance = np.diag(np.full(4 * m, 1e6))  # variance of what is not shown
    covariance[:3 * m, :3 * m] = law.covariance[:3 * m, :3 * m]
    friction, scale = np.zeros(m + 2), np.array([law.scale[0, 0], np.inf])
    rubs = np.isfinite(rows.rubbing[kept]).all(axis=(1, 2))
    if BLOCK * np.bincount(own[rubs], minlength=m).min() > MIN_CONTACT_S:
        slopes = np.zeros(m + 2)  # of the surface, where its depth shows them
        slopes[m:m + columns - 4 * m] = 1.0 / np.diag(law.covariance)[4 * m:]
        rub = robust_fit(rows.rubbing[kept][rubs], rows.tangential[kept][rubs], slopes, blocks,
                         groups=own[rubs], channels=2)
        friction, scale[1] = rub.theta, rub.scale[0, 0]
        covariance[3 * m:, 3 * m:] = rub.covariance[:m, :m]
    return _Fit(theta, friction, covariance, scale)


def fit_surface(touches: Sequence[Touch], rough: float = ROUGH_M) -> tuple[_Rows, _Fit]:
    """
    Fit the law of the surface of each recording, of one normal and one point of the tool.

    Parameters
    ----------
    rough : float
        RMS of a depth that a law may leave in any case [m].

    Raises
    ------
    DataError
        Contact is too short, or not that of one flat surface; put behind ``not compared:``.
    """
    for one, name in zip(touches, WHOSE):
        if one.seconds < MIN_CONTACT_S:
            raise DataError(f'the {name} touches for {below(one.seconds, MIN_CONTACT_S, 2)} s '
                            f'only, {MIN_CONTACT_S:g} s are needed; press longer')
        if not one.position.any():
            raise DataError(f'the poses of the {name} have no position, so no depth is known')
    means = [one.in_base.sum(axis=0) / np.linalg.norm(one.force, axis=1).sum() for one in touches]
    if min(map(np.linalg.norm, means)) < MIN_COSINE:
        raise DataError('the tool is pushed in several directions; touch one flat surface')
    ways = [mean / np.linalg.norm(mean) for mean in means]
    if ways[0] @ ways[-1] < MIN_COSINE:
        raise DataError('the contact forces of the two recordings point in directions '
                        f'{np.degrees(np.arccos(ways[0] @ ways[-1])):.0f} deg apart')
    levers = np.concatenate([-skew(one.force) for one in touches]).reshape(-1, 3)
    # a coordinate along all forces makes no torque, and no depth either
    point = np.linalg.lstsq(levers, np.concatenate([one.torque for one in touches]).ravel(),
                            rcond=0.05)[0]
    normal = ways[0] + ways[-1]
    for _ in range(3):
        normal = normal / np.linalg.norm(normal)
        rows = _rows(touches, normal, point)
        fit = _fit(rows, np.ones(len(rows.own), dtype=bool))
        slopes = fit.law[4 * len(touches):]
        normal = normal + rows.plane[:, :len(slopes)] @ slopes
    residual = rows.depth - rows.regressors @ fit.law
    for i, name in enumerate(WHOSE[:len(touches)]):
        mine = rows.own == i
        left, depth = float(residual[mine].std()), float(rows.depth[mine].std())
        if left > max(rough, MAX_UNEXPLAINED * depth):
            raise DataError(f'the contact depth of the {name} does not follow its force '
                            f'({1e3 * left:.2g} of {1e3 * depth:.2g} mm RMS are unexplained); '
                            'touch one flat surface')
    return rows, fit


class Contact(NamedTuple):
    """
    How contact differs in two recordings.

    Attributes
    ----------
    seconds : tuple of float
        Compared, of the robot and of its simulation [s].
    why_not : str
        Why nothing was compared; else empty.
    one_sided : bool
        Only one of them touches something.
    numbers, std : ndarray, shape (2, 4)
        Of the robot's surface and of the simulated, in ``UNITS``.
    effects, candidates : tuple
        As of a diagnosis.
    not_identified : tuple of str
        Differences that these motions do not show.
    explained : float
        Part of the held-out difference that the effects remove.
    """

    seconds: tuple[float, float]
    why_not: str = ''
    one_sided: bool = False
    numbers: Array = np.zeros((2, 4))
    std: Array = np.zeros((2, 4))
    effects: tuple[NamedEffect, ...] = ()
    candidates: tuple[tuple[str, float], ...] = ()
    not_identified: tuple[str, ...] = ()
    explained: float = 0.0

    def notes(self) -> Iterator[str]:
        """State the numbers of both surfaces; of their places only the difference is known."""
        for i, (name, unit) in enumerate(zip(QUANTITIES, UNITS)):
            if self.why_not or name in self.not_identified:
                continue
            values, std = self.numbers[:, i], self.std[:, i]
            if unit == 'm':
                apart = quantity(values[0] - values[1], float(np.hypot(*std)), unit, signed=True)
                yield f"{name}: the robot's is {apart} further in the direction of the push"
            else:
                robot, simulated = (quantity(*each, unit).strip() for each in zip(values, std))
                yield f'{name}: robot {robot}, simulated {simulated}'

    def document(self) -> dict[str, Any]:
        """Return what ``diagnosis.json`` holds of it."""
        kept = [] if self.why_not else [
            (i, name) for i, name in enumerate(QUANTITIES) if name not in self.not_identified]
        return {'seconds': list(self.seconds), 'not_compared': self.why_not,
                'not_identified': list(self.not_identified), **{
                    whose: {name: {'value': float(self.numbers[row, i]),
                                   'std': float(self.std[row, i]), 'unit': UNITS[i]}
                            for i, name in kept} for row, whose in enumerate(WHOSE)}}


def _numbers(x: Array) -> Array:
    """Return the numbers of both surfaces, (2, 4): of d0, 1 / k, c / k; friction; delays."""
    (place, compliance, lag), friction, delay = x[:6].reshape(2, 3).T, x[6:8], x[8:]
    return np.stack([1.0 / compliance, (lag + delay) / compliance, place, friction], axis=1)


def _change(x: Array) -> Array:
    """Return how the robot's surface differs, (4,): the first two relative to the simulated."""
    robot, simulated = _numbers(x)
    return np.append(robot[:2] / simulated[:2] - 1.0, (robot - simulated)[2:])


def _propagated(function: Callable[[Array], Array], x: Array, covariance: Array
                ) -> tuple[Array, Array]:
    """Return a function's value, flat, and its covariance."""
    step = 0.01 * np.sqrt(np.diag(covariance)) + 1e-12
    J = jacobian(lambda y: function(y).ravel(), x, step)
    return function(x).ravel(), J @ covariance @ J.T


def joined(touches: Sequence[Touch]) -> Touch:
    """Join the contact of several recordings; the delay is that of the first."""
    force, torque, position, velocity, R, omega = (
        np.concatenate(rows) for rows in zip(*(one[:-1] for one in touches)))
    return Touch(force, torque, position, velocity, R, omega, touches[0].delay)


def compare_contact(robot: Touch, simulated: Touch, spreads: NominalTolerances,
                    selection: Posterior) -> Contact:
    """
    Weigh how the surface that a robot touches differs from the simulated one.

    Parameters
    ----------
    spreads : NominalTolerances
        By how much they differ in any case, 1 sigma.
    selection : Posterior
        Of free motion.
    """
    seconds = robot.seconds, simulated.seconds
    if not any(seconds):
        return Contact(seconds, not_identified=tuple(QUANTITIES))
    if min(seconds) < min(MIN_CONTACT_S, 0.1 * max(seconds)):
        one, other = WHOSE[::1 if seconds[1] < seconds[0] else -1]
        return Contact(seconds, f'the {one} touches something for {max(seconds):.1f} s, '
                       f'the {other} for {min(seconds):.1f} s', True)
    try:
        rows, fit = fit_surface((robot, simulated))
    except DataError as error:
        return Contact(seconds, str(error))
    delays, errors = np.array([robot.delay, simulated.delay]).T
    x = np.concatenate([fit.law[:6], fit.friction[:2], delays])
    covariance = block_diag(fit.covariance, np.diag(errors ** 2))
    numbers, of_numbers = _propagated(_numbers, x, covariance)
    change, scatter = _propagated(_change, x, covariance)
    std = np.sqrt(np.diag(scatter))
    wide = np.array([q.typical - q.nominal for q in QUANTITIES.values()]) / np.sqrt(EFFECT)
    shown = std < MAX_RELATIVE_STD * wide
    # friction: of a surface that is turned by 1 deg
    spread = np.array([spreads.wall_stiffness, spreads.wall_damping, spreads.wall_position, 0.02])
    features, others = _weighed_together(
        [name for name, known in zip(QUANTITIES, shown) if known], change[shown],
        scatter[np.ix_(shown, shown)] + np.diag(spread[shown] ** 2), wide[shown])
    explained = _explained(rows, [name in features for name in QUANTITIES], delays)
    probabilities, candidates = weighed(selection._replace(
        features=features, alternatives=others, closest=None), explained < 0.9, explained >= 0.0)
    effects = tuple(
        NamedEffect(name, {q.name: Parameter(float(value), float(error), q.unit)},
                    probabilities[name])
        for (name, q), value, error in zip(QUANTITIES.items(), change, std) if name in features)
    return Contact(seconds, '', False, numbers.reshape(2, 4),
                   np.sqrt(np.diag(of_numbers)).reshape(2, 4), effects, tuple(candidates),
                   tuple(name for name, known in zip(QUANTITIES, shown) if not known), explained)


def _weighed_together(names: Sequence[str], change: Array, scatter: Array, wide: Array
                      ) -> tuple[dict[str, Features], dict[str, dict[str, float]]]:
    """
    Find which differences explain what was measured, by the evidence of every set of them.

    Parameters
    ----------
    scatter : ndarray, shape (n, n)
        Covariance of the differences where nothing is wrong.
    wide : ndarray, shape (n,)
        Prior of each that is wrong, 1 sigma.

    Returns
    -------
    features : dict of str to Features
        Of each difference that is worth its place.
    others : dict of str to dict of str to float
        Log-evidence of each other difference in its place.
    """
    def evidence(chosen: frozenset[str]) -> float:
        free = np.array([name in chosen for name in names])
        return float(multivariate_normal.logpdf(change, cov=scatter + np.diag(free * wide ** 2)))

    if not names:
        return {}, {}
    found = {one: evidence(one) for n in range(len(names) + 1)
             for one in map(frozenset, combinations(names, n))}
    best = max(found, key=lambda one: found[one] - WORTH * len(one))
    free = np.array([name in best for name in names])
    square = change @ np.linalg.solve(scatter + np.diag(free * wide ** 2), change)
    missing = max(0.0, 0.5 * float(square - len(names)))
    # measured apart, so that none fits what another leaves
    return ({name: Features(found[best] - found[best - {name}], missing) for name in best},
            {name: {other: found[best - {name} | {other}] - found[best]
                    for other in names if other not in best} for name in best})


def _explained(rows: _Rows, named: Sequence[bool], delays: Array) -> float:
    """Return how much of the robot's held-out difference from the simulated law goes away."""
    robot, before, after = rows.own == 0, 0.0, 0.0
    # every other tenth of the robot's contact is held out
    for half in (0, 1):
        held = robot & (np.arange(len(robot)) * 10 // robot.sum() % 2 == half)
        fit = _fit(rows, ~held)
        own, simulated = _numbers(np.concatenate([fit.law[:6], fit.friction[:2], delays]))
        least, some, none = (_energy(rows, fit, numbers, delays[0], held) for numbers in (
            own, np.where(named, own, simulated), simulated))
        before, after = before + none - least, after + some - least
    return 1.0 - after / before if before > 0.0 else 0.0


def _energy(rows: _Rows, fit: _Fit, numbers: Array, delay: float, held: NDArray[np.bool_]
            ) -> float:
    """Return what other numbers of the robot's surface leave, in the scale of its residual."""
    stiffness, damping, place, friction = numbers
    law = np.append([place, 1.0 / stiffness, damping / stiffness - delay], fit.law[3:])
    depth = (rows.depth - rows.regressors @ law)[held]
    force = (rows.tangential - rows.rubbing @ np.append(friction, fit.friction[1:]))[held]
    return float(np.sum((depth / fit.scale[0]) ** 2) + np.nansum((force / fit.scale[1]) ** 2))


def with_contact(diagnosis: Diagnosis, contact: Contact) -> Diagnosis:
    """Add to a diagnosis of free motion how contact differs."""
    d, both = diagnosis, f'{contact.seconds[0]:.1f} s of contact'
    if not any(contact.seconds):
        return replace(d, reason=f'{d.reason}; no contact in the recording; contact is not '
                       'compared')
    if contact.why_not and not contact.one_sided:
        return replace(d, reason=f'{d.reason}; contact is not compared: {contact.why_not}')
    if contact.why_not:
        verdict = {'no_gap': 'unknown', 'identified': 'partial'}.get(d.verdict, d.verdict)
        unknown = verdict == 'unknown'
        return replace(
            d, verdict=verdict, reason=f'{contact.why_not}; in free motion {d.reason}',
            effects=(NamedEffect(UNKNOWN, {}, 1.0),) if unknown else d.effects,
            candidates=((UNKNOWN, 1.0),) if unknown and not d.candidates else d.candidates)
    missing = ', '.join(contact.not_identified)
    beside = f' ({missing}: not identifiable)' if missing else ''
    named = [e for e in contact.effects if e.probability > NAMED]
    if not named:
        alike = [name for name in QUANTITIES if name not in contact.not_identified]
        what = f'no difference of {", ".join(alike)}' if alike else 'nothing'
        return replace(d, reason=f'{d.reason}; {both}: {what} is found{beside}')
    names = ' and '.join(e.name for e in named)
    rivals = [n for n, _ in contact.candidates if n not in {UNKNOWN, *(e.name for e in named)}]
    end = '' if len(named) > 1 else 's'
    reason = (f'{names} explain{end} {percent(contact.explained)} of the difference in {both}'
              f'{beside}')
    if rivals:
        reason += f', but {" or ".join(rivals)} may be the cause instead'
    verdict = {'no_gap': 'identified', 'not_excited': 'identified', 'unknown': 'partial'}.get(
        d.verdict, d.verdict)
    kept = tuple(e for e in d.effects if e.name != UNKNOWN)
    return replace(
        d, verdict='ambiguous' if rivals and verdict == 'identified' else verdict,
        reason=f'{reason}; in free motion {d.reason}', effects=(*kept, *named),
        candidates=tuple(listed_once([*d.candidates, *contact.candidates])))
