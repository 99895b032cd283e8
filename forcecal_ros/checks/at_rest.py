"""Axes and unit of a wrench by what weighs on it all along, whatever the robot does."""

from typing import NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.frame_faults import refuse_other_frame, Stated
from forcecal_ros.checks.frames import Forces, judge, Judgement
from forcecal_ros.checks.orientations import read_from_w
from forcecal_ros.checks.torques import refuse_other_torques
from forcecal_ros.checks.units import force_unit_of, lever_units_of, mended
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.core.time_grid import Averager
import numpy as np

LENGTH = 0.5
"""Means over so long even out what moves and rings [s]."""

SHORT = 0.1
"""The same of a robot that never rests for so long; inertia is left in them, a tenth of a weight
at 1 m/s^2 [s]."""

TURNS = 0.1
"""Means in which the sensor turns by more tell no direction [rad]."""

FEWEST = 12
"""So many means at least tell weight and frame."""

UNTOUCHED = 3.0
"""Means farther from a fit than so many times the median are taken for contact."""

ROUNDS, NEARLY = 30, 0.1
"""Rounds after which a fit by absolute deviations stands (twice as many keep the same means), and
the share of their median below which deviations count alike."""

UNEXPLAINED = 0.3
"""Another frame is believed that leaves less than this share of what the stated one leaves: of
sound recordings with pushes the ratio is 0.8 and more."""

TURNED_UNEXPLAINED = 0.1
"""Turned axes are believed that leave less than this share: gains 25 % too large in one axis and
15 % too small in another leave 0.29."""

OTHER_TOOL = 0.5
"""What weighs less than this share of a model's tool is another one: tool_mass ends there, too."""

WEIGHTLESS = 0.05
"""What weighs less than this share of a model's tool in any frame has had its weight taken off:
kgf would leave a tenth."""

CLEARLY = 50.0
"""Standard errors of what weighs a thousandth of a model's tool: forces in kN have a thousandth of
the noise, too, and a weight that was taken off leaves none."""

NAME_THE_TOOL = 'calibrate what hung there (forcecal calibrate) and give --calibration'
"""What to do where another tool hung on the sensor than that of a rig."""

OPPOSITE = 0.3
"""A centre of mass that torques show on the other side, to this share, is of the other sign."""


class AtRest(NamedTuple):
    """
    Means of a recording in which the sensor hardly turns.

    Attributes
    ----------
    begins : ndarray, shape (n,)
        Of the means, each half a second long [s].
    forces : Forces
    torque : ndarray, shape (n, 3)
        [N m]
    """

    begins: Array
    forces: Forces
    torque: Array

    @property
    def untouched(self) -> 'AtRest':
        """Those of them that hold no contact: close to a weight in some frame, and a bias."""
        forces, eye = self.forces, np.broadcast_to(np.eye(3), (len(self.begins), 3, 3))
        in_sensor = np.einsum('ij,nk->nijk', np.eye(3), forces.in_sensor).reshape(-1, 3, 9)
        off = min((_deviations(np.concatenate([columns, eye], axis=2), forces.wire)
                   for columns in (in_sensor, forces.R_base_sensor, np.swapaxes(
                       read_from_w(forces.R_base_sensor), 1, 2))), key=np.median)
        keep = off <= UNTOUCHED * max(float(np.median(off)), limits.TINY)
        specific = None if forces.specific is None else forces.specific[keep]
        return AtRest(self.begins[keep], Forces(
            forces.R_base_sensor[keep], forces.wire[keep], forces.gravity, None, specific,
            forces.rests),
            self.torque[keep])

    @property
    def tells(self) -> bool:
        """Whether they are enough, and turned by enough, to tell a weight from a bias."""
        in_sensor = self.forces.in_sensor
        return len(in_sensor) >= FEWEST and bool(
            np.linalg.norm(in_sensor.std(axis=0))
            >= limits.SPANNED * np.linalg.norm(self.forces.gravity))


def _deviations(design: Array, wire: Array) -> Array:
    """
    Return how far forces (n, 3) are off a linear model (n, 3, k) of least absolute deviations.

    By least squares whose weights follow from the round before, so that pushes pull little.
    """
    off = np.ones(len(wire))
    for _ in range(ROUNDS):
        weight = 1.0 / np.sqrt(np.maximum(off, NEARLY * float(np.median(off)) + limits.TINY))
        rows = (design * weight[:, None, None]).reshape(-1, design.shape[2])
        fit = np.linalg.lstsq(rows, (wire * weight[:, None]).ravel(), rcond=1e-6)[0]
        off = np.linalg.norm(wire - design @ fit, axis=1)
    return np.asarray(off)


def at_rest(recording: Recording, gravity: Array, length: float = LENGTH) -> AtRest | None:
    """
    Return the forces of a recording at rest, contact included; None: they are too few.

    Parameters
    ----------
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    length : float
        Of a mean [s].
    """
    pose, wrench = recording.pose, recording.wrench
    if pose is None or wrench is None or len(pose) < FEWEST or len(wrench) < FEWEST:
        return None
    begins = np.arange(max(pose.t[0], wrench.t[0]), min(pose.t[-1], wrench.t[-1]) - length, length)
    begins, R = _resting(pose, begins, length)
    means = means_at(wrench, begins, length)
    whole = np.isfinite(means).all(axis=1)
    if whole.sum() < FEWEST:
        return None
    return AtRest(begins[whole], Forces(R[whole], means[whole, :3], gravity, None, None,
                                        length >= LENGTH),
                  means[whole, 3:])


def _resting(pose: PoseStream, begins: Array, length: float) -> tuple[Array, Array]:
    """Return the stretches in which a sensor hardly turns, and its orientation there."""
    first, middle, last = (np.searchsorted(pose.t, begins + share * length).clip(
        max=len(pose) - 1) for share in (0.0, 0.5, 1.0))
    R = pose.R_base_sensor
    turned = np.linalg.norm(R[first] - R[last], axis=(1, 2)) / np.sqrt(2.0)
    near = np.abs(pose.t[middle] - begins - length / 2.0) < length / 2.0
    rest = near & (turned < TURNS)
    return begins[rest], R[middle[rest]]


def means_at(stream: Stream, begins: Array, length: float = LENGTH) -> Array:
    """Return the means of a stream over some time each, half a second by default."""
    return np.asarray(Averager(stream.t, stream.values).means(begins, length))


def refuse_other_axes(recording: Recording, mass: float, com: Array, gravity: Array,
                      other_tool: str = NAME_THE_TOOL, short: bool = False, by: str = 'rig'
                      ) -> None:
    """
    Refuse a wrench in another frame, with other axes or in other units than is believed.

    Parameters
    ----------
    mass : float
        Of the tool, as a model has it [kg].
    com : ndarray, shape (3,)
        Its centre of mass [m].
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    other_tool : str
        What to do where another tool hung there.
    short : bool
        Ask robots that never rest, too.
    by : str
        ``rig`` or ``calibration``: where the model is.

    Raises
    ------
    DataError
        Names cause and remedy, as ``forcecal calibrate`` does.
    """
    found = untouched_at_rest(recording, gravity, short)
    if found is not None:
        refuse_other_forces(found, mass, com, other_tool, Stated(
            gravity / np.linalg.norm(gravity), sensor_from_pose=recording.sensor_from_pose, by=by))


def refuse_other_forces(found: AtRest, mass: float, com: Array, other_tool: str, stated: Stated
                        ) -> None:
    """Refuse means without contact; otherwise as :func:`refuse_other_axes`."""
    judgement = judge(found.forces)
    if judgement.likely[0].mass < WEIGHTLESS * mass:
        if judgement.plain.mass > CLEARLY * judgement.plain.mass_std:
            refuse_other_force_unit(judgement.plain.mass, mass)
        _refuse_other_tool(judgement.plain.mass, mass, other_tool)
    if is_elsewhere(judgement):
        refuse_other_frame(judgement, stated)
    plain = judgement.plain
    if judgement.likely[0] is not plain:
        return
    refuse_other_force_unit(plain.mass, mass)
    _refuse_other_tool(plain.mass, mass, other_tool)
    weight = mass * found.forces.in_sensor
    refuse_other_torques(weight, found.torque, None, found.forces.R_base_sensor,
                         found.forces.rests)
    refuse_other_lever(weight, found.torque, com)


def beside_simulated(recording: Recording, simulated: Recording, mass: float, gravity: Array
                     ) -> AtRest | None:
    """
    Return short means, beside what a simulated tool weighs and accelerates; contact left out.

    Parameters
    ----------
    simulated : Recording
        Of the same motion; its wrench is that of a tool of ``mass`` [kg].
    gravity : ndarray, shape (3,)
        In base [m/s^2].

    Returns
    -------
    AtRest or None
        None where they tell no weight from a bias.
    """
    found = at_rest(recording, gravity, SHORT)
    if found is None or simulated.wrench is None:
        return None
    force = means_at(simulated.wrench, found.begins, SHORT)[:, :3]
    both = np.isfinite(force).all(axis=1)
    forces, R = found.forces, found.forces.R_base_sensor[both]
    moving = Forces(R, forces.wire[both], gravity, None,
                    np.einsum('nij,nj->ni', R, force[both]) / mass, rests=False)
    if len(moving.wire) < FEWEST:
        return None
    found = AtRest(found.begins[both], moving, found.torque[both]).untouched
    return found if found.tells else None


def untouched_at_rest(recording: Recording, gravity: Array, short: bool = False
                      ) -> AtRest | None:
    """
    Return the forces at rest without contact; None where they tell no weight from a bias.

    ``short``: of a robot that never rests, as many short means as last half as long.
    """
    found = at_rest(recording, gravity)
    found = None if found is None else found.untouched
    if found is not None and found.tells:
        return found
    if not short or (found := at_rest(recording, gravity, SHORT)) is None:
        return None
    found = found.untouched
    enough = len(found.begins) * SHORT >= FEWEST * LENGTH / 2.0
    return found if enough and found.tells else None


def is_elsewhere(judgement: Judgement) -> bool:
    """Whether forces are of another frame or sign, beyond what gains and pushes make seem so."""
    best, plain = judgement.likely[0], judgement.plain
    least = TURNED_UNEXPLAINED if best.name == 'turned' else UNEXPLAINED
    return plain.mass < 0.0 or (
        best.name not in ('tilted', 'both') and best.rms < least * plain.rms)


def place_of(weight: Array, torque: Array) -> Array:
    """Return the centre of mass that torques show, shape (3,) [m]."""
    lever = -skew(weight)
    rows = (lever - lever.mean(axis=0)).reshape(-1, 3)
    return np.asarray(
        np.linalg.lstsq(rows, (torque - torque.mean(axis=0)).ravel(), rcond=1e-6)[0])


def refuse_other_lever(weight: Array, torque: Array, com: Array) -> None:
    """Refuse torques of the opposite sign, or in another unit."""
    shown = place_of(weight, torque)
    if unit := lever_units_of(shown, com):
        raise DataError(
            f'wrench: its torques put the centre of mass at {_metres(shown)}, the model has it at '
            f'{_metres(com)}: {unit}; mend the driver, or where forcecal import read a table '
            'state their unit in its specification')
    times = float(shown @ com) / max(float(com @ com), limits.TINY)
    off = np.linalg.norm(shown - times * com) / max(float(np.linalg.norm(shown)), limits.TINY)
    if off > OPPOSITE:
        return
    if abs(times + 1.0) < OPPOSITE:
        raise DataError(
            f'wrench: its torques put the centre of mass at {_metres(shown)}, the model has it at '
            f'{_metres(com)}: they have the opposite sign of the forces; correct them in the '
            'driver')


def _refuse_other_tool(shown: float, mass: float, remedy: str) -> None:
    """Refuse a recording in which far less than a tool's mass [kg] weighs on the sensor."""
    if shown < OTHER_TOOL * mass:
        why = ('the driver takes its weight off; let it leave the weight in (where nothing hung '
               f'there, {remedy} instead)' if shown < WEIGHTLESS * mass else
               f'another one hung there; {remedy}')
        raise DataError(f'wrench: the tool of {mass:.4g} kg weighs {shown:.4g} kg in this '
                        f'recording: {why}')


def _metres(place: Array) -> str:
    return f'({" ".join(f"{x:.3g}" for x in place)}) m'


def refuse_other_force_unit(shown: float, mass: float) -> None:
    """
    Refuse forces that make another mass of a tool [kg], as another unit would.

    Raises
    ------
    DataError
        Names the unit.
    """
    unit = force_unit_of(shown, mass)
    if unit is not None:
        name, factor = unit
        raise DataError(
            f'wrench: the tool of {mass:.4g} kg weighs {shown:.4g} kg in this recording: '
            f'its forces are in {name}; {mended(factor, name)}')
