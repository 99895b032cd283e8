"""The arm in Drake as a generator of the second edition: a robot in another physics engine."""

from collections.abc import Callable
import logging
from typing import Any

from blind.robot import Array
from blind.seal import SealError
from blind.second.arm import gravity, JOINTS, Numbers, PERIOD, Ran, SETTLING, source
from blind.second.on_arm import OnArm
import numpy as np

STEP = 0.00025
"""Of Drake's solver, which is implicit in drives and friction [s]."""
STUCK = 0.001
"""Below which a joint's dry friction is viscous [rad/s]."""


class OnDrake(OnArm):
    """
    One case of the arm, whose truth runs in Drake.

    The tool gets the nominal model in MuJoCo. Energies and nuisances are by that model, too; what
    differs between both engines without any effect is the model's own.
    """

    name = 'drake'

    def _truth(self, n: Numbers) -> Ran:
        return ran_in_drake(n, self._told)


def ran_in_drake(n: Numbers, told: Array, step: float = STEP) -> Ran:
    """
    Move the arm as :func:`blind.second.arm.ran` does, in Drake.

    Drake reads links, masses and armatures of the MJCF. Drives are its implicit PD controllers,
    which brake against the base, as MuJoCo's do. It has no dry friction in joints: a friction f
    is its implicit viscous friction, in each step of f / max(abs(v), :data:`STUCK`) by the speed
    v at its begin. That is Coulomb's where a joint turns; at rest the joint creeps to where its
    drive holds it, as in MuJoCo. The wrench is Newton's and Euler's of the gripper on
    the motion's accelerations (central differences of speeds, as in MuJoCo).
    """
    plant, simulator = _built(n, step)
    context, each = simulator.get_mutable_context(), round(PERIOD / step)
    begin = round(SETTLING / step)
    joints = [plant.GetJointByName(name) for name in JOINTS]
    target, pull = plant.GetInputPort('arm_desired_state'), _pulled(n, plant, context)
    # what an implicit drive is told is of the end of a step
    at = np.arange(1 - begin, len(told) * each + 1) / each
    fine = np.stack([np.interp(at, np.arange(len(told)), q) for q in told.T], axis=1)
    q, v = np.empty_like(fine), np.empty_like(fine)
    plant.SetPositions(context, told[0])
    for k, now in enumerate(fine):
        q[k], v[k] = plant.GetPositions(context), plant.GetVelocities(context)
        for joint, friction, speed in zip(joints, n.friction, v[k]):
            joint.SetDamping(context, friction / max(abs(speed), STUCK))
        target.FixValue(context, [*now, *np.zeros(6)])
        pull()
        simulator.AdvanceTo((k + 0.5) * step)
    return _felt(n, plant, context, *(x[begin::each] for x in (q, v, np.gradient(
        v, step, axis=0))))


def _built(n: Numbers, step: float) -> tuple[Any, Any]:
    try:
        from pydrake.all import MultibodyPlant, Parser, PdControllerGains, Simulator
    except ModuleNotFoundError:
        raise SealError('the cases of drake want pydrake: pip install drake') from None

    logging.getLogger('drake').setLevel(logging.ERROR)  # it warns of each word it does not read
    plant = MultibodyPlant(step)
    Parser(plant).AddModelsFromString(
        source(n, step, 'Euler').replace('<mujoco>', '<mujoco model="arm">'), 'xml')
    plant.mutable_gravity_field().set_gravity_vector(gravity(n))
    for i, (p, d) in enumerate(zip(n.kp, n.kv)):
        plant.GetJointActuatorByName(f'motor{i}').set_controller_gains(PdControllerGains(p=p, d=d))
    plant.Finalize()
    return plant, Simulator(plant)


def _pulled(n: Numbers, plant: Any, context: Any) -> Callable[[], None]:
    """Return what pulls the gripper to the hook from where it is, for one step."""
    from pydrake.all import ExternallyAppliedSpatialForce, SpatialForce

    if not n.pull:
        return lambda: None
    gripper, port = plant.GetBodyByName('gripper'), plant.GetInputPort('applied_spatial_force')

    def pull() -> None:
        one = ExternallyAppliedSpatialForce()
        one.body_index = gripper.index()
        place = gripper.EvalPoseInWorld(context).translation()
        one.F_Bq_W = SpatialForce(np.zeros(3), n.pull * (np.array(n.hook) - place))
        port.FixValue(context, [one])

    return pull


def _felt(n: Numbers, plant: Any, context: Any, q: Array, v: Array, a: Array) -> Ran:
    """Return what the sensor feels and where it is, row by row."""
    gripper = plant.GetBodyByName('gripper')
    M = gripper.CalcSpatialInertiaInBodyFrame(context).CopyToFullMatrix6()
    out = Ran(q, *(np.empty((len(q), *one)) for one in ((6,), (3,), (3, 3))))
    for i in range(len(q)):
        plant.SetPositions(context, q[i])
        plant.SetVelocities(context, v[i])
        pose = gripper.EvalPoseInWorld(context)
        R = pose.rotation().matrix()
        felt = plant.CalcSpatialAccelerationsFromVdot(context, a[i])[int(gripper.index())]
        alpha, specific = R.T @ felt.rotational(), R.T @ (felt.translational() - gravity(n))
        omega = R.T @ gripper.EvalSpatialVelocityInWorld(context).rotational()
        pulls = n.pull * R.T @ (np.array(n.hook) - pose.translation())
        turns, forces = np.split(M @ [*alpha, *specific], 2)
        turns += np.cross(omega, M[:3, :3] @ omega)
        forces += n.mass * np.cross(omega, np.cross(omega, n.com)) - pulls
        out.wrench[i], out.position[i], out.R[i] = [*-forces, *-turns], pose.translation(), R
    return out
