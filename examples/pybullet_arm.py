"""
An arm in PyBullet (pip install pybullet), whose payload and drives a diagnosis may change.

forcecal diagnose BAG --simulator pybullet_arm:make -o why
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from forcecal_ros.sim.protocol import Inputs, Parameter
import numpy as np
import pybullet as pb
from scipy.interpolate import CubicSpline

MODEL = str(Path(__file__).with_suffix('.urdf'))
STEP_S, REST_S = 0.004, 1.0  # a sample each step; the robot rests when the recording begins
GAIN, FORCE_NM = 0.1, 1000.0
"""Share of an error of position that a drive removes in a step, and its largest torque."""


class PyBulletArm:
    """The two methods of forcecal_ros.sim.protocol.Simulator."""

    def parameters(self) -> list[Parameter]:
        """Return what may differ from the robot: value, 1 sigma, unit, limits."""
        return [Parameter('payload', 1.2, 0.012, 'kg', 0.1, 5.0, 'tool', ('tool_mass',)),
                Parameter('gain', 1.0, 0.05, '1', 0.1, 4.0)]

    def simulate(self, inputs: Inputs, parameters: Mapping[str, float]) -> dict[str, Any]:
        """Run the recorded commands; return stamps and rows of each stream."""
        world = pb.connect(pb.DIRECT)
        pb.setGravity(0, 0, -9.80665)
        pb.setPhysicsEngineParameter(fixedTimeStep=STEP_S)
        arm = pb.loadURDF(MODEL, useFixedBase=True, flags=pb.URDF_USE_INERTIA_FROM_FILE)
        index = {pb.getJointInfo(arm, i)[1].decode(): i for i in range(pb.getNumJoints(arm))}
        sensor, drives = index.pop('ft'), [index[name] for name in inputs.joints.names]
        pb.changeDynamics(arm, sensor, mass=parameters['payload'])
        com = pb.getDynamicsInfo(arm, sensor)[3]
        pb.enableJointForceTorqueSensor(arm, sensor)
        for drive, q in zip(drives, inputs.joints.values[0]):
            pb.resetJointState(arm, drive, q)
        times, wrench, pose = np.arange(inputs.start, inputs.end, STEP_S), [], []
        rest = np.full(int(REST_S / STEP_S), inputs.start)
        commands = CubicSpline(inputs.joints.t, inputs.joints.values)(np.append(rest, times))
        for command in commands:
            pb.setJointMotorControlArray(
                arm, drives, pb.POSITION_CONTROL, command, forces=len(drives) * [FORCE_NM],
                positionGains=len(drives) * [GAIN * parameters['gain']])
            reaction = np.negative(pb.getJointState(arm, sensor)[2])  # about the centre of mass
            wrench.append([*reaction[:3], *reaction[3:] + np.cross(com, reaction[:3])])
            place, turn = pb.getLinkState(arm, sensor, computeForwardKinematics=True)[4:6]
            pose.append([*place, *turn])
            pb.stepSimulation()
        pb.disconnect(world)
        n = len(times)
        return {'wrench': (times, np.array(wrench[-n:])), 'pose': (times, np.array(pose[-n:]))}


make = PyBulletArm
