"""
An arm in Drake (pip install drake), whose payload and drives a diagnosis may change.

forcecal diagnose BAG --simulator drake_arm:make -o why
"""

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from forcecal_ros.sim.protocol import Inputs, Parameter
import numpy as np
from pydrake.all import MultibodyPlant, Parser, PdControllerGains, Simulator
from scipy.interpolate import CubicSpline

MODEL = files('forcecal_ros') / 'config' / 'examples' / 'rigid_arm.xml'
STEP_S, SAMPLE_S, REST_S = 0.002, 0.004, 1.0  # the robot rests when the recording begins
DAMPING_S = 0.03  # of a drive, in its stiffness: Drake does not read kv


class DrakeArm:
    """The two methods of forcecal_ros.sim.protocol.Simulator."""

    def parameters(self) -> list[Parameter]:
        """Return what may differ from the robot: value, 1 sigma, unit, limits."""
        return [Parameter('payload', 1.2, 0.012, 'kg', 0.1, 5.0, 'tool', ('tool_mass',)),
                Parameter('stiffness', 1.0, 0.05, '1', 0.1, 10.0)]

    def simulate(self, inputs: Inputs, parameters: Mapping[str, float]) -> dict[str, Any]:
        """Run the recorded commands; return stamps and rows of each stream."""
        plant = MultibodyPlant(STEP_S)
        instance, = Parser(plant).AddModels(str(MODEL))
        drives = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]
        names = [drive.joint().name() for drive in drives]
        for drive in drives:
            stiffness = drive.get_controller_gains().p
            drive.set_controller_gains(PdControllerGains(
                p=parameters['stiffness'] * stiffness, d=DAMPING_S * stiffness))
        plant.Finalize()
        simulator = Simulator(plant)
        context = simulator.get_mutable_context()
        gripper = plant.GetBodyByName('gripper')
        gripper.SetMass(context, parameters['payload'])
        weld = int(plant.GetJointByName('wrist_3_welds_to_gripper').index())
        target = plant.get_desired_state_input_port(instance)
        order = [inputs.joints.names.index(name) for name in names]
        commands = CubicSpline(inputs.joints.t, inputs.joints.values[:, order])
        plant.SetPositions(context, commands(inputs.start))
        times, wrench, pose = np.arange(inputs.start, inputs.end, SAMPLE_S), [], []
        for t in times:
            target.FixValue(context, [*commands(t), *commands(t, 1)])
            simulator.AdvanceTo(REST_S + t - inputs.start + STEP_S / 2)  # always two steps
            force = plant.get_reaction_forces_output_port().Eval(context)[weld]
            X = gripper.EvalPoseInWorld(context)
            wrench.append([*-force.translational(), *-force.rotational()])
            pose.append([*X.translation(), *np.roll(X.rotation().ToQuaternion().wxyz(), -1)])
        return {'wrench': (times, np.array(wrench)), 'pose': (times, np.array(pose))}


make = DrakeArm
