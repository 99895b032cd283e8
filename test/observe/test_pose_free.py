"""Without a pose: what accelerometer and gyro tell, and a step that never raises."""

from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.observe import Imu, ObserverSettings, Status
from forcecal_ros.observe.gaussian import Gaussian
from forcecal_ros.observe.pose_free import (
    pose_free_model,
    pose_free_step,
    PoseFreeState,
    readings,
    relevelled,
    start_pose_free,
    TILT,
    Turning,
)
import gravity_arm as arm
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

NUMBER = st.floats(allow_nan=True, allow_infinity=True)


@pytest.fixture(scope='module')
def calibration():
    return arm.calibrate(np.random.default_rng(3), seconds=0.2)[0]


@pytest.fixture(scope='module')
def model(calibration):
    return pose_free_model(calibration, imu=Imu(gyro_std=arm.GYRO_NOISE))


@pytest.mark.filterwarnings('error')
@given(wrench=st.lists(NUMBER, min_size=6, max_size=6),
       force=st.none() | st.lists(NUMBER, min_size=3, max_size=3),
       omega=st.none() | st.lists(NUMBER, min_size=3, max_size=3), t=NUMBER)
@example(wrench=[0.0] * 6, force=[0.0] * 3, omega=[9e8] * 3, t=10.0)
@settings(max_examples=60, deadline=None)
def test_no_sample_makes_the_step_raise(model, wrench, force, omega, t):
    state, _ = pose_free_step(PoseFreeState(), 0.0, model.wrench.bias, [0.0, 0.0, 9.8],
                              [0.0] * 3, model)
    after, sample = pose_free_step(state, t, wrench, force, omega, model)
    status = sample.contact.status
    assert np.isfinite(sample.contact.contact).all()
    if not ((np.abs(wrench) < 1e9).all() and 0 < t < np.inf):
        assert after is state and status == Status.BAD_WRENCH
    elif force is None:
        assert status & Status.NO_ACCELEROMETER
    elif omega is None:
        assert status & Status.NO_GYRO


@pytest.mark.long
def test_a_silent_accelerometer_leaves_gravity_to_the_gyro(model):
    rng = np.random.default_rng(13)
    motion = arm.free_motion(rng, 1.6)
    recording = arm.record(motion, rng)
    state = PoseFreeState()
    for k, t in enumerate(recording.wrench.t):
        f = recording.accelerometer.values[k] if k < 800 else None
        state, sample = pose_free_step(
            state, t, recording.wrench.values[k], f, recording.angular_velocity.values[k], model)
    g = motion.R_base_sensor[-1].T @ arm.G
    assert sample.contact.status == Status.NO_ACCELEROMETER
    tilt = np.sqrt(np.linalg.eigvalsh(state.belief.states.cov[TILT, TILT])[-1])
    assert np.linalg.norm(sample.by_imu.gravity - g) < 4 * np.linalg.norm(arm.G) * tilt
    assert np.linalg.norm(sample.by_imu.gravity) == pytest.approx(9.80665)


def test_nothing_is_said_before_an_accelerometer_spoke(model):
    state, sample = pose_free_step(PoseFreeState(), 0.0, model.wrench.bias, None, [0.0] * 3, model)
    assert sample.contact.status == Status.NO_GRAVITY
    assert sample.contact.contact == (0.0,) * 6
    assert np.isnan(sample.by_imu.gravity).all()
    assert state == PoseFreeState()


def test_without_pose_the_calibration_needs_an_accelerometer_with_dc(calibration):
    coupled = replace(calibration.accelerometer, coupling='ac',
                      cutoff=Estimate(0.01, 0.0, 'Hz'))
    with pytest.raises(ConfigError, match='DC-coupled'):
        pose_free_model(replace(calibration, accelerometer=coupled))
    with pytest.raises(ConfigError, match='needs a pose'):
        pose_free_model(calibration, ObserverSettings('static'))


def test_moving_the_tilt_into_the_frame_changes_no_gravity(calibration):
    model = pose_free_model(calibration)
    belief = start_pose_free(model, np.array([1.0, -2.0, 9.0]))
    mean = belief.states.mean.copy()
    mean[13:15] = 0.3, -0.5
    still = Turning(np.zeros(3), np.zeros(3))
    before = readings(belief.level, model, still).value(mean)
    after = relevelled(belief.level, Gaussian(mean.copy(), belief.states.cov))
    assert readings(after.level, model, still).value(after.states.mean) == pytest.approx(before)
    assert after.level.T @ after.level == pytest.approx(np.eye(3), abs=1e-12)
