"""Filter static: bias and weight off by the pose alone, nothing filtered."""

from dataclasses import replace

from forcecal_ros.observe import design, ObserverSettings, replay, Status
from forcecal_ros.observe.align import SILENT
from forcecal_ros.observe.contact import Tool, unload
from forcecal_ros.observe.motion import MotionEstimate, Rotation
from forcecal_ros.observe.playback import events, run
import gravity_arm as arm
import numpy as np
from observing import BIAS, calibration, COM, G, MASS, record, Swing
import pytest
from scipy.spatial.transform import Rotation as R

ZERO = (0.0,) * 3


@pytest.fixture(scope='module')
def model():
    calibration = arm.calibrate(np.random.default_rng(31), seconds=0.2)[0]
    return design(calibration, ObserverSettings('static'))


def unloaded(model, rotation, t):
    wire = tuple(np.add(model.bias, [1.0, 2.0, 6.0, 0.1, 0.2, 0.0]))
    motion = MotionEstimate(rotation=rotation)
    return unload(Tool(), motion, t, wire, SILENT, float('nan'), model)[1]


def test_the_weight_is_that_of_the_pose_carried_to_the_wrench(model):
    turned = R.from_euler('xyz', [2.9, 0.2, 0.1])
    omega = np.array([0.5, -0.3, 0.2])
    found = unloaded(model, Rotation(1.0, tuple(turned.as_quat()), tuple(omega), ZERO), 1.004)
    g = (turned * R.from_rotvec(0.004 * omega)).as_matrix().T @ arm.G
    weight = model.load.m * g
    assert found.status == 0
    assert found.inertial == pytest.approx(
        np.concatenate([weight, np.cross(model.load[1:4], weight)]), abs=1e-6)
    assert np.add(found.measured, found.inertial) == pytest.approx([1.0, 2.0, 6.0, 0.1, 0.2, 0.0])


@pytest.mark.parametrize('age', [0.2, np.inf])
def test_without_a_fresh_pose_it_says_so(model, age):
    found = unloaded(model, Rotation(1.0 - age, (0.0, 0, 0, 1), ZERO, ZERO), 1.0)
    assert found.status == Status.NO_POSE | Status.NO_GRAVITY


def test_over_a_recording_what_is_left_is_inertia_and_the_weight_follows_the_slide():
    recording = record(2.0, Swing(place=(0.012, 0.0, 0.0), slide=0.01), noise=0.0)
    estimate = replay(recording, calibration(noise=0.0), ObserverSettings('static'))
    late = estimate.t > 0.2
    # the hand points down: nothing is left of the weight, with the slide, but m a
    slide = recording.optidrive.values[late, 0]
    down = np.diag([1.0, -1.0, -1.0]) @ [0.0, 0.0, -MASS * G]
    r = COM + slide[:, None] * [1.0, 0.0, 0.0]
    weight = np.hstack([np.tile(down, (late.sum(), 1)), np.cross(r, down)])
    assert estimate.inertial[late] == pytest.approx(weight, abs=1e-3)
    left = recording.wrench.values[late] - BIAS - weight
    assert estimate.contact[late] == pytest.approx(left, abs=1e-3)
    assert np.ptp(left[:, 0]) > 20


def test_neither_accelerometer_nor_position_is_missed():
    recording = record(0.3, without=('accelerometer',))
    known = replace(calibration(), accelerometer=None)
    _, samples = run(events(recording), design(known, ObserverSettings('static')))
    assert {sample.status for sample in samples if sample.t > 0.0041} == {0}
