"""
How much force the drives of a MuJoCo model may give, and which of them come to that.

A drive at its limit holds its joint no longer, and the arm goes where its inertia takes it: what
follows is no straight line in any number of the model.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from forcecal_ros.sim.mujoco_drives import Drive, TORQUE
from forcecal_ros.sim.protocol import Parameter
import numpy as np

STRONG = 0.1
"""Of a drive's limit, 1 sigma, relative: currents and torque constants are told to a tenth."""

NEAR = 1.0 - STRONG
"""Part of its limit from which a drive may be at it, were the limit lower by one sigma."""

REACHED = 0.999
"""Part of its limit from which a drive is at it: MuJoCo clips, and numbers round."""

ACTUATOR, JOINT, INPUT = 'actuator_forcerange', 'jnt_actfrcrange', 'actuator_ctrlrange'

_Write = Callable[[Any, float], None]


class Limit(NamedTuple):
    """
    A limit of a drive's force.

    Attributes
    ----------
    joint : str
    field : str
        Of the model, which has it.
    row : int
        In that field.
    most : float
        The larger of both ends [N m] or [N]; of an input in its own unit.
    """

    joint: str
    field: str
    row: int
    most: float

    @property
    def name(self) -> str:
        """As the model's user calls it."""
        return f'{self.field}[{self.joint}]'


def limits_of(model: Any, drives: Sequence[Drive]) -> list[Limit]:
    """List the limits of drives, the lowest of each."""
    found = []
    for one in drives:
        i, joint = one.actuator, model.joint(one.joint).id
        gear = abs(float(model.actuator_gear[i, 0])) or 1.0
        ranges = []  # size at the joint, field, row
        if model.actuator_forcelimited[i]:
            ranges.append((gear, ACTUATOR, i, model.actuator_forcerange[i]))
        if model.jnt_actfrclimited[joint]:
            ranges.append((1.0, JOINT, joint, model.jnt_actfrcrange[joint]))
        if one.kind == TORQUE and model.actuator_ctrllimited[i]:
            gain = abs(float(model.actuator_gainprm[i, 0]))
            ranges.append((gear * gain, INPUT, i, model.actuator_ctrlrange[i]))
        known = [(scale * float(np.abs(ends).max()), field, int(row), float(np.abs(ends).max()))
                 for scale, field, row, ends in ranges]
        if known:
            _, field, row, most = min(known)
            found.append(Limit(one.joint, field, row, most))
    return found


def limit_numbers(model: Any, limits: Sequence[Limit]
                  ) -> Iterator[tuple[Parameter, _Write, _Write]]:
    """
    List the limits of drives as parameters.

    Yields
    ------
    Parameter, write, patch
        Into a model that was compiled, and into its source.
    """
    for one in limits:
        unit = '1' if one.field == INPUT else 'N' if _slides(model, one.joint) else 'N m'
        yield (Parameter(one.name, one.most, STRONG * one.most, unit, 0.05 * one.most,
                         20.0 * one.most), *_of(model, one))


def _slides(model: Any, joint: str) -> bool:
    import mujoco

    return bool(model.jnt_type[model.joint(joint).id] == mujoco.mjtJoint.mjJNT_SLIDE)


def _of(model: Any, one: Limit) -> tuple[_Write, _Write]:
    ends = np.array(getattr(model, one.field)[one.row]) / one.most

    def write(to: Any, value: float) -> None:
        getattr(to, one.field)[one.row] = value * ends

    def patch(spec: Any, value: float) -> None:
        if one.field == JOINT:
            spec.joint(one.joint).actfrcrange = value * ends
        else:
            setattr(spec.actuators[one.row], one.field.removeprefix('actuator_'), value * ends)
    return write, patch


class Forces:
    """
    Collects how near its limit each drive comes while a model is run.

    Attributes
    ----------
    most : ndarray, shape (limits,)
        Largest force of each, in its limit.
    reached : ndarray, shape (limits,)
        Steps for which each was at its limit.
    """

    def __init__(self, model: Any, limits: Sequence[Limit]) -> None:
        self._limits = limits
        self._of = [(field, np.array([i for i, one in enumerate(limits) if one.field == field]),
                     np.array([_place(model, one) for one in limits if one.field == field]))
                    for field in (ACTUATOR, JOINT, INPUT)
                    if any(one.field == field for one in limits)]
        ends = np.array([getattr(model, one.field)[one.row] for one in limits]).reshape(-1, 2)
        self._low, self._high = ends.T
        self.most = np.zeros(len(limits))
        self.reached = np.zeros(len(limits))

    def look(self, data: Any) -> None:
        """See what the drives give now."""
        now = np.zeros(len(self._limits))
        for field, which, places in self._of:
            now[which] = getattr(data, _GIVEN[field])[places]
        ends = np.where(now < 0.0, self._low, self._high)
        part = np.divide(now, ends, out=np.zeros_like(now), where=ends != 0.0)
        self.most = np.maximum(self.most, part)
        self.reached += part > REACHED

    def near(self) -> list[Limit]:
        """List the limits that a drive comes to, or would come to if they were a little lower."""
        return [one for one, part in zip(self._limits, self.most) if part > NEAR]

    def said(self, step: float) -> Iterator[str]:
        """Say which drives are at their limit, and for how long; the step in s."""
        for i in map(int, np.argsort(-self.reached, kind='stable')):
            if self.reached[i]:
                one = self._limits[i]
                yield (f'in the model the drive of {one.joint} is at its {one.field} '
                       f'({one.most:g}) for {step * self.reached[i]:.2g} s, and the joint goes '
                       'where its inertia takes it')


_GIVEN = {ACTUATOR: 'actuator_force', JOINT: 'qfrc_actuator', INPUT: 'ctrl'}
"""Where the data of a run have what each field limits."""


def _place(model: Any, one: Limit) -> int:
    """Return where the data have what a limit clips."""
    return int(model.joint(one.joint).dofadr[0]) if one.field == JOINT else one.row
