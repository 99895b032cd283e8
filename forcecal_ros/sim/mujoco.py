"""
Models in MuJoCo loaded: their force sensor, tool and base found, sensors added, numbers listed.

A force sensor measures all that is below the body of its site, so the tool has to be a body of
its own.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.extras import installing
from forcecal_ros.core.geometry import Array
from forcecal_ros.sim.mujoco_contacts import contact_numbers
from forcecal_ros.sim.mujoco_drives import (
    Drive,
    found_drives,
    is_scalar,
    of_same_tree,
)
from forcecal_ros.sim.mujoco_limits import limit_numbers, limits_of
from forcecal_ros.sim.mujoco_numbers import Number, numbers_of
from forcecal_ros.sim.mujoco_robot import MujocoRobot, OWN
import numpy as np

OVER_READS = 1.05
"""
Factor by which implicit integrators make MuJoCo's force sensor over-read, from which that is told:
0.05 of a tool's inertial force is the noise of a good sensor at 10 m/s^2 and 0.5 kg.
"""


def load_mujoco(path: str, ft_site: str | None = None, imu: str | None = None) -> MujocoRobot:
    """
    Load a model.

    Parameters
    ----------
    path : str
        MJCF.
    ft_site : str, optional
        Where its force sensor sits; that of its only force sensor where none is named.
    imu : str, optional
        Site of an accelerometer, which rides on the tool; none is compared where none is named.

    Raises
    ------
    ConfigError
        MuJoCo is not installed, the model cannot be read, or has no such sites; the force sensor
        is on a link and not on a tool of its own, or the accelerometer on another body.
    """
    try:
        import mujoco
    except ImportError:
        raise ConfigError(f'--mujoco wants MuJoCo: {installing("mujoco")}') from None
    mujoco.set_mju_user_warning(_ignore)
    if not Path(path).is_file():
        raise ConfigError(f'--mujoco {path}: no such file; name the model, an MJCF')
    try:
        spec = mujoco.MjSpec.from_file(path)
        site = _site(mujoco, spec, path, ft_site)
        body = spec.site(site).parent
        _refuse_link(body, path, site)
        base = _base_of(body, path, site)
        body.name, base.name = body.name or 'tool', base.name or 'base'
        _add_sensors(mujoco, spec, site, base.name)
        if imu:
            _add_accelerometer(mujoco, spec, path, body, imu)
        model = spec.compile()
    except ValueError as error:
        raise ConfigError(f'--mujoco {path}: MuJoCo says {" ".join(str(error).split())}') from None
    drives = found_drives(mujoco, model, path)
    own = of_same_tree(model, drives, body.name)
    limits = limits_of(model, own)
    numbers = (*numbers_of(mujoco, model, own, body.name, site),
               *(Number(*one) for one in (*limit_numbers(model, limits),
                                          *contact_numbers(model, body.name))))
    turned = _axes(mujoco, model, site).T @ _axes(mujoco, model, imu) if imu else None
    return MujocoRobot(path, model, body.name, tuple(drives), _chain(mujoco, model, body.name),
                       turned, numbers, tuple(_over_reading(mujoco, model, own)), tuple(limits))


def _ignore(_: str) -> None:
    """Keep warnings out of MUJOCO_LOG.TXT in the user's folder; the data of a run count them."""


def _chain(mujoco: Any, model: Any, body: str) -> tuple[str, ...]:
    """Name the joints that move a body, or what hangs on it, of one number each."""
    def above(i: int) -> set[int]:
        return {0} if i == 0 else {i} | above(int(model.body_parentid[i]))

    tool = int(model.body(body).id)
    carrying = above(tool)
    return tuple(model.joint(k).name for k in range(model.njnt) if is_scalar(mujoco, model, k)
                 and ((i := int(model.jnt_bodyid[k])) in carrying or tool in above(i)))


def _site(mujoco: Any, spec: Any, path: str, given: str | None) -> str:
    if given:
        _refuse_no_site(spec, path, '--ft-site', given)
        return given
    names = [site.name for site in spec.sites]
    found = {one.objname for one in spec.sensors if one.type == mujoco.mjtSensor.mjSENS_FORCE}
    if len(found) != 1:
        raise ConfigError(f'--mujoco {path}: {len(found)} sites have a force sensor; ' + (
            f'say which with --ft-site, one of {", ".join(filter(None, names))}'
            if any(names) else "add a site with a name to the tool's body"))
    return str(found.pop())


def _refuse_no_site(spec: Any, path: str, option: str, name: str) -> None:
    names = [site.name for site in spec.sites]
    if name not in names:
        raise ConfigError(f'{option} {name}: {path} has no such site; it has '
                          f'{", ".join(filter(None, names)) or "none"}')


def _refuse_link(body: Any, path: str, site: str) -> None:
    """Refuse a sensor that weighs a link of the arm, too."""
    if list(body.joints):
        raise ConfigError(
            f'--mujoco {path}: site {site} is on {body.name}, which joint {body.joints[0].name} '
            "moves: MuJoCo's force sensor would weigh that link, too; make the tool a body of "
            'its own, welded to the link, with the site on it')


def _base_of(body: Any, path: str, site: str) -> Any:
    """Return the body that the arm stands on: the parent of the first that a joint moves."""
    chain = [body]
    while chain[-1].name != 'world':
        chain.append(chain[-1].parent)
    moved = [one for one in chain if list(one.joints)]
    if not moved:
        raise ConfigError(f'--mujoco {path}: site {site} is on {body.name or "a body"}, which no '
                          'joint moves; name one on the tool with --ft-site')
    return moved[-1].parent


def _add_sensors(mujoco: Any, spec: Any, site: str, base: str) -> None:
    kinds, types = mujoco.mjtSensor, mujoco.mjtObj
    for name, kind in (('force', kinds.mjSENS_FORCE), ('torque', kinds.mjSENS_TORQUE)):
        spec.add_sensor(name=OWN + name, type=kind, objtype=types.mjOBJ_SITE, objname=site)
    for name, kind in (('position', kinds.mjSENS_FRAMEPOS),
                       ('quaternion', kinds.mjSENS_FRAMEQUAT)):
        spec.add_sensor(name=OWN + name, type=kind, objtype=types.mjOBJ_SITE, objname=site,
                        reftype=types.mjOBJ_XBODY, refname=base)


def _add_accelerometer(mujoco: Any, spec: Any, path: str, tool: Any, imu: str) -> None:
    _refuse_no_site(spec, path, '--imu', imu)
    body = spec.site(imu).parent
    if body.name != tool.name:
        raise ConfigError(f'--imu {imu}: the site is on body {body.name or "(no name)"}, expected '
                          f'one on {tool.name}, the tool, whose motion it has to measure')
    spec.add_sensor(name=OWN + 'accelerometer', type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
                    objtype=mujoco.mjtObj.mjOBJ_SITE, objname=imu)


def _axes(mujoco: Any, model: Any, site: str) -> Array:
    """Return the axes of a site in its body."""
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.site_quat[model.site(site).id])
    return axes.reshape(3, 3)


def _over_reading(mujoco: Any, model: Any, drives: Sequence[Drive]) -> list[str]:
    """Say by how much the sensor over-reads inertia with an implicit integrator."""
    kinds = mujoco.mjtIntegrator
    if int(model.opt.integrator) not in (int(kinds.mjINT_IMPLICIT), int(kinds.mjINT_IMPLICITFAST)):
        return []
    factor = 1.0 + model.opt.timestep * max(float(
        model.dof_damping[one.dof] - model.actuator_gear[one.actuator, 0] ** 2
        * model.actuator_biasprm[one.actuator, 2]) / model.dof_M0[one.dof] for one in drives)
    note = (f'its integrator lets the force sensor over-read accelerations, up to {factor:.2f} '
            'times; Euler does not')
    return [note] if factor >= OVER_READS else []
