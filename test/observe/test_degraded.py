"""When a stream is missing the observer does what can be done, and says so."""

from dataclasses import replace

from forcecal_ros.core.streams import Stream
from forcecal_ros.observe import describe, level, replay, Status
import numpy as np
from observing import (
    calibration,
    G,
    MASS,
    orientation_only,
    push,
    record,
    Swing,
    without_times,
)
import pytest
from scipy.spatial.transform import Rotation

SWING = Swing(place=(0.004, 0.006, 0.006), place_hz=1.0, turn=0.3, axis=(0.2, 1.0, 0.0))
TILTED = Rotation.from_euler('xyz', [2.6, 0.4, 0.3]).as_matrix()
PUSH = push(1, 20.0, 2.0)


def error(estimate, recording, start=2.5):
    late = (estimate.t > start) & (estimate.t < recording.wrench.t[-1] - 0.1)
    return (estimate.contact - recording.contact_truth.values)[late]


def middle(estimate):
    return estimate.status[(estimate.t > 1.0) & (estimate.t < estimate.t[-1] - 0.15)]


def test_without_accelerometer_the_pose_tells_weight_and_acceleration():
    """At 1 Hz: static gravity alone would leave m a, the pose leaves its filter's lag."""
    recording = record(5.0, SWING, PUSH, home=TILTED, without=('accelerometer',))
    estimate = replay(recording, calibration())
    assert (middle(estimate) == Status.NO_ACCELEROMETER).all()
    inertia = recording.wrench.values[2500:, :3].std()
    assert error(estimate, recording)[:, :3].std() < 0.5 * inertia
    assert level(Status.NO_ACCELEROMETER) == 'warn'


def test_without_position_gravity_of_the_orientation_is_taken_off_at_rest():
    recording = orientation_only(
        record(3.0, contact=PUSH, home=TILTED, without=('accelerometer',)))
    estimate = replay(recording, calibration())
    assert (middle(estimate) == Status.NO_ACCELEROMETER | Status.NO_POSITION).all()
    assert np.abs(error(estimate, recording).mean(axis=0)).max() < 0.05


def test_without_pose_gravity_comes_from_the_accelerometer():
    recording = record(4.0, replace(SWING, turn=0.0), PUSH, home=TILTED, without=('pose',))
    estimate = replay(recording, calibration())
    assert (middle(estimate) == Status.NO_POSE | Status.OFFSET_HELD).all()
    assert np.abs(error(estimate, recording).mean(axis=0)).max() < 0.05
    assert error(estimate, recording)[:, :3].std() < 0.2


def test_without_pose_and_accelerometer_nothing_is_claimed():
    recording = record(1.0, without=('pose', 'accelerometer'))
    estimate = replay(recording, calibration())
    assert (estimate.status & Status.NO_GRAVITY).all()
    assert (estimate.contact == 0.0).all()
    assert level(int(estimate.status[0])) == 'error'
    assert any('weight unknown' in text for text in describe(int(estimate.status[0])))


def test_without_displacement_the_spring_force_stands_in():
    """The tool's sag of 25 mm when it points down would move the centre of mass otherwise."""
    down = Rotation.from_euler('y', np.pi / 2).as_matrix()
    recording = record(3.0, contact=PUSH, home=down, without=('optidrive',))
    sag = MASS * G / 5000.0
    wrench = recording.wrench.values.copy()
    # the recording's tool did not sag: hang it lower by the sag, along gravity
    assert np.allclose(down.T @ [0, 0, -1], [1, 0, 0])
    touching = recording.contact_truth.values[:, :3]
    moved = np.cross([sag, 0.0, 0.0], touching + [MASS * G, 0.0, 0.0])
    wrench[:, 3:] += moved
    truth = recording.contact_truth.values.copy()
    truth[:, 3:] += np.cross([sag, 0.0, 0.0], touching)
    recording = replace(recording, wrench=Stream(recording.wrench.t, wrench),
                        contact_truth=Stream(recording.wrench.t, truth))
    estimate = replay(recording, calibration())
    assert (middle(estimate) == Status.DISPLACEMENT_FROM_FORCE).all()
    assert np.abs(error(estimate, recording).mean(axis=0)).max() < 0.05


def test_a_rigid_tool_needs_no_displacement():
    recording = record(2.0, contact=push(1, 20.0, 0.5), without=('optidrive',))
    estimate = replay(recording, calibration(rigid=True))
    assert (middle(estimate) == 0).all()
    assert np.abs(error(estimate, recording, 1.0).mean(axis=0)).max() < 0.05


@pytest.mark.parametrize('turn', [0.0, 0.4])
def test_an_ac_coupled_accelerometer_gets_gravity_back_from_the_pose(turn):
    """0.01 Hz, 16 s: over 20 s the plain reading would lose most of the weight."""
    swing = Swing(place=(0.004, 0.006, 0.006), turn=turn, turn_hz=0.1, axis=(0.2, 1.0, 0.0))
    recording = record(20.0, swing, push(1, 20.0, 10.0), home=TILTED, wash=0.01)
    estimate = replay(recording, calibration(wash=0.01))
    assert (middle(estimate) == 0).all()
    assert np.abs(error(estimate, recording, 3.0).mean(axis=0))[:3].max() < 0.1
    assert error(estimate, recording, 3.0)[:, :3].std() < 0.25


def test_an_ac_coupled_accelerometer_with_orientation_only_keeps_the_weight():
    recording = orientation_only(
        record(20.0, Swing(place=(0.004, 0.006, 0.006)), home=TILTED, wash=0.01))
    estimate = replay(recording, calibration(wash=0.01))
    assert np.abs(error(estimate, recording, 3.0).mean(axis=0))[:3].max() < 0.3


def test_an_ac_coupled_accelerometer_without_pose_does_not_know_the_weight():
    estimate = replay(record(1.0, wash=0.01, without=('pose',)), calibration(wash=0.01))
    assert (estimate.status & Status.NO_GRAVITY).all()


def test_an_accelerometer_that_stops_is_replaced_by_the_pose_and_taken_back():
    recording = record(6.0, SWING, push(1, 20.0, 1.0), home=TILTED)
    recording = replace(recording, accelerometer=without_times(
        recording.accelerometer, (2.0, 4.0005)))
    estimate = replay(recording, calibration())
    away = (estimate.t > 2.01) & (estimate.t < 4.0)
    assert (estimate.status[away] & Status.NO_ACCELEROMETER).all()
    assert not (estimate.status[estimate.t > 4.1] & Status.NO_ACCELEROMETER)[:1700].any()
    off = estimate.contact - recording.contact_truth.values
    assert np.abs(off[(estimate.t > 2.5) & (estimate.t < 4.0), :3]).max() < 8.0
    assert off[(estimate.t > 4.5) & (estimate.t < 5.9), :3].std() < 0.3
