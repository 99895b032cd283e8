"""A recording to try docs/how-to/own-simulator.md on: its robot with a payload of 1.26 kg."""

from dataclasses import replace

from forcecal_ros.core.streams import PoseStream
from forcecal_ros.io.bags import write_recording
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.third_party import load_simulator
import numpy as np
from scipy.spatial.transform import Rotation

t = 0.004 * np.arange(2001)
noise = np.random.default_rng(0).normal(size=(4, 4000, 3))
u = np.clip(t - 1.0, 0.0, 6.0)  # a second of rest at both ends
swing = np.sin(np.pi * u / 6.0)[:, None] ** 4 * np.sin(np.outer(u, [2.1, 1.7, 2.9]))
target = PoseStream(t, 0.03 * swing, Rotation.from_rotvec(0.7 * swing).as_matrix())
real = load_simulator('my_robot:make').run(Inputs(0.0, 8.0, target), [1.26, 0.072])
wrench = real.wrench.values + np.hstack([0.15 * noise[0], 0.006 * noise[1]])
turn = Rotation.from_rotvec(2e-4 * noise[3]).as_matrix()
write_recording('real', replace(
    real, start_ns=10**18, wrench=replace(real.wrench, values=wrench),
    pose=replace(real.pose, position=real.pose.position + 1e-4 * noise[2],
                 R_base_sensor=real.pose.R_base_sensor @ turn)))
