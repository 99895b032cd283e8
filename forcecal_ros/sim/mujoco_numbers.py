"""What of a MuJoCo model may be set: drives, bodies, joints, limits and contacts."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.sim.protocol import Parameter
import numpy as np
from numpy.typing import NDArray

try:
    import mujoco
except ImportError:
    mujoco = None

_Write = Callable[[Any, float], None]

POSITION, INTEGRATED, VELOCITY, TORQUE = 'position', 'integrated velocity', 'velocity', 'torque'
PID = 'position and rate'

BACKLASH = 'backlash'

_GAIN_LETTERS = {VELOCITY: 'p', TORQUE: 'pd'}
"""Gains of the controller that an actuator needs, by what it holds."""


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
    ctrl : int
        Where its input is.
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
    ctrl: int
    gains: tuple[int, ...] = ()


def found_drives(model: Any, path: str) -> list[Drive]:
    """
    Find the actuators that take positions of joints, one of each joint.

    Raises
    ------
    ConfigError
        There is none; with what there is.
    """
    able: dict[str, Drive] = {}
    holds = (POSITION, PID)
    for i in range(len(model.actuator_trntype)):  # model.nu counts inputs
        drive = _drive(model, i)
        if drive and len(drive.gains) == len(_GAIN_LETTERS.get(drive.kind, '')):
            before = able.get(drive.joint)
            if before is None or (drive.kind in holds and before.kind not in holds):
                able[drive.joint] = drive
    if not able:
        raise ConfigError(f'--mujoco {path}: no actuator takes the position of a joint; '
                          f'{_requirements(model) or "add one to each joint"}')
    return sorted(able.values(), key=lambda one: one.actuator)


def reason_not_driven(model: Any, joint: str) -> str:
    """Say which actuators a joint has, and what they require."""
    return _requirements(model, joint) or 'no actuator of the model drives it'


def _requirements(model: Any, joint: str = '') -> str:
    """Return what actuators that hold no position need, and which are not supported."""
    kinds, others = dict[str, str](), dict[str, str]()
    for i in range(len(model.actuator_trntype)):
        name = _joint_of(model, i)
        if name and joint in ('', name):
            drive = _drive(model, i)
            if drive:
                kinds[name] = drive.kind
            else:
                others[name] = _type_of(model, i)
    if kinds:
        first, kind = next(iter(kinds.items()))
        gains = [f'<numeric name="{letter}[{first}]" data="..."/>'
                 for letter in _GAIN_LETTERS[kind]]
        listed = ', '.join(f'joint {name} has one of {kind}' for name, kind in kinds.items())
        return (f'{listed}; put the gains of its controller into <custom>, '
                f'{" and ".join(gains)}')
    if others:
        listed = ', '.join(f'joint {name} has {kind}' for name, kind in others.items())
        return (f'{listed}, which is not supported; drive it by <position>, <pid>, <intvelocity>, '
                '<velocity> or <motor>')
    return ''


def _type_of(model: Any, i: int) -> str:
    """Name an actuator that holds nothing known, as its gain and bias are called in MuJoCo."""
    def word(kinds: Any, prefix: str, value: int) -> str:
        return next((name.removeprefix(prefix).lower() for name in dir(kinds)
                     if name.startswith(prefix) and int(getattr(kinds, name)) == value), '?')

    gain = word(mujoco.mjtGain, 'mjGAIN_', int(model.actuator_gaintype[i]))
    bias = word(mujoco.mjtBias, 'mjBIAS_', int(model.actuator_biastype[i]))
    return f'an actuator of gain {gain} and bias {bias}' if gain != bias else (
        f'an actuator of kind {gain}')


def _joint_of(model: Any, i: int) -> str:
    """Return the joint of one number that an actuator drives; empty if it drives none."""
    joint = int(model.actuator_trnid[i, 0])
    on_joint = int(model.actuator_trntype[i]) in (int(mujoco.mjtTrn.mjTRN_JOINT),
                                                  int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return str(model.joint(joint).name) if on_joint and is_scalar(model, joint) else ''


def _drive(model: Any, i: int) -> Drive | None:
    """Return what an actuator does to its joint; None if it holds nothing that is known."""
    name = _joint_of(model, i)
    gear, gain = float(model.actuator_gear[i, 0]), float(model.actuator_gainprm[i, 0])
    kind, stiff = _kind(model, i), -float(model.actuator_biasprm[i, 1])
    if not (name and kind) or gear * (stiff if kind == PID else gain) == 0.0:
        return None
    held = {VELOCITY: -float(model.actuator_biasprm[i, 2]),
            TORQUE: 1.0 / gear ** 2}.get(kind, stiff)
    numerics = {model.numeric(k).name: int(model.numeric_adr[k]) for k in range(model.nnumeric)}
    gains = tuple(numerics[f'{letter}[{name}]'] for letter in _GAIN_LETTERS.get(kind, '')
                  if f'{letter}[{name}]' in numerics)
    joint = model.joint(name).id
    act = -1 if kind == PID else int(model.actuator_actadr[i])  # that of a <pid> is its integral
    scale = gear if kind == PID else gear * held / gain
    return Drive(i, name, kind, scale, int(model.jnt_qposadr[joint]),
                 int(model.jnt_dofadr[joint]), act, _input_of(model, i), gains)


def _input_of(model: Any, i: int) -> int:
    """Return where the first input of an actuator is: older releases have one each."""
    places = getattr(model, 'actuator_ctrladr', None)
    return i if places is None else int(places[i])


def _kind(model: Any, i: int) -> str:
    """Say what an actuator holds; '' where that is none of these."""
    dynamics, biases = mujoco.mjtDyn, mujoco.mjtBias
    kind = int(model.actuator_dyntype[i])
    follows = kind in (int(dynamics.mjDYN_NONE), int(dynamics.mjDYN_FILTER),
                       int(dynamics.mjDYN_FILTEREXACT))
    integrates = kind == int(dynamics.mjDYN_INTEGRATOR)
    if int(model.actuator_gaintype[i]) == int(getattr(mujoco.mjtGain, 'mjGAIN_PID', -1)):
        return PID
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


def is_scalar(model: Any, joint: int) -> bool:
    """Say whether one number is the position of a joint."""
    return int(model.jnt_type[joint]) in (int(mujoco.mjtJoint.mjJNT_HINGE),
                                          int(mujoco.mjtJoint.mjJNT_SLIDE))


class Controller:
    """
    Commands actuators the positions of their joints.

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
            q = np.stack([_follow_backlash(x, play.get(one.joint, 0.0))
                          for x, one in zip(q.T, drives)], axis=1)
        self._q, self._drives = q, drives
        self._rate = np.diff(q, axis=0, append=q[-1:]) / step
        scale = np.array([one.scale for one in drives])
        integrated = np.array([one.kind == INTEGRATED for one in drives])
        self._given = np.where(integrated, self._rate, q) * scale
        self._index = np.array([one.ctrl for one in drives])
        self._rates = [(j, one.ctrl + 1, one.scale) for j, one in enumerate(drives)
                       if one.kind == PID]
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
        data.ctrl[[at for _, at, _ in self._rates]] = 0.0

    def hold(self, data: Any) -> None:
        """Hold the first command for a step."""
        for j, one, gains in self._closed:
            data.ctrl[one.ctrl] = self._closing(data, j, one, gains, self._q[0, j], 0.0)

    def tell(self, data: Any, k: int) -> None:
        """Tell the actuators their input of step k."""
        data.ctrl[self._index] = self._given[k]
        for j, at, scale in self._rates:
            data.ctrl[at] = scale * self._rate[k, j]
        for j, one, gains in self._closed:
            data.ctrl[one.ctrl] = self._closing(data, j, one, gains, self._q[k, j],
                                                 self._rate[k, j])

    def _closing(self, data: Any, j: int, one: Drive, gains: Sequence[float], q: float,
                 rate: float) -> float:
        error = q - data.qpos[one.place]
        if one.kind == VELOCITY:
            return float(one.scale * (rate + gains[0] * error))
        return float(one.scale * (gains[0] * error + gains[1] * (rate - data.qvel[one.dof])))


def _follow_backlash(q: Array, play: float) -> Array:
    """Follow a command as what is behind play does."""
    if play <= 0.0:
        return q
    out, at = np.empty_like(q), float(q[0])
    for k, x in enumerate(q.tolist()):
        at = min(max(at, x - play), x + play)
        out[k] = at
    return out


class Swing:
    """Sees whether joints rest when the commands begin."""

    def __init__(self, drives: Sequence[Drive]) -> None:
        self._drives, self._speeds = drives, np.zeros(0)

    def look(self, data: Any) -> None:
        """See how fast the joints are, at the first call."""
        if not len(self._speeds):
            self._speeds = np.abs(data.qvel[[one.dof for one in self._drives]])

    def notes(self, after: float) -> Iterator[str]:
        """Say which joint still swings so many seconds after the start [s]."""
        # speed of a joint [rad/s], [m/s] above which an arm that was to rest swings: at 5 Hz that
        # is 0.06 mrad, the noise of a joint
        if len(self._speeds) and self._speeds.max() > 2e-3:
            k = int(self._speeds.argmax())
            yield (f'in the model {self._drives[k].joint} still moves at {self._speeds[k]:.2g} '
                   f'rad/s after {after:g} s at the first command: add the damping of the robot '
                   'to its drive (kv) or joint')


def _refuse_beyond(model: Any, one: Drive, given: Array) -> None:
    """Refuse commands that MuJoCo would clip in silence."""
    if not model.actuator_ctrllimited[one.ctrl]:
        return
    low, high = (float(x) for x in model.actuator_ctrlrange[one.ctrl])
    least, most = float(given.min()), float(given.max())
    # part of an actuator's range by which commands may leave it: a controller's rounding of a
    # joint at its limit, and less than any noise of a joint
    room = 1e-3 * (high - low)
    if least < low - room or most > high + room:
        raise ConfigError(f'joint {one.joint} is commanded from {least:.4g} to {most:.4g}, and '
                          f'the ctrlrange of its actuator is {low:.4g} to {high:.4g}, where '
                          'MuJoCo would clip; give the model the range of the robot')


def of_same_tree(model: Any, drives: Sequence[Drive], body: str) -> list[Drive]:
    """Leave out what drives no arm that carries a body: a second arm on a base of its own."""
    moved = int(model.body_weldid[model.body(body).id])
    tree = int(model.dof_treeid[model.body_dofadr[moved]])
    return [one for one in drives if int(model.dof_treeid[one.dof]) == tree]


def warning_of(data: Any) -> str:
    """Return what MuJoCo warns of: it began anew, or left out contacts; empty: of nothing."""
    kinds = mujoco.mjtWarning
    found = [(int(kind), data.warning[int(kind)]) for kind in (
        kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC, kinds.mjWARN_BADCTRL,
        kinds.mjWARN_INERTIA, kinds.mjWARN_CONTACTFULL, kinds.mjWARN_CNSTRFULL)]
    texts = (mujoco.mju_warningText(kind, int(one.lastinfo)) for kind, one in found if one.number)
    return next(texts, '').rstrip('.')


GAIN_SIGMA = (0.05, 0.1)
"""Of the gains kp and kv of a position actuator, 1 sigma, relative: as controllers are set."""


class Number(NamedTuple):
    """A parameter, and how it is written into a model."""

    parameter: Parameter
    write: _Write


def numbers_of(model: Any, drives: Sequence[Drive], body: str, site: str
               ) -> tuple[Number, ...]:
    """
    List what may be off: of the tool, the body that has the site, of the joints and of the base.

    Raises
    ------
    ConfigError
        The tool weighs nothing, or a controller's gain is not above zero.
    """
    return (*_of_tool(model, body, site), *_of_joints(model, drives), *_of_base(model))


def _of_tool(model: Any, body: str, site: str) -> list[Number]:
    i = model.body(body).id
    mass, com = float(model.body_mass[i]), model.body_ipos[i].copy()
    if mass <= 0.0:
        raise ConfigError(f'body {body} below site {site} has no mass; give the tool its mass')
    inertia = model.body_inertia[i].copy()

    def weigh(to: Any, value: float) -> None:
        to.body_mass[i] = value
        to.body_inertia[i] = inertia * (value / mass)

    # mass sigma and com sigma: how well a tool is known by its drawing: mass (relative) and
    # centre of mass [m], 1 sigma
    found = [Number(Parameter(f'body_mass[{body}]', mass, 0.01 * mass, 'kg', 0.05 * mass,
                              20.0 * mass, 'tool', ('tool_mass',)), weigh)]
    return found + [Number(Parameter(
        f'body_ipos[{body}].{a}', float(com[k]), 0.001, 'm', com[k] - 0.5, com[k] + 0.5,
        'tool', ('tool_com',)), _writer('body_ipos', (i, k))) for k, a in enumerate('xyz')]


def _of_joints(model: Any, drives: Sequence[Drive]) -> list[Number]:
    # of dry friction, 1 sigma: part of the model's, and beside it [N m] or [N]: what warmth makes
    joint_friction_sigma = (0.1, 0.1)
    found = []
    for drive in drives:
        i, name, dof = drive.actuator, drive.joint, drive.dof
        slides = is_slide(model, name)
        friction = float(model.dof_frictionloss[dof])
        damping, kv = float(model.dof_damping[dof]), -float(model.actuator_biasprm[i, 2])
        sigma = joint_friction_sigma[0] * friction + joint_friction_sigma[1]
        found.append(Number(Parameter(f'dof_frictionloss[{name}]', friction, sigma,
                                      'N' if slides else 'N m', 0.0),
                            _writer('dof_frictionloss', dof)))
        # half the play of a joint, 1 sigma: of gears with an arc minute; the model has none
        sigma, unit = (5e-5, 'm') if slides else (1.5e-4, 'rad')
        found.append(Number(Parameter(f'{BACKLASH}[{name}]', 0.0, sigma, unit, 0.0, 0.05),
                            _nowhere))
        if drive.kind in (VELOCITY, TORQUE):
            found += [_of_controller(model, letter, drive, at)
                      for letter, at in zip('pd', drive.gains)]
        else:
            kp = -float(model.actuator_biasprm[i, 1])
            found.append(Number(_scaled(f'kp[{name}]', kp, GAIN_SIGMA[0]),
                                _coefficient(model, i, 1, drive.kind)))
        if drive.kind == PID and (ki := float(model.actuator_gainprm[i, 0])) > 0.0:
            found.append(Number(_scaled(f'ki[{name}]', ki, GAIN_SIGMA[1]),
                                _writer('actuator_gainprm', (i, 0))))
        if kv > 0.0:
            found.append(Number(_scaled(f'kv[{name}]', kv, GAIN_SIGMA[1]),
                                _coefficient(model, i, 2, drive.kind)))
        elif damping > 0.0:  # which the other would be added to
            unit = 'N s/m' if slides else 'N m s/rad'
            found.append(Number(_scaled(f'dof_damping[{name}]', damping, GAIN_SIGMA[1], unit),
                                _writer('dof_damping', dof)))
    return found


def _of_controller(model: Any, letter: str, drive: Drive, at: int) -> Number:
    """Return a gain of the controller that commands an actuator its velocity or torque."""
    name, gain = f'{letter}[{drive.joint}]', float(model.numeric_data[at])
    if gain <= 0.0:
        raise ConfigError(f'numeric {name}: got {gain:g}, expected a gain above zero')
    return Number(_scaled(name, gain, GAIN_SIGMA[letter == 'd']), _writer('numeric_data', at))


def _of_base(model: Any) -> list[Number]:
    """Tilt the base under gravity, about X and Y."""
    down = model.opt.gravity.copy()
    if not np.allclose(down[:2], 0.0) or down[2] >= 0.0:
        return []
    size, tilt = float(np.linalg.norm(down)), np.zeros(2)

    def about(axis: int) -> _Write:
        def write(to: Any, value: float) -> None:
            tilt[axis] = value
            x, y = tilt
            to.opt.gravity[:] = size * np.array([np.sin(y), -np.sin(x), -np.cos(x) * np.cos(y)])
        return write

    # tilt of a base that was levelled by hand, 1 sigma [rad]
    return [Number(Parameter(f'tilt.{a}', 0.0, 0.003, 'rad', -0.5, 0.5, 'robot',
                             ('base_tilt',)), about(k)) for k, a in enumerate('xy')]


def _scaled(name: str, value: float, sigma: float, unit: str = '1') -> Parameter:
    """Return a parameter of a relative ``sigma``, from a twentieth to 20 times its value."""
    return Parameter(name, value, sigma * value, unit, 0.05 * value, 20.0 * value,
                     logarithmic=True)


def _writer(field: str, index: Any, scale: Any = 1.0) -> _Write:
    def write(to: Any, value: float) -> None:
        getattr(to, field)[index] = value * scale
    return write


def _nowhere(to: Any, value: float) -> None:
    """Write nothing: the number acts on commands, and no model holds it."""


def _coefficient(model: Any, i: int, k: int, kind: str) -> _Write:
    """Set kp (1) or kv (2) of an actuator, and its input's gain if that is the same number."""
    scale = 0.0
    if kind == VELOCITY if k == 2 else kind in (POSITION, INTEGRATED):
        scale = float(model.actuator_gainprm[i, 0] / model.actuator_biasprm[i, k])

    def write(to: Any, value: float) -> None:
        to.actuator_biasprm[i, k] = -value
        if scale:
            to.actuator_gainprm[i, 0] = -scale * value
    return write


LIMIT_SIGMA = 0.1
"""Of a drive's limit, 1 sigma, relative: currents and torque constants are known to a tenth."""

ACTUATOR, JOINT, INPUT = 'actuator_forcerange', 'jnt_actfrcrange', 'actuator_ctrlrange'


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
        if one.kind == TORQUE and model.actuator_ctrllimited[one.ctrl]:
            gain = abs(float(model.actuator_gainprm[i, 0]))
            ranges.append((gear * gain, INPUT, one.ctrl, model.actuator_ctrlrange[one.ctrl]))
        known = [(scale * float(np.abs(ends).max()), field, int(row), float(np.abs(ends).max()))
                 for scale, field, row, ends in ranges]
        if known:
            _, field, row, most = min(known)
            found.append(Limit(one.joint, field, row, most))
    return found


def limit_numbers(model: Any, limits: Sequence[Limit]) -> Iterator[Number]:
    """
    List the limits of drives as parameters.

    Yields
    ------
    Number
    """
    for one in limits:
        unit = '1' if one.field == INPUT else 'N' if is_slide(model, one.joint) else 'N m'
        ends = np.array(getattr(model, one.field)[one.row]) / one.most
        yield Number(_scaled(one.name, one.most, LIMIT_SIGMA, unit),
                     _writer(one.field, one.row, ends))


def is_slide(model: Any, joint: str) -> bool:
    """Whether a joint slides, in place of turning."""
    return bool(model.jnt_type[model.joint(joint).id] == mujoco.mjtJoint.mjJNT_SLIDE)


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
        self._places = [(_GIVEN[one.field], int(model.joint(one.joint).dofadr[0])
                         if one.field == JOINT else one.row) for one in limits]
        ends = np.array([getattr(model, one.field)[one.row] for one in limits]).reshape(-1, 2)
        self._low, self._high = ends.T
        self.most = np.zeros(len(limits))
        self.reached = np.zeros(len(limits))

    def look(self, data: Any) -> None:
        """See what the drives give now."""
        now = np.array([getattr(data, field)[row] for field, row in self._places])
        ends = np.where(now < 0.0, self._low, self._high)
        part = np.divide(now, ends, out=np.zeros_like(now), where=ends != 0.0)
        self.most = np.maximum(self.most, part)
        # part of its limit from which a drive is at it: MuJoCo clips, and numbers round
        self.reached += part > 0.999

    def near(self) -> list[Limit]:
        """List the limits that a drive comes to, or would come to if they were a little lower."""
        # part of its limit from which a drive may be at it, were the limit lower by one sigma
        near_limit = 1.0 - LIMIT_SIGMA
        return [one for one, part in zip(self._limits, self.most) if part > near_limit]

    def notes(self, step: float) -> Iterator[str]:
        """Say which drives are at their limit, and for how long; the step in s."""
        for i in map(int, np.argsort(-self.reached, kind='stable')):
            if self.reached[i]:
                one = self._limits[i]
                yield (f'in the model the drive of {one.joint} is at its {one.field} '
                       f'({one.most:g}) for {step * self.reached[i]:.2g} s, and the joint does '
                       'not follow its command')


_GIVEN = {ACTUATOR: 'actuator_force', JOINT: 'qfrc_actuator', INPUT: 'ctrl'}
"""Where the data of a run have what each field limits."""


SOLREF, FRICTION, PLACE = 'geom_solref', 'geom_friction', 'geom_pos'

AXES = 'xyz'


def touchable(model: Any, body: str) -> dict[int, str]:
    """Name the geoms, by their place in the model, that a body or what hangs on it may touch."""
    own, found = own_geoms(model, body), {}
    for i in range(model.ngeom):
        with_any = ((model.geom_contype[i] & model.geom_conaffinity[own])
                    | (model.geom_contype[own] & model.geom_conaffinity[i]))
        if i not in own and with_any.any():
            found[i] = _geom_name(model, i)
    return found


def own_geoms(model: Any, body: str) -> NDArray[np.intp]:
    """List the geoms of a body and of all that hangs on it."""
    tool = int(model.body(body).id)
    return np.array([i for i in range(model.ngeom)
                     if tool in carrying(model, int(model.geom_bodyid[i]))], dtype=np.intp)


def carrying(model: Any, body: int) -> Iterator[int]:
    """Yield a body and those that carry it, the world left out."""
    while body:
        yield body
        body = int(model.body_parentid[body])


def _geom_name(model: Any, i: int) -> str:
    body = int(model.geom_bodyid[i])
    return model.geom(i).name or (f'{model.body(body).name or f"body {body}"}.'
                                  f'{i - int(model.body_geomadr[body])}')


def contact_numbers(model: Any, body: str) -> Iterator[Number]:
    """
    List softness, friction and, where it stands in the world, place of all that a tool may touch.

    Yields
    ------
    Number
    """
    # factor by which either may be off, at most: beyond, another material was meant
    max_contact_factor = 5.0
    own, names = own_geoms(model, body), touchable(model, body)
    # solref sigma and friction sigma: of a contact's time constant and of its friction, 1 sigma,
    # relative: a stiffness, which goes with one over the square of that time, is taken to be
    # known as well as a friction, to a tenth
    for field, part in ((SOLREF, 0.05), (FRICTION, 0.1)):
        shared = _Shared(model, field, own)
        for i, name in names.items():
            value = float(shared.first[i])
            slides = max(model.geom_condim[i], model.geom_condim[own].max()) > 1
            if value == 0.0 or (field == FRICTION and not slides):
                continue
            stiffness = field == SOLREF and value < 0.0
            low, high = sorted((value / max_contact_factor, value * max_contact_factor))
            unit = '1' if field == FRICTION else '1/s^2' if stiffness else 's'
            yield Number(Parameter(
                f'{field}[{name}]', value, (1 + stiffness) * part * abs(value), unit, low, high,
                'environment'), shared.of(i))
    for i, name in names.items():
        if model.body_weldid[model.geom_bodyid[i]] == 0:
            yield from _places(model, i, name)


def _places(model: Any, i: int, name: str) -> Iterator[Number]:
    # of the place of what stands in the world, 1 sigma and at most [m]: as a table is measured.
    # Were it taken to be where the model has it, one that is a millimetre lower would be
    # called softer
    place_sigma, max_place_shift = 0.001, 0.1
    for k, a in enumerate(AXES):
        first = float(model.geom_pos[i, k])
        yield Number(Parameter(
            f'{PLACE}[{name}].{a}', first, place_sigma, 'm', first - max_place_shift,
            first + max_place_shift, 'environment'), _writer(PLACE, (i, k)))


class _Shared:
    """The first number of a field of geoms, which one ratio changes of two that touch."""

    def __init__(self, model: Any, field: str, own: NDArray[np.intp]) -> None:
        self._field, self._own, self._ratio = field, own, dict[int, float]()
        self.first = getattr(model, field)[:, 0].copy()

    def of(self, geom: int) -> _Write:
        """Return what writes that of a geom, and the tool's along."""
        def write(to: Any, value: float) -> None:
            rows = getattr(to, self._field)
            self._ratio[geom] = value / self.first[geom]
            rows[geom, 0] = value
            rows[self._own, 0] = self.first[self._own] * np.prod(list(self._ratio.values()))
        return write


class Touched:
    """Collects what a tool touches while a model is run."""

    def __init__(self, model: Any, body: str) -> None:
        self._model, self._own = model, own_geoms(model, body)
        self._names = touchable(model, body)
        self._faces: dict[int, Array] = {}

    @property
    def parameters(self) -> set[str]:
        """Names of the parameters of what was touched."""
        found = {f'{field}[{self._names[i]}]' for field in (SOLREF, FRICTION) for i in self._faces}
        # part of a contact's normal along an axis, from which a place along that axis counts
        return found | {f'{PLACE}[{self._names[i]}].{a}' for i, faces in self._faces.items()
                        for a, most in zip(AXES, faces) if most > 0.1}

    def look(self, data: Any) -> None:
        """See what touches now, and along which axes of the body that has it."""
        for k in range(data.ncon):
            pair, normal = data.contact.geom[k], data.contact.frame[k, :3]
            for i in {int(one) for one in pair} & self._names.keys():
                if data.contact.exclude[k] == 0 and np.isin(pair, self._own).any():
                    body = data.xmat[self._model.geom_bodyid[i]].reshape(3, 3)
                    self._faces[i] = np.maximum(self._faces.get(i, np.zeros(3)),
                                                np.abs(normal @ body))
