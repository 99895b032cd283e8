"""
What a recording can have wrong: one table of hypotheses, judged by one robust fit.

Every row turns the streams back into what they would be without one fault. Each of them gets the
fit of :mod:`forcecal_ros.checks.evidence`; the difference in log evidence decides:

- another row beats the recording as it is by :data:`MARGIN`: refused by its name, with a remedy;
- it leads by less: one note lists both;
- else the recording is as it says.

What is continuous is estimated with its standard error: rotation of the sensor, tilt of base,
clock offset, time of a change; and by comparison of estimates: lengths and time by the inertial
mass over the weight, torques' units, signs and points by the two centres of mass.

Physics cannot tell a unit that forces and torques share: the mass scales with it. A known mass
does (a calibration, ``--tool-mass``); without one, masses and biases that no wrist sensor has are
refused or questioned. At rest it does not tell the sign of all torques, nor the point that they
are about.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.checks import messages
from forcecal_ros.checks.evidence import (
    biases,
    by_any_matrix,
    explain,
    explain_forces,
    Explained,
    FREEDOM,
    Motion,
    on_grid,
    STEP_S,
    usable_rows,
)
from forcecal_ros.checks.messages import (
    CONTRADICTION_SIGMA,
    Finding,
    SLIGHT,
    STANDSTILL,
    Stated,
)
from forcecal_ros.core.errors import above, DataError
from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import (
    Array,
    continuous_sign,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_from_vector,
    skew,
    STANDARD_GRAVITY,
)
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.streams import Recording, Stream
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtr, stdtrit

MARGIN = float(np.log(300 * 20))
"""Log odds: one in 300 sound recordings may be refused, by any of twenty rows."""

MIN_GAIN = 2.0
"""Log likelihood for each independent sample, at least: half of the residual. What fits less well
is no explanation, however many samples there are."""

MIN_GRAVITY_SPREAD = 0.1
"""Spread of the directions of gravity, gravity taken as 1, from which they determine a weight."""

MIN_DELAY_S = 2e-3
"""Delays of less are not noted: tools on springs show as much."""


class Hypothesis(NamedTuple):
    """
    One row: how streams would be without a fault.

    Attributes
    ----------
    name : str
    undo : callable
        Takes a Motion, returns it without the fault; None: it cannot be told from this motion.
    unknowns : int
        Beyond those of the fit.
    is_note : bool
        Said in a note where the tool is known: the recording can be used all the same.
    is_costly : bool
        Fitted only if no other row explains the recording.
    """

    name: str
    undo: Callable[[Motion], Motion | None]
    unknowns: int = 0
    is_note: bool = False
    is_costly: bool = False


class Known(NamedTuple):
    """A tool that is known: mass [kg], centre of mass [m], bias [N, N m], each from before."""

    mass: float
    com: Array | None = None
    bias: Array | None = None
    other_tool: str = 'calibrate the attached tool (forcecal calibrate) and pass --calibration'


class Candidate(NamedTuple):
    """One row, fitted."""

    name: str
    motion: Motion
    fit: Explained
    evidence: float
    row: Hypothesis


def judge(recording: Recording, gravity: Array, stated: Stated = Stated(),
          known: Known | None = None) -> tuple[str, ...]:
    """
    Refuse a recording that another hypothesis than its own words explains clearly better.

    Parameters
    ----------
    recording : Recording
        Checked by :func:`forcecal_ros.checks.entry.checked`.
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    stated : Stated
        What options or a calibration say of sensor and base.
    known : Known, optional
        The tool that hangs there.

    Returns
    -------
    tuple of str
        What is undecided, or too slight to refuse.

    Raises
    ------
    DataError
        Names the fault with its evidence and the remedy.
    UnobservableError
        The forces show no weight.
    """
    motion = on_grid(recording, gravity)
    if motion is None or motion.usable.sum() < 3:
        return ()
    spread = _spread(motion.in_sensor[motion.usable][:, None], gravity)
    if spread[0] < MIN_GRAVITY_SPREAD:
        return ()
    found = candidates(motion)
    plain, best = found[0], max(found, key=lambda one: one.evidence)
    lead, slight = best.evidence - plain.evidence, tuple[str, ...]()
    gain = sum(getattr(best.fit, part).mean_log - getattr(plain.fit, part).mean_log
               for part in ('force', 'torque'))
    if best is not plain and lead > MARGIN and gain > MIN_GAIN:
        if not motion.step:  # at rest there is no contact that its tails would be
            messages.refuse_unexplained(best)
        close = [one for one in found if best.evidence - one.evidence < MARGIN
                 and one is not plain and best.name not in one.name]  # nor what includes it
        message = messages.of(best, plain, stated, close)
        noted = best.row.is_note or any(one.name == 'crosstalk' for one in close)
        if message and not (known and noted):
            raise DataError(message, messages.about(best))
        if message or (best.row.is_note and best.row.is_costly):  # nothing else explains it
            return (Finding(message or messages.slight(best, stated), STANDSTILL),)
        if best.name == 'crosstalk':  # a slight one hides no other fault
            slight = (Finding(messages.slight(best, stated)),)
    if not known:
        messages.refuse_weightless(plain)
    notes = (*slight, *_of_estimates(motion, plain.fit, recording, known))
    if best is not plain and lead > 0.5 * MARGIN and gain > MIN_GAIN and (
            said := messages.of(best, plain, stated, [])):
        notes = (*notes, Finding(f'uncertain: either the recording is correct, or {said}'))
    return notes


def slight_misfit(recording: Recording, gravity: Array, stated: Stated = Stated()) -> str:
    """
    Name a rotation of the sensor or a tilt of the base within tolerance, that is certain.

    Parameters
    ----------
    gravity : ndarray, shape (3,)
        In base [m/s^2].

    Returns
    -------
    str
        Empty where there is none, or the recording does not determine it.
    """
    motion = on_grid(recording, gravity)
    plain = None if motion is None or motion.usable.sum() < 4 else explain(motion)
    if motion is None or plain is None or plain.mass < CONTRADICTION_SIGMA * plain.mass_std:
        return ''
    tilted, turned = _tilted(motion), None
    if _spread(motion.in_sensor[motion.usable][:, None], gravity)[1] > MIN_GRAVITY_SPREAD:
        turned = _refined(motion, np.eye(3))
    found = []
    for row, one in ((TABLE_BY_NAME['tilted'], tilted), (TABLE_BY_NAME['rotated'], turned)):
        fit = None if one is None else explain(one)
        if one is not None and fit is not None:
            found.append((fit.force.scale, Candidate(row.name, one, fit, 0.0, row)))
    best = min(found, key=lambda one: one[0], default=None)
    # share of the residual that a slight rotation or tilt leaves at most: beside cables, gains and
    # drifts it explains less
    most_left = 0.9
    if best is None or best[0] > most_left * plain.force.scale:
        return ''
    angle, std = messages.angle_of(best[1], stated)
    freedom = 3 * int(motion.usable.sum()) - best[1].fit.force.theta.size
    few = stdtrit(max(1, freedom), ndtr(3.0)) / 3.0  # errors by few samples have wider tails
    # standard errors of a slight rotation or tilt from which it is noted: a real arm's tilt of 1.2
    # deg is 9 in 24 poses, what is left of its level base 4
    sigmas = 7.0
    return messages.slight(best[1], stated) if angle > sigmas * few * std else ''


def refuse_late_accelerometer(recording: Recording, gravity: Array) -> None:
    """
    Refuse an accelerometer in which gravity turns at another time than by the pose.

    Parameters
    ----------
    gravity : ndarray, shape (3,)
        In base [m/s^2].

    Raises
    ------
    DataError
        Says how late it is: by 0.1 s or more, as less is estimated as a delay.
    """
    stream = recording.accelerometer
    motion = None if stream is None else on_grid(replace(recording, wrench=Stream(
        stream.t, np.tile(stream.values, 2))), gravity)
    moved = None if motion is None else _other_clock(motion)
    if motion is None or moved is None or moved.usable.sum() < 3:
        return
    plain, then = by_any_matrix(motion), by_any_matrix(moved)
    gain = then.mean_log - plain.mean_log
    if gain > MIN_GAIN and gain * then.effective > MARGIN:
        raise DataError('; '.join(messages.clock('accelerometer', moved, motion)))


def candidates(motion: Motion) -> list[Candidate]:
    """Fit every row; the first is the recording as it is."""
    plain = explain(motion)
    if plain is None:
        raise DataError('fewer than three samples have both wrench and pose; record both together')
    fits = [(TABLE[0], motion, plain)]
    if not explains(plain):
        for row in TABLE[1:]:
            others = [fit for one, _, fit in fits[1:]
                      if not one.name.endswith('changes') or not row.name.endswith('changes')]
            if row.is_costly and any(explains(fit) for fit in others):
                break  # nothing is left that it could explain better, but for another change
            undone = row.undo(motion)
            fit = None if undone is None else explain(undone)
            if undone is not None and fit is not None and fit.mass > 3.0 * fit.mass_std:
                fits.append((row, undone, fit))
    first = max((fit for _, _, fit in fits),
                key=lambda fit: fit.force.mean_log + fit.torque.mean_log)
    effective = first.force.effective, first.torque.effective
    return [Candidate(row.name, undone, fit, fit.force.evidence(effective[0])
                      + fit.torque.evidence(effective[1])
                      - 0.5 * row.unknowns * float(np.log(effective[0])), row)
            for row, undone, fit in fits]


def explains(fit: Explained) -> bool:
    """Whether a fit leaves no other room for an explanation that counts, `MIN_GAIN`."""
    return fit.mass > 0.0 and fit.force.room + fit.torque.room < MIN_GAIN


def _spread(rows: Array, gravity: Array) -> Array:
    """Singular values of (n, j, k) about their mean, per root of n, gravity taken as 1."""
    about = (rows - rows.mean(axis=0)).reshape(-1, rows.shape[2]) / np.linalg.norm(gravity)
    return np.asarray(np.linalg.svd(about, compute_uv=False) / np.sqrt(len(rows)))


# Estimates that contradict each other -----------------------------------------------------------

FORCE_UNITS = {'kgf': STANDARD_GRAVITY, 'lbf': 4.4482216, 'mN': 1e-3, 'kN': 1e3}
"""[N]"""

TORQUE_UNITS = {'N mm': 1e-3, 'N cm': 1e-2, 'dN m': 0.1, 'lbf in': 0.1129848,
                'kgf cm': 1e-2 * STANDARD_GRAVITY, 'kN m': 1e3}
"""[N m]"""

LENGTH_UNITS = {'mm': 1e-3, 'cm': 1e-2, 'inches': 0.0254}
"""[m]"""


SAME = 0.05
"""Share to which a unit explains a ratio: another tool does so by chance once in ten times."""

ELSEWHERE_M = 0.01
"""Centres of mass are apart by less where nothing is wrong: by 2.4 mm in runs beside a computer
that is late."""


def _of_estimates(motion: Motion, fit: Explained, recording: Recording, known: Known | None
                  ) -> tuple[str, ...]:
    """Compare what should agree: masses, biases, centres of mass, inertia and weight."""
    late, fit = _in_time(motion, fit)
    _refuse_counts(fit, recording)
    if known is not None and (note := _other_tool(fit, known)):
        return (note,)
    return tuple(note for note in (
        _other_time(fit), _late(fit, late, recording),
        _other_point(fit, recording, known)) if note)


def _in_time(motion: Motion, fit: Explained) -> tuple[float, Explained]:
    """Return how late forces are [s], and the fit of the wrench without that delay."""
    late = float(fit.force.theta[5] / fit.mass) if motion.step else 0.0
    if abs(late) > MIN_DELAY_S:  # beyond what a line through no delay shows
        wrench = Stream(motion.t, motion.wrench).at(motion.t + late)
        fit = explain(replace(motion, wrench=wrench)) or fit
        late += float(fit.force.theta[5] / fit.mass)
    return late, fit


def _refuse_counts(fit: Explained, recording: Recording) -> None:
    assert recording.wrench is not None
    # a wrist sensor's bias is within its range, of 2.5 kN in the largest ones of arms
    most_n = 5e3
    bias, values = np.abs(fit.force.theta[-3:]).max(), recording.wrench.values
    if np.ptp(values, axis=0).all() and (values == np.rint(values)).all():
        raise DataError(
            'wrench: all readings are integers, torques included: these are raw counts of a '
            "converter; divide them by the counts per N (and per N m), or record the driver's "
            'topic in newtons')
    if bias > most_n:
        raise DataError(
            f'wrench: a bias of {above(bias, most_n)} N is beyond the range of any wrist sensor '
            f'({most_n:g} N): these are raw counts of a converter; divide them by the counts per '
            "N, or record the driver's topic in newtons")


def force_unit_of(shown: float, mass: float) -> tuple[str, float] | None:
    """Name the unit in which forces make a known mass [kg] that shown [kg], and its newtons."""
    return next(((unit, size) for unit, size in FORCE_UNITS.items()
                 if abs(shown * size / mass - 1.0) < SAME), None)


def refuse_other_mass(found: float, std: float, stated: float) -> None:
    """
    Refuse a mass [kg], with its standard error, that is not what a scale says.

    Raises
    ------
    DataError
        Names the unit of the forces that explains it, or what else may.
    """
    if abs(found - stated) < SAME * stated + 3.0 * std:
        return
    unit = force_unit_of(found, stated)
    why = (f'its forces are in {unit[0]}; {corrected(unit[1], unit[0])}' if unit else
           'no known unit explains it; weigh everything below the sensor, couplings included. If '
           'the stated mass is right, the driver subtracts a load or its gain is wrong')
    raise DataError(f'wrench: the tool of {stated:.4g} kg weighs {quantity(found, std, "kg")} in '
                    f'this recording: {why}')


def corrected(factor: float, unit: str) -> str:
    """Say how readings in a unit become SI: where they are made, or where a table was read."""
    return (f'multiply by {factor:.6g} in the driver (for a table read by forcecal import, set '
            f'"unit: {unit}" in its specification instead)')


def questions_of(mass: float, com: Array, bias: Array) -> Iterator[str]:
    """
    Question a mass [kg], a centre of mass (3,) [m] or a bias (3,) [N] that is odd for a tool.

    A unit that all readings share makes them so, and no recording tells it.
    """
    # most arms carry 35 kg at most and their sensors have 500 N; grippers weigh 0.3 kg with their
    # coupling
    large_kg, large_n, least_kg = 50.0, 500.0, 0.25
    away, off = float(np.linalg.norm(com)), float(np.abs(bias).max())
    if mass > large_kg or off > large_n:
        yield (f'a mass of {mass:.3g} kg with a bias of {off:.3g} N is unusually large for a '
               'wrist sensor: weigh the tool and pass --tool-mass. If it weighs '
               f'{mass / 1000:.3g} kg, the forces are in mN; otherwise these may be raw counts of '
               'a converter: divide them by the counts per N')
    if mass < least_kg:
        yield (f'a mass of {mass:.3g} kg is unusually small for a wrist sensor: weigh the tool '
               f'and pass --tool-mass. If it weighs {mass * STANDARD_GRAVITY:.3g} kg, the forces '
               f'are in kgf; if {mass * 4.448:.3g} kg, in lbf')
    # a centre of mass so far away is questioned: grippers and hands have theirs within 0.2 m
    far_m = 0.3
    if away > far_m:
        yield (f'a centre of mass {away:.3g} m away from the sensor is unusually far: measure it. '
               f'If it is {away * 0.113:.2g} m, the torques are in lbf in (multiply by 0.11298); '
               f'if {away / 10:.2g} m, in dN m. If it is {away / 4.448:.2g} or '
               f'{away / STANDARD_GRAVITY:.2g} m, the forces are in lbf or kgf (torques in N m)')


def _other_tool(fit: Explained, known: Known) -> str:
    """Compare weight and bias with known ones; empty: they agree."""
    mass, g = known.mass, float(np.linalg.norm(fit.gravity, axis=1).mean())
    shown = f'wrench: the tool of {mass:.4g} kg weighs {fit.mass:.4g} kg in this recording'
    about = np.linalg.norm(fit.gravity - fit.gravity.mean(axis=0), axis=1)
    weight = max(mass, fit.mass) * float(np.sqrt((about**2).mean() / 3.0))
    if fit.force.scale > 0.5 * weight:
        return (f'with a weight of {quantity(fit.mass, fit.mass_std, "kg")} the force residual is '
                f'{fit.force.scale:.2g} N RMS: wrench and pose are of different robots or times, '
                'or something always pulls at the tool; select the pose with --topic pose=NAME')
    if (unit := force_unit_of(fit.mass, mass)) and fit.mass > CONTRADICTION_SIGMA * fit.mass_std:
        raise DataError(f'{shown}: its forces are in {unit[0]}; {corrected(unit[1], unit[0])}')
    if fit.mass < SLIGHT * mass:
        raise DataError(f'{shown}: the driver subtracts its weight; disable this in the driver '
                        f'(if no tool was attached, {known.other_tool} instead)')
    if known.bias is None:
        return ''  # a model, which may be off, or something that pulls
    off = fit.force.theta[-3:] - known.bias[:3]
    size = abs(fit.mass - mass) * g + float(np.linalg.norm(off))
    if size < SLIGHT * mass * g + 3.0 * fit.force.scale / np.sqrt(fit.force.effective):
        return ''
    return (f'the sensor carries {quantity(fit.mass, fit.mass_std, "kg")}, the calibration has '
            f'{mass:.4g} kg, and the bias differs by {" ".join(f"{x:+.2g}" for x in off)} N: the '
            'tool or payload changed, the sensor was tared, or its bias drifts; calibrate again')


def _other_time(fit: Explained) -> str:
    """Compare inertia with weight: units of length, and the speed of time."""
    times, std = fit.inertial
    if not fit.moving or abs(times - 1.0) < CONTRADICTION_SIGMA * std or 0.3 < times < 1.5 or (
            fit.times == 1.0):  # torques contradict it: something pulls
        return ''
    for unit, size in LENGTH_UNITS.items():
        if abs(times / size - 1.0) < 0.4:
            raise DataError(
                f'pose: the forces show {times:.2g} times the inertia that its accelerations '
                f'predict: its position is in {unit}; {corrected(size, unit)}')
        if abs(times * size - 1.0) < 0.4 and size < 0.02:
            raise DataError(
                f'pose: the forces show {times:.2g} times the inertia that its accelerations '
                f'predict: its positions are in m but read as {unit}; set their unit to m')
    if 0.0 <= times < 1.5:  # noise of poses makes inertia look less than it is
        return ''
    if times < 0.0:
        cause = ('its position has other axes than its orientation, as in a left-handed frame, or '
                 'something pulls at the tool like a spring')
        remedy = 'publish both in one right-handed frame'
    else:
        cause = (f'the stamps run at {times**-0.5:.2g} of real time, as in a log replayed slowly '
                 'and stamped again')
        remedy = 'use the original log'
    return Finding(f'the forces show {quantity(times, std, "")}times the inertia that the '
                   f'accelerations of the pose predict: {cause}. Inertia is then reported as '
                   f'contact; {remedy}', ('inertia',))


def _late(fit: Explained, late: float, recording: Recording) -> str:
    """Say that forces are late by what adds more to them than noise does; empty: they are not."""
    if not late or recording.wrench is None:
        return ''
    std = float(fit.force.std[5] / fit.mass)
    steps = np.abs(np.diff(recording.wrench.values[:, :3], axis=0))
    noise = float(np.linalg.norm(np.median(steps, axis=0))) / 0.954  # of differences, Gaussian
    turning = float(np.sqrt(((np.gradient(fit.gravity, axis=0) / STEP_S)**2).sum(1).mean()))
    size = abs(late) * fit.mass * turning
    if abs(late) < max(CONTRADICTION_SIGMA * std, MIN_DELAY_S) or size < noise:
        return ''
    return (f'the weight in the wrench rotates {quantity(abs(late), std, "s")} '
            f'{"later" if late > 0 else "earlier"} than the pose, which adds {size:.2g} N RMS to '
            'the contact force while the robot rotates: the driver filters the wrench, or its '
            'stamps are wrong; disable the filter, and stamp wrench and pose when they are '
            'measured')


def _other_point(fit: Explained, recording: Recording, known: Known | None) -> str:
    """Compare centres of mass by torques with the known one or that by inertia."""
    shown, shown_cov = fit.com_by_torque
    if known is not None and known.com is not None:
        com, cov, whose = np.asarray(known.com), 1e-6 * np.eye(3), 'the model'
    elif (found := fit.com_by_force) is not None and 0.8 < fit.inertial[0] < 1.5:
        (com, cov), whose = found, 'inertia in motion'
    else:
        return ''
    error = float(np.sqrt(np.trace(cov + shown_cov)))
    off = shown - com
    if not np.ptp(fit.torque.residual) or np.linalg.norm(off) < max(
            ELSEWHERE_M, CONTRADICTION_SIGMA * error):
        return ''
    at = (f'{"its " * bool(known)}torques place the centre of mass at {_metres(shown)}, {whose} '
          f'at {_metres(com)}')
    if unit := torque_units_of(shown, com, cov, shown_cov, known is None):
        raise DataError(f'wrench: {at}: {unit}; correct the driver (for a table read by forcecal '
                        'import, set their unit in its specification instead)')
    if np.linalg.norm(shown + com) < max(0.2 * np.linalg.norm(com), 4.0 * error):
        raise DataError(f'wrench: {at}: they have the opposite sign of the forces; correct their '
                        'sign in the driver')
    message = (
        f'{at}: the reference point of the torques is {_metres(-off)} away, which shifts the '
        f'centre of mass by {1e3 * np.linalg.norm(off):.0f} mm; calibrate '
        f'{"again " * bool(known)}with --sensor-from-pose {_sensor_at(recording, -off)}, which '
        'moves the sensor frame there')
    # without a known tool it may be the inertia that is wrong, as where a tool slides unseen
    return message if known else Finding(message, ('com', 'inertia'), -off)


def torque_units_of(shown: Array, com: Array, cov: Array, shown_cov: Array,
                    forces: bool = False) -> str:
    """
    Name the units of torques in which a centre of mass is where they show it; empty: none does.

    Parameters
    ----------
    shown, com : ndarray, shape (3,)
        By torques and forces, and as it is known otherwise [m].
    cov, shown_cov : ndarray, shape (3, 3)
        Covariances of ``com`` and ``shown`` [m^2].
    forces : bool
        The forces may be in another unit, too.
    """
    size_m = float(np.linalg.norm(com))

    def explains(times: float) -> bool:
        error = float(np.sqrt(np.trace(cov + shown_cov / times**2)))
        allowed = SAME * size_m * (6.0 if max(times, 1 / times) > 20.0 else 1.0)
        return size_m > 5.0 * error and bool(
            np.linalg.norm(shown / times - com) < max(allowed, 3.0 * error))

    found = [f'its torques are in {unit} (multiply by {size:.5g})'
             for unit, size in TORQUE_UNITS.items() if explains(1.0 / size)]
    if forces:
        found += [f'its forces are in {unit} (multiply by {size:.6g}) and its torques in N m'
                  for unit, size in FORCE_UNITS.items() if explains(size)]
    return ', or '.join(found)


def _sensor_at(recording: Recording, place: Array) -> str:
    """Say the transform from the recorded pose to a place in what it was taken to [m]."""
    x, y, z, *q = recording.sensor_from_pose or (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    there = np.array([x, y, z]) + matrix_from_quaternion(q) @ place
    return ' '.join([*(f'{v:.3f}' for v in there), *(f'{v:.6g}' for v in q)])


def _metres(place: Array) -> str:
    return f'({" ".join(f"{x:.3f}" for x in place)}) m'


# Rows ------------------------------------------------------------------------------------------


def _mapped(motion: Motion, force: Array, torque: Array | None = None) -> Motion:
    """Map force and torque by matrices (3, 3) or (n, 3, 3)."""
    torque = force if torque is None else torque
    parts = [np.einsum('nij,nj->ni', np.broadcast_to(M, (len(motion.t), 3, 3)), part)
             for M, part in ((force, motion.wrench[:, :3]), (torque, motion.wrench[:, 3:]))]
    return replace(motion, wrench=np.hstack(parts))


def _inverted(motion: Motion) -> Motion:
    R = np.swapaxes(motion.R, 1, 2)
    place = motion.path.position
    return motion.along(R=R, position=None if place is None else -np.einsum(
        'nij,nj->ni', R, place))


def _from_w(motion: Motion) -> Motion:
    q = continuous_sign(quaternion_from_matrix(motion.R))
    return motion.along(R=matrix_from_quaternion(q[:, [1, 2, 3, 0]]))


def _axes(motion: Motion, hand: float) -> Motion | None:
    """Rotate the wire's axes (``hand`` 1) or mirror them (-1) as gravity shows them best."""
    rows = usable_rows(motion)
    u, read = motion.in_sensor[rows], motion.wrench[rows, :3]
    if len(rows) < 3 or _spread(u[:, None], motion.gravity)[1] < MIN_GRAVITY_SPREAD:
        return None
    return _refined(motion, _procrustes(u, read, hand)[0])


def _force_axes(motion: Motion) -> Motion | None:
    """Mirror the axes of the forces, and leave those of the torques as they are."""
    mirrored = _axes(motion, -1.0)
    if mirrored is None or mirrored.axes is None or np.trace(mirrored.axes) < -2.9:  # all reversed
        return None
    return replace(mirrored, wrench=np.hstack([mirrored.wrench[:, :3], motion.wrench[:, 3:]]))


def _crosstalk(motion: Motion) -> Motion | None:
    """
    Add crosstalk of forces, crosstalk into torques and gain errors, as far as gravity turns.

    None where they are so large that no sensor has them.
    """
    u, few = motion.in_sensor, usable_rows(motion)
    _, spread, Vt = np.linalg.svd((u[few] - u[few].mean(axis=0)) / np.sqrt(len(few)))
    V = Vt[spread > MIN_GRAVITY_SPREAD * np.linalg.norm(motion.gravity)]
    if len(V) < 2:
        return None
    every = np.kron(np.eye(3), (u @ V.T)[:, None, :])
    own = V.T.reshape(1, -1), (skew(np.eye(3)) @ V.T).reshape(3, -1)  # a weight's, at its lever
    force, torque = (np.linalg.svd(one)[2][len(one):].T for one in own)
    out = replace(motion, extra=every @ force, extra_torque=every @ torque)
    fit = explain(out)
    if fit is None:
        return None
    first, more = 6 if motion.step else 1, force.shape[1]
    parts = (force @ fit.force.theta[first:first + more]).reshape(3, -1) @ V / fit.mass
    arm = max(ELSEWHERE_M, float(np.linalg.norm(fit.com_by_torque[0])))
    levers = (torque @ fit.torque.theta[3:3 + torque.shape[1]]).reshape(3, -1) @ V / fit.mass
    # crosstalk and gain error of a sensor, at most, as a share: a rotation by 15 deg shows as much
    largest = 0.25
    if max(np.abs(parts).max(), np.abs(levers).max() / arm) > largest:
        return None
    return replace(out, axes=np.eye(3) + parts, levers=levers, arm=arm)


def _procrustes(u: Array, read: Array, hand: float, rounds: int = 10) -> tuple[Array, float]:
    """Rotation or mirror Q with read = m Q u + b (Wahba 1965, Umeyama 1991), contact left out."""
    weight = np.ones(len(u))
    for _ in range(rounds):
        a, b = (x - weight @ x / weight.sum() for x in (u, read))
        U, S, Vt = np.linalg.svd((b * weight[:, None]).T @ a)
        last = hand * np.linalg.det(U @ Vt)
        Q = U @ np.diag([1.0, 1.0, last]) @ Vt
        mass = float((S[0] + S[1] + last * S[2]) / (weight @ (a**2).sum(axis=1)))
        off = np.linalg.norm(b - mass * a @ Q.T, axis=1)
        weight = 1.0 / np.maximum(off, 0.1 * np.median(off) + 1e-300)
    return np.asarray(Q), float(weight @ off**2)


def _refined(motion: Motion, Q: Array) -> Motion:
    """Estimate a small rotation on top of Q together with all else, and its standard error."""
    for _ in range(2):
        mapped = _mapped(motion, Q.T)
        weight = mapped.in_sensor
        if motion.free_gravity:
            weight = explain_forces(mapped).force.theta[:3] @ motion.R
        fit = explain_forces(replace(mapped, extra=-skew(weight)))
        k = len(fit.force.theta) - 6
        size = 1.0 if motion.free_gravity else fit.mass
        Q = Q @ rotation_from_vector(fit.force.theta[k:k + 3] / size)
    std = float(np.linalg.norm(fit.force.std[k:k + 3])) / np.sqrt(3.0) / abs(size)
    return replace(_mapped(motion, Q.T), axes=Q, axes_std=std)


def _tilted(motion: Motion) -> Motion | None:
    spread = _spread(np.swapaxes(motion.R[motion.usable], 1, 2), np.ones(1))
    return replace(motion, free_gravity=True) if spread[-1] > MIN_GRAVITY_SPREAD else None


def _rotated_and_tilted(motion: Motion) -> Motion | None:
    """Rotate the wire's axes and let gravity point anywhere: each in turn, from 24 starts."""
    rows = usable_rows(motion, 100)
    tilted = _tilted(motion)
    if len(rows) < 4 or tilted is None:
        return None
    R, read = motion.R[rows], motion.wrench[rows, :3]
    found = []
    for Q in Rotation.create_group('O').as_matrix():
        for _ in range(8):
            columns = np.concatenate([np.swapaxes(R, 1, 2), np.broadcast_to(
                Q.T, (len(R), 3, 3))], axis=2).reshape(-1, 6)
            w = np.linalg.lstsq(columns, (read @ Q).ravel(), rcond=1e-9)[0][:3]
            Q, off = _procrustes(w @ R, read, 1.0, rounds=1)
        found.append((off, Q))
    return _refined(tilted, min(found, key=lambda one: one[0])[1])


def _exchanged(motion: Motion) -> Motion:
    return replace(motion, wrench=motion.wrench[:, [3, 4, 5, 0, 1, 2]])


def _torque_axes(motion: Motion) -> Motion | None:
    """Choose the order and signs of the torques by which a weight at one place makes them."""
    rows = usable_rows(motion)
    if len(rows) < 4:
        return None
    columns = np.concatenate([-skew(motion.wrench[rows, :3]), np.broadcast_to(
        np.eye(3), (len(rows), 3, 3))], axis=2).reshape(-1, 6)
    found = []
    for Q in Rotation.create_group('O').as_matrix():  # -Q is a centre of mass on the other side
        turned = (motion.wrench[rows, 3:] @ Q.T).ravel()
        left = turned - columns @ np.linalg.lstsq(columns, turned, rcond=1e-9)[0]
        found.append((float(np.abs(left).sum()), Q))
    Q = min(found, key=lambda one: one[0])[1]
    return None if np.allclose(Q, np.eye(3)) else replace(
        _mapped(motion, np.eye(3), Q), axes=Q.T)


def _other_clock(motion: Motion) -> Motion | None:
    """Shift the wrench to where gravity explains it best, by whatever matrix."""
    if not motion.step:
        return None
    # clock offsets that are looked for; smaller ones are a delay, which the fit estimates [s]
    least_s, most_s = 0.1, 30.0
    every = max(1, round(least_s / motion.step), len(motion.t) // 2000)
    most = min(round(most_s / motion.step / every), len(motion.t) // every // 4)

    def nearest(every: int, lags: range) -> int:
        down, read = motion.in_sensor[::every], motion.wrench[::every, :3]

        def left(lag: int) -> float:
            f, g = (read[lag:], down[:len(down) - lag]) if lag >= 0 else (read[:lag], down[-lag:])
            f, g = f - f.mean(axis=0), g - g.mean(axis=0)
            gf = g.T @ f
            explained = (gf * (np.linalg.pinv(g.T @ g, rcond=1e-6) @ gf)).sum()
            return float(1.0 - explained / (f**2).sum())

        return min(lags, key=left)

    lag = nearest(every, range(-most, most + 1)) * every
    lag = nearest(1, range(lag - every, lag + every + 1))
    if abs(lag) * motion.step < least_s:
        return None
    return _shifted(motion, lag)


def _shifted(motion: Motion, lag: int) -> Motion:
    wrench, usable = np.roll(motion.wrench, -lag, axis=0), motion.usable & np.roll(
        motion.usable, -lag)
    usable[len(usable) - lag if lag > 0 else 0:len(usable) if lag > 0 else -lag] = False
    return replace(motion, wrench=wrench, usable=usable, t=motion.t + lag * motion.step)


def _filtered(motion: Motion) -> Motion | None:
    if not motion.step:
        return None
    # time constants of a driver's low-pass that are tried, and lengths of means (below 0):
    # neighbours differ by less than twice
    lengths_s = (0.1, 0.2, 0.35, 0.6, 1.0, 1.7, -0.35, -0.6, -1.0, -1.7)
    every = [motion.along(smoothing=tau) for tau in lengths_s if abs(tau) > 2 * motion.step]
    fits = [(explain_forces(one).force.mean_log, i) for i, one in enumerate(every)]
    plain = explain(motion)
    if not fits or plain is None or _in_time(motion, plain)[1].force.mean_log > max(fits)[0]:
        return None  # or a delay, which is estimated
    return every[max(fits)[1]]


def _zeroed_in_poses(motion: Motion) -> Motion | None:
    """Compare each stretch from a rest to the next with where it began."""
    if not motion.step:
        return None
    turning = np.linalg.norm(np.gradient(motion.R, motion.step, axis=0), axis=(1, 2)) > 0.02
    begins = np.flatnonzero(np.diff(turning.astype(int)) < 0) + 1
    if len(begins) < 2:
        return None
    part = np.searchsorted(begins, np.arange(len(turning)), side='right')
    return motion.along(zeroed=np.append(0, begins)[part])


def _change(kind: str) -> Callable[[Motion], Motion | None]:
    """Return a row in which bias, load or the vertical changes once, to the end."""
    def undo(motion: Motion) -> Motion | None:
        rows = usable_rows(motion, 200)
        few = replace(motion.along(R=motion.R[rows]), t=motion.t[rows], wrench=motion.wrench[rows])
        inside = few.t[len(rows) // 5:-len(rows) // 5]
        if len(inside) < 4:
            return None
        first, last = float(inside[0]), float(inside[-1])
        for _ in range(2):  # coarse, then between the neighbours of the best
            times = np.linspace(first, last, min(20, max(3, len(inside))))
            left = [_left(_changed(few, kind, float(t))) for t in times]
            i = int(np.argmin(left))
            first, last = float(times[max(0, i - 1)]), float(times[min(len(times) - 1, i + 1)])
        return _changed(motion, kind, float(times[i]))
    return undo


def _changed(motion: Motion, kind: str, at: float) -> Motion:
    after = motion.t >= at
    if kind == 'bias':
        return replace(motion, part=after.astype(int))
    columns = motion.in_sensor[:, :, None] if kind == 'load' else np.swapaxes(
        motion.R, 1, 2)[:, :, :2]
    return replace(motion, extra=columns * after[:, None, None])


def _cable(motion: Motion) -> Motion | None:
    """
    Let a spring pull from a place in base at one of the tool, which torques show.

    Of what it pulls all the time, the vertical part counts as weight.
    """
    if motion.path.position is None:
        return None
    place = motion.path.position - motion.path.position[motion.usable].mean(axis=0)
    to_sensor = np.swapaxes(motion.R, 1, 2)
    extra = np.concatenate([to_sensor @ place[:, :, None], to_sensor[:, :, :2]], axis=2)
    out = replace(motion, extra=extra)
    fit = explain_forces(out).force
    if -fit.theta[-6] < CONTRADICTION_SIGMA * fit.std[-6]:  # no spring, or one that pushes
        return None
    return replace(out, extra_torque=skew(extra @ -fit.theta[-6:-3]))


def _drifting(motion: Motion) -> Motion:
    """Let the bias of the forces run along a parabola."""
    run = (motion.t - motion.t.mean())[:, None, None] / np.ptp(motion.t)
    return replace(motion, extra=np.concatenate([np.eye(3) * run, np.eye(3) * run**2], axis=2))


def _left(motion: Motion) -> float:
    """Scale of what weight, biases and further columns leave of the forces."""
    extra = [] if motion.extra is None else [motion.extra]
    columns = np.concatenate([motion.in_sensor[:, :, None], *extra, biases(motion)], axis=2)
    fit = robust_fit(columns, motion.wrench[:, :3], tolerance=1e-2, freedom=FREEDOM)
    return float(fit.scale[0, 0])


TABLE = (
    Hypothesis('as recorded', lambda motion: motion),
    Hypothesis('sign', lambda motion: _mapped(motion, -np.eye(3))),
    Hypothesis('base', lambda motion: _mapped(motion, np.swapaxes(motion.R, 1, 2))),
    Hypothesis('inverted', _inverted),
    Hypothesis('wxyz', _from_w),
    Hypothesis('rotated', lambda motion: _axes(motion, 1.0), 3),
    Hypothesis('mirrored', lambda motion: _axes(motion, -1.0), 3),
    Hypothesis('force axes', _force_axes, 3),
    Hypothesis('crosstalk', _crosstalk, is_note=True),
    Hypothesis('tilted', _tilted, is_note=True),
    Hypothesis('exchanged', _exchanged),
    Hypothesis('torque in base', lambda motion: _mapped(
        motion, np.eye(3), np.swapaxes(motion.R, 1, 2))),
    Hypothesis('torque axes', _torque_axes, 3),
    Hypothesis('cable', _cable, 0, True, True),
    Hypothesis('rotated and tilted', _rotated_and_tilted, 3, is_costly=True),
    Hypothesis('clock', _other_clock, 1, is_costly=True),
    Hypothesis('smoothed', _filtered, 1, True, True),
    Hypothesis('zeroed in poses', _zeroed_in_poses, is_costly=True),
    Hypothesis('bias changes', _change('bias'), 1, True, True),
    Hypothesis('load changes', _change('load'), 1, True, True),
    Hypothesis('vertical changes', _change('tilt'), 1, True, True),
    Hypothesis('bias drifts', _drifting, 0, True, True),
)

TABLE_BY_NAME = {row.name: row for row in TABLE}
