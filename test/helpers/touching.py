"""A rig whose gripper presses on a wall and slides along it, and its simulation."""

from dataclasses import replace

from forcecal_ros.core.streams import PoseStream
from forcecal_ros.effects import with_effects
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from own_arm import commands, LATE, RIG

WALL, RUBS = {'position': 1.28, 'stiffness': 1e4, 'damping': 50.0}, 0.3
TIP = np.array(RIG.tool.tip)
PRESS_S, FREE_S = 12.0, 16.0


def rising(t, begin, end):
    x = np.clip((t - begin) / (end - begin), 0.0, 1.0)
    return x ** 3 * (10.0 - 15.0 * x + 6.0 * x ** 2)


def pressing(slide=0.02):
    """Return commands that turn the gripper freely, press 2.5 +- 1.3 mm deep, and slide."""
    free, t = commands(seconds=FREE_S), 0.004 * np.arange(round(PRESS_S / 0.004))
    x = np.zeros((len(t), 3))
    x[:, 0] = (rising(t, 0.5, 3.0) - rising(t, PRESS_S - 3.0, PRESS_S - 0.5)) * (
        0.0825 + 1e-3 * np.sin(1.4 * np.pi * t) + 3e-4 * np.sin(4.2 * np.pi * t))
    on = rising(t, 3.0, 3.6) - rising(t, PRESS_S - 3.6, PRESS_S - 3.0)
    x[:, 1], x[:, 2] = (part * slide * on * np.sin(way * np.pi * t)
                        for part, way in ((1.0, 0.8), (0.5, 0.54)))
    home = np.array(RIG.home.R_base_sensor)
    return PoseStream(np.concatenate([free.t, free.t[-1] + 0.004 + t]),
                      np.vstack([free.position, RIG.home.position + x]),
                      np.concatenate([free.R_base_sensor, np.tile(home, (len(t), 1, 1))]))


def rubbed(recording, mu):
    """Add friction at the tip: the rig's wall has none."""
    wrench, pose = recording.wrench, recording.pose
    velocity = np.gradient(pose.position + pose.R_base_sensor @ TIP, pose.t, axis=0) * [0, 1, 1]
    way = velocity / np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-3)
    way = np.stack([np.interp(wrench.t, pose.t, one) for one in way.T], axis=1)
    push = np.linalg.norm(recording.contact_truth.at(wrench.t)[:, :3], axis=1)
    R = pose.R_base_sensor[np.searchsorted(pose.t, wrench.t).clip(max=len(pose) - 1)]
    force = np.einsum('nji,nj->ni', R, -mu * push[:, np.newaxis] * way)
    return replace(wrench, values=wrench.values + np.hstack([force, np.cross(TIP, force)]))


def robot(wall=None, rubs=RUBS, seed=3, slide=0.02, effects=None):
    """Record a robot that follows 8 ms late, or without noise its simulation (seed None)."""
    rig = replace(RIG, wall=replace(RIG.wall, **{**WALL, **(wall or {})}))
    late = {} if seed is None else LATE
    if seed is None:
        rig = replace(rig, wrench_sensor=replace(rig.wrench_sensor, bias=(0.0,) * 6))
    rig = with_effects(rig, {**late, **(effects or {})})
    clean = simulate(rig, pressing(slide), noise=False)
    made = clean if seed is None else simulate(rig, pressing(slide), seed=seed)
    own = replace(made, pose=clean.pose)
    return replace(made, wrench=rubbed(own, rubs), accelerometer=None, contact_truth=None)
