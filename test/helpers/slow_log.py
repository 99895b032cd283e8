"""Logs of wrench and pose alone, at rates and with stamps as other people's loggers make them."""

from dataclasses import replace

from forcecal_ros.core.streams import PoseStream, Stream
import gravity_arm as arm
import numpy as np


def stamps(rate, seconds, rng, jitter):
    """Stamps as a log has them: late by up to ``jitter`` of a period, on the grid of the arm."""
    t = np.arange(0.0, seconds, 1 / rate)
    t[1:-1] += jitter / rate * rng.uniform(0.0, 1.0, len(t) - 2)
    return np.unique(np.round(t * arm.RATE).astype(int))


def slow_log(wrench_rate, pose_rate, seconds=12.0, jitter=0.3, seed=1):
    """Wrench and pose of the arm in free motion, and nothing else; both jitter by themselves."""
    rng = np.random.default_rng(seed)
    motion = arm.free_motion(rng, seconds)
    full = arm.record(motion, rng)
    w, p = stamps(wrench_rate, seconds, rng, jitter), stamps(pose_rate, seconds, rng, jitter)
    if wrench_rate == pose_rate:
        p = w
    position = motion.position[p] + rng.normal(0.0, arm.POSITION_NOISE, (len(p), 3))
    return motion, replace(
        full, wrench=Stream(motion.t[w], full.wrench.values[w]),
        pose=PoseStream(motion.t[p], position, motion.R_base_sensor[p]),
        accelerometer=None, angular_velocity=None, contact_truth=None)
