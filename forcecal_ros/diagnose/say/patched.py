"""Rig and calibration with what was found."""

from dataclasses import replace

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.diagnose.judge.named_effects import Checks, parameters_of
from forcecal_ros.diagnose.model.gates import BIAS
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.selection import Selection
from forcecal_ros.effects import named_effects, physical_rig, with_effects
from forcecal_ros.effects.nuisances import apply_all
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rigid_tool import RigidTool
import numpy as np


def patched_calibration(calibration: Calibration, rigid_tool: RigidTool, delay_std: float | None,
                        inertia_std: tuple[float, float, float] | None = None) -> Calibration:
    """
    Give a calibration what was found: biases, mass, centre of mass, inertia, delay.

    Parameters
    ----------
    rigid_tool : RigidTool
        With what was recalibrated, and the effects.
    delay_std : float or None
        Standard error of the delay between the sensors [s]; None where nothing told it.
    inertia_std : tuple of 3 float or None
        The same of the inertia about each axis [kg m^2].
    """
    c, a, found = calibration, calibration.accelerometer, physical_rig(rigid_tool)
    named = named_effects(rigid_tool.effects)
    if a is not None:
        behind = (rigid_tool.accel_behind + named.get('accel_delay', {}).get('delay', 0.0)
                  - named.get('wrench_delay', {}).get('delay', 0.0))
        bias = named.get('accel_bias', {})
        off = np.array(rigid_tool.accelerometer.model().offset) + [bias.get(x, 0.0) for x in 'xyz']
        std = a.delay.std if delay_std is None else delay_std
        a = replace(a, delay=Estimate(behind if delay_std is not None else float(a.delay), std,
                                      's'),
                    offset=Estimate(a.offset.value + a.matrix @ off, a.offset.std,
                                    a.offset.unit))
    inertia = c.inertia
    if inertia_std is not None:
        std = np.array(inertia_std)
        inertia = Estimate(found.tool.inertia, np.sqrt(np.outer(std, std)), 'kg m^2')
    return replace(
        c, inertia=inertia, mass=Estimate(found.tool.mass, c.mass.std, 'kg'),
        com=Estimate(found.tool.com, c.com.std, 'm'), accelerometer=a,
        wrench_bias=Estimate(rigid_tool.wrench_sensor.bias, c.wrench_bias.std, c.wrench_bias.unit))


def _stays(model: LinearisedModel, name: str) -> bool:
    """Say whether a rig still has an effect when the recordings end, and can be given it."""
    gate = model.gates.get(name)
    return name != BIAS.name and (gate is None or gate.end is None)


def patched_rig(model: LinearisedModel, selection: Selection, checks: Checks) -> Rig:
    """
    Recalibrate the rig and give it the effects, those that share a nuisance by their own name.

    Parameters
    ----------
    model : LinearisedModel
        At the joint fit.
    """
    # a simulator's own number stays one of the rig, however far it moved
    own = {n.key for n in model.nuisances if n.prior_std is not None}
    values = {n.name: float(c * s) for n, c,
              s in zip(model.nuisances, model.centre,
                       model.prior_std) if n.name not in model.released or n.key in own}
    effects = {a.name: {k: v.value for k, v in parameters_of(model, a).items()}
               for a in selection.accepted
               if model.library[a.name].nuisance not in own and _stays(model, a.name)}
    effects.update({n: {k: v.value for k, v in found.items()}
                    for n, found in checks.effects.items()})
    return with_effects(apply_all(model.rig, model.nuisances, values), effects)
