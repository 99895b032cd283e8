"""
How a model's joints are told positions: by position actuators, or by those of velocity or torque.

A position actuator holds the command itself, whatever its gear and the scale of its input, and
one that integrates velocities (``intvelocity``) is told the command's rate. An actuator of
velocity or torque wants a controller, whose gains no MJCF has a place for: as
joint_trajectory_controller does, it is told ``rate + p error``, or ``p error + d rate of the
error``, with ``p`` and ``d`` from numerics of the model,
``<custom><numeric name="p[JOINT]" data="30"/></custom>``.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
import numpy as np

POSITION, INTEGRATED, VELOCITY, TORQUE = 'position', 'integrated velocity', 'velocity', 'torque'

BEYOND = 1e-3
"""
Part of an actuator's range by which commands may leave it: a controller's rounding of a joint at
its limit, and less than any noise of a joint.
"""


class Drive(NamedTuple):
    """
    An actuator of one joint.

    Attributes
    ----------
    actuator : int
        Its place in the model.
    joint : str
    kind : str
        What it holds.
    scale : float
        Its input for one rad, rad/s or N m of the joint.
    place, dof, act : int
        Where the joint's position and speed are, and the actuator's activation (-1: it has none).
    gains : tuple of int
        Where p and d are in the model's numerics.
    """

    actuator: int
    joint: str
    kind: str
    scale: float
    place: int
    dof: int
    act: int
    gains: tuple[int, ...] = ()

    def stiffness(self, model: Any) -> float:
        """Return how stiffly it holds its joint [N m/rad] or [N/m]; 0 where that is not known."""
        if self.kind == TORQUE and self.gains:
            return float(model.numeric_data[self.gains[0]])
        if self.kind in (POSITION, INTEGRATED):
            gear = float(model.actuator_gear[self.actuator, 0])
            return -gear ** 2 * float(model.actuator_biasprm[self.actuator, 1])
        return 0.0


def found_drives(mujoco: Any, model: Any, path: str) -> list[Drive]:
    """
    Find the actuators that joints can be told positions by, one of each joint.

    Raises
    ------
    ConfigError
        There is none; with what there is.
    """
    able: dict[str, Drive] = {}
    for i in range(model.nu):
        drive = _drive(mujoco, model, i)
        if drive and _usable(drive):
            before = able.get(drive.joint)
            if before is None or (drive.kind == POSITION and before.kind != POSITION):
                able[drive.joint] = drive
    if not able:
        raise ConfigError(f'--mujoco {path}: no actuator that a joint can be told positions by; '
                          f'{_others(mujoco, model) or "it has none on a joint"}')
    return sorted(able.values(), key=lambda one: one.actuator)


def why_not(mujoco: Any, model: Any, joint: str) -> str:
    """Say which actuators a joint has, and what they want."""
    return _others(mujoco, model, joint) or 'no actuator of the model drives it'


def _usable(drive: Drive) -> bool:
    return len(drive.gains) == {VELOCITY: 1, TORQUE: 2}.get(drive.kind, 0)


def _others(mujoco: Any, model: Any, joint: str = '') -> str:
    """Say of actuators that want a controller what they are told, and what to do."""
    drives = [_drive(mujoco, model, i) for i in range(model.nu)]
    kinds = {one.joint: one.kind for one in drives if one and joint in ('', one.joint)}
    wants = [f'joint {name} has one of {kind}' for name, kind in kinds.items()]
    if not wants:
        return ''
    first, kind = next(iter(kinds.items()))
    gains = [f'<numeric name="{letter}[{first}]" data="..."/>'
             for letter in ('p' if kind == VELOCITY else 'pd')]
    return (f'{", ".join(wants)}; put the gains of its controller into <custom>, '
            f'{" and ".join(gains)}')


def _drive(mujoco: Any, model: Any, i: int) -> Drive | None:
    """Return what an actuator does to its joint; None where it holds nothing that is known."""
    joint = int(model.actuator_trnid[i, 0])
    if (int(model.actuator_trntype[i]) not in (int(mujoco.mjtTrn.mjTRN_JOINT),
                                               int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
            or not is_scalar(mujoco, model, joint)):
        return None
    gear, gain = float(model.actuator_gear[i, 0]), float(model.actuator_gainprm[i, 0])
    kind, stiff = _kind(mujoco, model, i), -float(model.actuator_biasprm[i, 1])
    if not kind or gear * gain == 0.0:
        return None
    held = {VELOCITY: -float(model.actuator_biasprm[i, 2]),
            TORQUE: 1.0 / gear ** 2}.get(kind, stiff)
    name = model.joint(joint).name
    letters = {VELOCITY: 'p', TORQUE: 'pd'}.get(kind, '')
    numerics = {model.numeric(k).name: int(model.numeric_adr[k]) for k in range(model.nnumeric)}
    gains = tuple(numerics[f'{a}[{name}]'] for a in letters if f'{a}[{name}]' in numerics)
    return Drive(i, name, kind, gear * held / gain, int(model.jnt_qposadr[joint]),
                 int(model.jnt_dofadr[joint]), int(model.actuator_actadr[i]), gains)


def _kind(mujoco: Any, model: Any, i: int) -> str:
    """Say what an actuator holds; '' where that is none of these."""
    dynamics, biases = mujoco.mjtDyn, mujoco.mjtBias
    kind = int(model.actuator_dyntype[i])
    follows = kind in (int(dynamics.mjDYN_NONE), int(dynamics.mjDYN_FILTER),
                       int(dynamics.mjDYN_FILTEREXACT))
    integrates = kind == int(dynamics.mjDYN_INTEGRATOR)
    if model.actuator_gaintype[i] != mujoco.mjtGain.mjGAIN_FIXED or not (follows or integrates):
        return ''
    gain = float(model.actuator_gainprm[i, 0])
    offset, stretch, speed = (float(x) for x in model.actuator_biasprm[i, :3])
    affine = model.actuator_biastype[i] == biases.mjBIAS_AFFINE
    if affine and stretch < 0.0 and (offset == 0.0 or gain == -stretch):
        return POSITION if follows else INTEGRATED
    if not follows:
        return ''
    if affine and stretch == 0.0 and offset == 0.0 and speed < 0.0:
        return VELOCITY
    return TORQUE if model.actuator_biastype[i] == biases.mjBIAS_NONE else ''


def is_scalar(mujoco: Any, model: Any, joint: int) -> bool:
    """Say whether one number is the position of a joint."""
    return int(model.jnt_type[joint]) in (int(mujoco.mjtJoint.mjJNT_HINGE),
                                          int(mujoco.mjtJoint.mjJNT_SLIDE))


class Controller:
    """
    Tells actuators the positions of their joints.

    Parameters
    ----------
    q : ndarray, shape (n, drives)
        Of each step [rad] or [m].
    step : float
        [s]
    play : mapping of str to float
        Of the drives of joints, half of it [rad] or [m]: the joint, which its friction holds,
        stays where it is until the command has crossed the play.

    Raises
    ------
    ConfigError
        A command is beyond what an actuator takes.
    """

    def __init__(self, model: Any, drives: Sequence[Drive], q: Array, step: float,
                 play: Mapping[str, float]) -> None:
        if play:
            q = np.stack([_behind(x, play.get(one.joint, 0.0)) for x, one in zip(q.T, drives)],
                         axis=1)
        self._q, self._drives = q, drives
        self._rate = np.diff(q, axis=0, append=q[-1:]) / step
        scale = np.array([one.scale for one in drives])
        integrated = np.array([one.kind == INTEGRATED for one in drives])
        self._given = np.where(integrated, self._rate, q) * scale
        self._index = np.array([one.actuator for one in drives])
        self._closed = [(j, one, [float(model.numeric_data[at]) for at in one.gains])
                        for j, one in enumerate(drives) if one.gains]
        self._integrated = self._index[integrated]
        for j, one in enumerate(drives):
            if not one.gains:
                _refuse_beyond(model, one, self._given[:, j])

    def begin(self, data: Any) -> None:
        """Put the joints where they are first commanded to be, and hold them there."""
        for q, one in zip(self._q[0], self._drives):
            data.qpos[one.place] = q
            if one.act >= 0:
                data.act[one.act] = one.scale * q
        self.tell(data, 0)
        data.ctrl[self._integrated] = 0.0

    def hold(self, data: Any) -> None:
        """Hold the first command for a step."""
        for j, one, gains in self._closed:
            data.ctrl[one.actuator] = self._closing(data, j, one, gains, self._q[0, j], 0.0)

    def tell(self, data: Any, k: int) -> None:
        """Tell the actuators their input of step k."""
        data.ctrl[self._index] = self._given[k]
        for j, one, gains in self._closed:
            data.ctrl[one.actuator] = self._closing(data, j, one, gains, self._q[k, j],
                                                 self._rate[k, j])

    def _closing(self, data: Any, j: int, one: Drive, gains: Sequence[float], q: float,
                 rate: float) -> float:
        error = q - data.qpos[one.place]
        if one.kind == VELOCITY:
            return float(one.scale * (rate + gains[0] * error))
        return float(one.scale * (gains[0] * error + gains[1] * (rate - data.qvel[one.dof])))


def _behind(q: Array, play: float) -> Array:
    """Follow a command as what is behind play does."""
    if play <= 0.0:
        return q
    out, at = np.empty_like(q), float(q[0])
    for k, x in enumerate(q.tolist()):
        at = min(max(at, x - play), x + play)
        out[k] = at
    return out


STILL = 2e-3
"""
Speed of a joint [rad/s], [m/s] above which an arm that was to rest swings: at 5 Hz that is
0.06 mrad, the noise of a joint.
"""


class Swing:
    """Sees whether joints rest when the commands begin."""

    def __init__(self, drives: Sequence[Drive]) -> None:
        self._drives, self._speeds = drives, np.zeros(0)

    def look(self, data: Any) -> None:
        """See how fast the joints are, the first time that it is asked."""
        if not len(self._speeds):
            self._speeds = np.abs(data.qvel[[one.dof for one in self._drives]])

    def said(self, after: float) -> Iterator[str]:
        """Say which joint still swings so many seconds after the start [s]."""
        if len(self._speeds) and self._speeds.max() > STILL:
            k = int(self._speeds.argmax())
            yield (f'in the model {self._drives[k].joint} still moves at {self._speeds[k]:.2g} '
                   f'rad/s after {after:g} s at the first command: damp its drive (kv) or the '
                   'joint, as the robot does')


def _refuse_beyond(model: Any, one: Drive, given: Array) -> None:
    """Refuse commands that MuJoCo would clip in silence."""
    if not model.actuator_ctrllimited[one.actuator]:
        return
    low, high = (float(x) for x in model.actuator_ctrlrange[one.actuator])
    least, most = float(given.min()), float(given.max())
    room = BEYOND * (high - low)
    if least < low - room or most > high + room:
        raise ConfigError(f'joint {one.joint} is commanded from {least:.4g} to {most:.4g}, and '
                          f'the ctrlrange of its actuator is {low:.4g} to {high:.4g}, where '
                          'MuJoCo would clip; give the model the range that the robot has')


def of_same_tree(model: Any, drives: Sequence[Drive], body: str) -> list[Drive]:
    """Leave out what drives no arm that carries a body: a second arm on a base of its own."""
    moved = int(model.body_weldid[model.body(body).id])
    tree = int(model.dof_treeid[model.body_dofadr[moved]])
    return [one for one in drives if int(model.dof_treeid[one.dof]) == tree]


def warned(mujoco: Any, data: Any) -> str:
    """Return what MuJoCo warns of: it began anew, or left out contacts; empty: of nothing."""
    kinds = mujoco.mjtWarning
    found = [(int(kind), data.warning[int(kind)]) for kind in (
        kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC, kinds.mjWARN_BADCTRL,
        kinds.mjWARN_INERTIA, kinds.mjWARN_CONTACTFULL, kinds.mjWARN_CNSTRFULL)]
    said = (mujoco.mju_warningText(kind, int(one.lastinfo)) for kind, one in found if one.number)
    return next(said, '').rstrip('.')
