"""The arm of mujoco_arm as a robot in another physics engine: Drake, an extra of setup.py."""

import logging

from forcecal_ros.core.streams import JointStream, PoseStream, Recording, Stream
from mujoco_arm import Arm, forward, gravity_of, JOINTS, LINKS, mjcf_of, model_of, PERIOD
import numpy as np
from pydrake.all import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    Parser,
    PdControllerGains,
    Simulator,
    SpatialForce,
)

STEP_S, REST_S = 0.001, 2.0

DAMPING = 1.0
"""Viscous friction of each joint [N m s/rad], which the simulation does not have."""


def run_in_drake(arm: Arm, joints: np.ndarray, every: float = 0.004) -> Recording:
    """
    Move an arm; parameters and result are those of mujoco_arm.run.

    Dry friction, play and tables are left out.
    """
    plant = MultibodyPlant(STEP_S)
    logging.getLogger('drake').setLevel(logging.ERROR)  # Drake knows no sites and no sensors
    Parser(plant).AddModelsFromString(
        mjcf_of(arm).replace('<mujoco>', '<mujoco model="arm">'), 'xml')
    plant.mutable_gravity_field().set_gravity_vector(gravity_of(arm))
    for i, (*_, kp, kv) in enumerate(LINKS):
        plant.GetJointByName(f'joint{i}').set_default_damping_vector([DAMPING])
        plant.GetJointActuatorByName(f'motor{i}').set_controller_gains(
            PdControllerGains(p=kp * arm.kp[i], d=kv * arm.kv[i]))  # Drake reads no kv
    plant.Finalize()
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    gripper = plant.GetBodyByName('gripper')
    weld = int(plant.GetJointByName('link5_welds_to_gripper').index())
    reaction, felt = (plant.GetOutputPort(name) for name in (
        'reaction_forces', 'body_spatial_accelerations'))
    pulled, target = (plant.GetInputPort(name) for name in (
        'applied_spatial_force', 'arm_desired_state'))
    at = np.arange(len(joints))
    plant.SetPositions(context, joints[0])
    steps, rest = round(every / STEP_S), round(REST_S / STEP_S)
    n = round(len(joints) * PERIOD / STEP_S)
    rows, places, frames, accelerations = [], [], [], []
    for k in range(-rest, n):
        now = max(k, 0) * STEP_S / PERIOD
        # kv brakes the joints against the base, as in MuJoCo
        target.FixValue(context, [*(np.interp(now, at, x) for x in joints.T), *np.zeros(6)])
        X = gripper.EvalPoseInWorld(context)
        if arm.pull is not None:
            force = ExternallyAppliedSpatialForce()
            force.body_index, force.p_BoBq_B = gripper.index(), np.zeros(3)
            force.F_Bq_W = SpatialForce(np.zeros(3), arm.pull(X.translation()))
            pulled.FixValue(context, [force])
        if k >= 0 and k % steps == 0:
            frames.append(X)
            places.append(plant.GetPositions(context))
        simulator.AdvanceTo((k + rest + 0.5) * STEP_S)
        if k >= 0 and k % steps == 0:
            force = reaction.Eval(context)[weld]
            rows.append(-np.concatenate([force.translational(), force.rotational()]))
            accelerations.append(felt.Eval(context)[int(gripper.index())].translational())
    t = every * np.arange(len(rows))
    R = np.array([X.rotation().matrix() for X in frames])
    specific = np.einsum('nji,nj->ni', R, np.array(accelerations) - gravity_of(arm))
    told = PERIOD * np.arange(len(joints))
    return Recording(
        wrench=Stream(t, np.array(rows), 'ft_sensor'),
        pose=PoseStream(t, np.array([X.translation() for X in frames]), R),
        target=PoseStream(told, *forward(model_of(arm), joints)),
        accelerometer=Stream(t, specific, 'ft_sensor') if arm.imu else None,
        accelerometer_unit='m/s^2',
        joints=JointStream(t, np.array(places), '', JOINTS),
        joint_commands=JointStream(told, joints, '', JOINTS))
