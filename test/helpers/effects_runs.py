"""A short excitation of the rig, and what it gives with effects and without."""

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

RIG, RIGID = load_rig(), load_rig('rigid_tool.yaml')
HOME, AIM = np.array(RIG.home.position), RIG.home.R_base_sensor
GRAVITY = np.array(RIG.gravity)
BIAS = np.array(RIG.wrench_sensor.bias)


def pressing(n=400):
    """Move into the wall and out again, shaking and turning meanwhile."""
    t = 0.004 * np.arange(n)
    slow, shaking = (1.0 - np.cos(4.0 * t)) / 2.0, (1.0 - np.cos(25.0 * t)) / 2.0
    position = HOME + np.outer(slow, [0.09, 0.01, -0.02]) + np.outer(shaking, [.004, .001, .002])
    return PoseStream(t, position, AIM @ rotation_from_vector(np.outer(np.sin(t), [0., .1, .05])))


def resting(R_base_sensor=AIM, position=HOME, n=5):
    return PoseStream(0.004 * np.arange(n), np.tile(position, (n, 1)),
                      np.tile(R_base_sensor, (n, 1, 1)))


def clean(rig, target, **options):
    return simulate(rig, target, noise=False, **options)


def typical(effect):
    return {effect.name: {q.name: q.typical for q in effect.parameters}}


def nominal(effect):
    return {effect.name: {q.name: q.nominal for q in effect.parameters}}


def having(name, rig=RIG, **values):
    """Return the rig with one effect, its other parameters at their nominal values."""
    assert name in EFFECTS
    return with_effects(rig, {name: values})


def streams(recording):
    """Return what each stream says, and when."""
    pose = recording.pose
    return {
        'wrench': (recording.wrench.t, recording.wrench.values),
        'accelerometer': (recording.accelerometer.t, recording.accelerometer.values),
        'optidrive': (recording.optidrive.t, recording.optidrive.values),
        'pose': (pose.t, np.hstack([pose.position, pose.R_base_sensor.reshape(len(pose), 9)])),
    }


def changed(one, other):
    """Name the streams that differ, and by how much at most."""
    difference = {}
    for name, (t, values) in streams(one).items():
        t_other, others = streams(other)[name]
        if len(t) != len(t_other) or not np.array_equal(t, t_other):
            difference[name] = np.inf
        elif not np.array_equal(values, others):
            difference[name] = float(np.abs(values - others).max())
    return difference
