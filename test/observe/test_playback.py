"""Slow logs: what is in the file is never late, and its poses are interpolated."""

from dataclasses import replace

from forcecal_ros.core.streams import PoseStream, Stream
from forcecal_ros.observe import ObserverSettings, replay, Status
from forcecal_ros.observe.playback import gap_limit
import gravity_arm as arm
from longer import first
import numpy as np
from observing import orientation_only, without_times
import pytest
from slow_log import slow_log

MISSING = Status.NO_ACCELEROMETER
"""All that may be missing of a log of wrench and pose."""


@pytest.fixture(scope='module')
def calibration():
    return arm.calibrate(np.random.default_rng(2))[0]


LOGS = {'20 Hz, same stamps': (20.0, 20.0), '10 Hz, same stamps': (10.0, 10.0),
        '50 Hz, poses at 10 Hz': (50.0, 10.0), '50 Hz, same stamps': (50.0, 50.0)}


@pytest.fixture(scope='module', params=first(LOGS, 2))
def log(request):
    return slow_log(*LOGS[request.param])


@pytest.mark.parametrize('name', ['kalman', 'ukf', 'static'])
def test_every_wrench_of_a_slow_log_has_its_pose(log, calibration, name):
    _, recording = log
    estimate = replay(recording, calibration, ObserverSettings(name))
    assert estimate.t == pytest.approx(recording.wrench.t)
    assert recording.pose.t[0] == recording.wrench.t[0]
    assert not (estimate.status & ~MISSING).any()
    assert estimate.valid.all()


def test_what_is_left_of_a_free_motion_is_near_the_noise(log, calibration):
    """The truth is zero; raw, the swing of weight and inertia is 2 to 6 N."""
    _, recording = log
    estimate = replay(recording, calibration)
    settled = estimate.t > 1.0
    left = estimate.measured[settled, :3].std(axis=0)
    assert (recording.wrench.values[settled, :3].std(axis=0) > 0.8).any()
    assert (left < 1.5 * arm.FORCE_NOISE).all()
    assert (estimate.measured[settled, 3:].std(axis=0) < 2 * arm.TORQUE_NOISE).all()


def test_gaps_longer_than_the_stream_itself_explains_stay_gaps(calibration):
    _, recording = slow_log(20.0, 20.0)
    pose = recording.pose
    holed = replace(recording, pose=without_times(pose, (4.0, 6.0)))
    estimate = replay(holed, calibration, ObserverSettings('ukf'))
    assert len(estimate.t) == len(recording.wrench)
    away = (estimate.t > 4.0 + gap_limit(pose, 0.1) + 0.05) & (estimate.t < 6.0)
    assert (estimate.status[away] & Status.NO_POSE).all() and not estimate.valid[away].any()
    # at once where it is there again
    back = (estimate.t >= pose.t[pose.t > 6.0][0])
    assert estimate.valid[back].all()


def test_one_lost_pose_is_no_gap(calibration):
    _, recording = slow_log(20.0, 20.0, jitter=0.0)
    pose = recording.pose
    keep = np.arange(len(pose)) % 7 != 3
    estimate = replay(replace(recording, pose=PoseStream(
        pose.t[keep], pose.position[keep], pose.R_base_sensor[keep])), calibration)
    assert estimate.valid.all()


def test_orientations_without_positions_are_interpolated_too(calibration):
    estimate = replay(orientation_only(slow_log(20.0, 20.0)[1]), calibration)
    assert estimate.valid.all()
    assert (estimate.status & Status.NO_POSITION).all()


def test_a_slow_accelerometer_is_interpolated_up_to_its_own_gaps(calibration):
    rng = np.random.default_rng(4)
    motion = arm.free_motion(rng, 6.0)
    full = arm.record(motion, rng)
    every = slice(None, None, 50)
    force = Stream(full.accelerometer.t[every], full.accelerometer.values[every])
    estimate = replay(replace(full, accelerometer=force), calibration)
    assert not (estimate.status[:-50] & Status.NO_ACCELEROMETER).any()
    gap = (force.t < 2.0) | (force.t > 3.0)
    holed = Stream(force.t[gap], force.values[gap])
    estimate = replay(replace(full, accelerometer=holed), calibration)
    away = (estimate.t > 2.0) & (estimate.t < 3.0)
    assert (estimate.status[away] & Status.NO_ACCELEROMETER).all()


def test_fast_streams_keep_the_live_time_outs():
    t = np.arange(0.0, 1.0, 0.001)
    assert gap_limit(Stream(t, t[:, None]), 0.025) == 0.025
    assert gap_limit(None, 0.1) == 0.1
    assert gap_limit(Stream(t[:2], t[:2, None]), 0.1) == 0.1
    slow = Stream(50 * t, t[:, None])
    assert gap_limit(slow, 0.1) == pytest.approx(0.2)
