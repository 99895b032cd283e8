"""The numbers of a MuJoCo model that may be off: what they are, and how they are written."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.sim.mujoco_drives import Drive, TORQUE, VELOCITY
from forcecal_ros.sim.protocol import Parameter
import numpy as np

WEIGHED, PLACED = 0.01, 0.001
"""How well a tool is known by its drawing: mass (relative) and centre of mass [m], 1 sigma."""

RUBBED = (0.1, 0.1)
"""Of dry friction, 1 sigma: part of the model's, and beside it [N m] or [N]: what warmth makes."""

DRIVEN = (0.05, 0.1)
"""Of the gains kp and kv of a position actuator, 1 sigma, relative: as controllers are told."""

LEVELLED = 0.003
"""Tilt of a base that was levelled by hand, 1 sigma [rad]."""

_Write = Callable[[Any, float], None]
_Both = tuple[_Write, _Write]
"""Into a model that was compiled, and into its source."""


class Number(NamedTuple):
    """A parameter, and how it is written."""

    parameter: Parameter
    write: _Write
    patch: _Write


def numbers_of(mujoco: Any, model: Any, drives: Sequence[Drive], body: str, site: str
               ) -> tuple[Number, ...]:
    """
    List what may be off: of the tool, the body that has the site, of the joints and of the base.

    Raises
    ------
    ConfigError
        The tool weighs nothing, or a controller's gain is not above zero.
    """
    return (*_of_tool(model, body, site), *_of_joints(mujoco, model, drives), *_of_base(model))


def _of_tool(model: Any, body: str, site: str) -> list[Number]:
    i = model.body(body).id
    mass, com = float(model.body_mass[i]), model.body_ipos[i].copy()
    if mass <= 0.0:
        raise ConfigError(f'body {body} below site {site} weighs nothing; give the tool its mass')
    inertia, axes = model.body_inertia[i].copy(), model.body_iquat[i].copy()

    def weigh(to: Any, value: float) -> None:
        to.body_mass[i] = value
        to.body_inertia[i] = inertia * (value / mass)

    def explicit(spec: Any) -> Any:
        """Return the body with the numbers it has, be they given or those of its geoms."""
        found = spec.site(site).parent
        if not found.explicitinertial or found.inertia[0] <= 0.0:
            found.explicitinertial, found.mass = True, mass
            found.ipos, found.iquat, found.inertia = com, axes, inertia
            found.fullinertia[0] = np.nan
        return found

    def patch_mass(spec: Any, value: float) -> None:
        to = explicit(spec)
        to.mass, to.inertia = value, to.inertia * (value / mass)

    def place(axis: int) -> _Both:
        def write(to: Any, value: float) -> None:
            to.body_ipos[i, axis] = value

        def patch(spec: Any, value: float) -> None:
            explicit(spec).ipos[axis] = value
        return write, patch

    found = [Number(Parameter(f'body_mass[{body}]', mass, WEIGHED * mass, 'kg', 0.05 * mass,
                               20.0 * mass, 'tool', ('tool_mass',)), weigh, patch_mass)]
    return found + [Number(Parameter(
        f'body_ipos[{body}].{a}', float(com[k]), PLACED, 'm', com[k] - 0.5, com[k] + 0.5, 'tool',
        ('tool_com',)), *place(k)) for k, a in enumerate('xyz')]


def _of_joints(mujoco: Any, model: Any, drives: Sequence[Drive]) -> list[Number]:
    found = []
    for drive in drives:
        i, name, dof = drive.actuator, drive.joint, drive.dof
        slides = model.jnt_type[model.joint(name).id] == mujoco.mjtJoint.mjJNT_SLIDE
        friction = float(model.dof_frictionloss[dof])
        damping, kv = float(model.dof_damping[dof]), -float(model.actuator_biasprm[i, 2])
        found.append(Number(Parameter(f'dof_frictionloss[{name}]', friction,
                                       RUBBED[0] * friction + RUBBED[1], 'N' if slides else 'N m',
                                       0.0),
                             _writer('dof_frictionloss', dof), _rubbing(name)))
        if drive.kind in (VELOCITY, TORQUE):
            found += [_of_controller(model, letter, drive, at)
                      for letter, at in zip('pd', drive.gains)]
        else:
            kp = -float(model.actuator_biasprm[i, 1])
            found.append(Number(Parameter(f'kp[{name}]', kp, DRIVEN[0] * kp, '1', 0.05 * kp,
                                           20.0 * kp), *_gain(model, i)))
        if kv > 0.0:
            found.append(Number(Parameter(f'kv[{name}]', kv, DRIVEN[1] * kv, '1', 0.0,
                                           20.0 * kv), *_drag(model, i, drive.kind)))
        elif damping > 0.0:  # which the other would be added to
            found.append(Number(Parameter(
                f'dof_damping[{name}]', damping, DRIVEN[1] * damping,
                'N s/m' if slides else 'N m s/rad', 0.0, 20.0 * damping),
                _writer('dof_damping', dof), _damping(name)))
    return found


def _of_controller(model: Any, letter: str, drive: Drive, at: int) -> Number:
    """Return a gain of the controller that tells an actuator its velocity or torque."""
    name, gain = f'{letter}[{drive.joint}]', float(model.numeric_data[at])
    if gain <= 0.0:
        raise ConfigError(f'numeric {name}: got {gain:g}, expected a gain above zero')

    def patch(spec: Any, value: float) -> None:
        spec.numeric(name).data = [value]

    return Number(Parameter(name, gain, DRIVEN[letter == 'd'] * gain, '1', 0.05 * gain,
                             20.0 * gain), _writer('numeric_data', at), patch)


def _of_base(model: Any) -> list[Number]:
    """Tilt the base under gravity, about X and Y."""
    down = model.opt.gravity.copy()
    tilt = np.zeros(2)

    def turn(option: Any, axis: int, value: float) -> None:
        tilt[axis] = value
        x, y = tilt
        size = float(np.linalg.norm(down))
        option.gravity[:] = size * np.array([np.sin(y), -np.sin(x), -np.cos(x) * np.cos(y)])

    def write(axis: int) -> _Both:
        return (lambda model, value: turn(model.opt, axis, value),
                lambda spec, value: turn(spec.option, axis, value))

    if not np.allclose(down[:2], 0.0) or down[2] >= 0.0:
        return []
    return [Number(Parameter(f'tilt.{a}', 0.0, LEVELLED, 'rad', -0.5, 0.5, 'robot',
                              ('base_tilt',)), *write(k)) for k, a in enumerate('xy')]


def _writer(field: str, index: Any, sign: float = 1.0) -> _Write:
    def write(to: Any, value: float) -> None:
        getattr(to, field)[index] = sign * value
    return write


def _rubbing(joint: str) -> _Write:
    def patch(spec: Any, value: float) -> None:
        spec.joint(joint).frictionloss = value
    return patch


def _damping(joint: str) -> _Write:
    def patch(spec: Any, value: float) -> None:
        powers = np.atleast_1d(np.array(spec.joint(joint).damping, dtype=float))
        powers[0] = value  # newer MuJoCo has terms of higher powers of the speed behind it
        spec.joint(joint).damping = powers if len(powers) > 1 else value
    return patch


def _gain(model: Any, i: int) -> _Both:
    scale = float(model.actuator_gainprm[i, 0] / model.actuator_biasprm[i, 1])

    def write(to: Any, value: float) -> None:
        to.actuator_gainprm[i, 0] = -scale * value
        to.actuator_biasprm[i, 1] = -value

    def patch(spec: Any, value: float) -> None:
        spec.actuators[i].gainprm[0] = -scale * value
        spec.actuators[i].biasprm[1] = -value
    return write, patch


def _drag(model: Any, i: int, kind: str) -> _Both:
    scale = float(model.actuator_gainprm[i, 0] / model.actuator_biasprm[i, 2])

    def write(to: Any, value: float) -> None:
        to.actuator_biasprm[i, 2] = -value
        if kind == VELOCITY:
            to.actuator_gainprm[i, 0] = -scale * value

    def patch(spec: Any, value: float) -> None:
        spec.actuators[i].biasprm[2] = -value
        if kind == VELOCITY:
            spec.actuators[i].gainprm[0] = -scale * value
    return write, patch
