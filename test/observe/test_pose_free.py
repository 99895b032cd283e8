"""Without a pose: what accelerometer and gyro tell, and a step that never raises."""

from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.observe import Imu, ObserverSettings, Status
from forcecal_ros.observe.gaussian import Gaussian, transform
from forcecal_ros.observe.pose_free import (
    exponential,
    pose_free_model,
    pose_free_step,
    PoseFreeState,
    readings,
    relevelled,
    start_pose_free,
    STATES,
    TILT,
    Turning,
)
import gravity_arm as arm
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

DT = 0.001
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


def test_a_wrong_number_of_channels_is_a_bad_wrench(model):
    _, sample = pose_free_step(PoseFreeState(), 0.0, [1.0] * 5, [0.0, 0.0, 9.8], [0.0] * 3, model)
    assert sample.contact.status == Status.BAD_WRENCH


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
    assert np.linalg.norm(sample.gravity - g) < 4 * np.linalg.norm(arm.G) * tilt
    assert np.linalg.norm(sample.gravity) == pytest.approx(9.80665)


def test_wrench_bias_and_load_add_up_to_the_wire(model):
    rng = np.random.default_rng(14)
    recording = arm.record(arm.free_motion(rng, 0.5), rng)
    state = PoseFreeState()
    for k, t in enumerate(recording.wrench.t):
        wire = recording.wrench.values[k]
        state, sample = pose_free_step(state, t, wire, recording.accelerometer.values[k],
                                       recording.angular_velocity.values[k], model)
    contact = sample.contact
    assert np.add(contact.measured, contact.inertial) + model.wrench.bias == pytest.approx(wire)
    # the arm accelerates by up to 0.6 m/s^2 in each direction
    assert contact.inertial[:3] == pytest.approx(
        sample.mass * sample.gravity, abs=arm.MASS * 0.6 * 3 ** 0.5)


def test_nothing_is_said_before_an_accelerometer_spoke(model):
    state, sample = pose_free_step(PoseFreeState(), 0.0, model.wrench.bias, None, [0.0] * 3, model)
    assert sample.contact.status == Status.NO_GRAVITY
    assert sample.contact.contact == (0.0,) * 6
    assert np.isnan(sample.gravity).all()
    assert state == PoseFreeState()


def test_without_pose_the_calibration_needs_an_accelerometer_with_dc(calibration):
    coupled = replace(calibration.accelerometer, coupling='ac',
                      cutoff=Estimate(0.01, 0.0, 'Hz'))
    with pytest.raises(ConfigError, match='DC-coupled'):
        pose_free_model(replace(calibration, accelerometer=coupled))
    with pytest.raises(ConfigError, match='needs a pose'):
        pose_free_model(calibration, ObserverSettings('static'))


@pytest.mark.parametrize('vector', [(0.0, 0.0, 0.0), (1e-12, 0, 0), (0.3, -0.2, 0.9), (3, 1, 0)])
def test_the_exponential_is_that_of_so3(vector):
    assert exponential(*vector) == pytest.approx(
        Rotation.from_rotvec(vector).as_matrix(), abs=1e-14)


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


def pose_free_case(calibration, acceleration=0.0):
    """Return a belief with a poor orientation and an unknown payload, and its readings."""
    model = pose_free_model(calibration, imu=Imu(tilt_std=0.6, payload_std=0.15))
    level, states = start_pose_free(model, np.array([2.0, 1.0, 9.0]))
    mean, cov = states.mean.copy(), states.cov.copy()
    mean[15:18] = acceleration
    cov[12, 13] = cov[13, 12] = 0.5 * np.sqrt(cov[12, 12] * cov[13, 13])
    motion = Turning(np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -1.0]))
    return Gaussian(mean, cov), readings(level, model, motion)


def test_differences_are_those_of_the_readings(calibration):
    a = np.array([0.5, -0.3, 0.2])
    belief, h = pose_free_case(calibration, a)
    mean, rng = belief.mean, np.random.default_rng(8)
    dx = 1e-2 * rng.normal(size=(20, STATES))
    value = np.array([h.value(mean + row) - h.value(mean) for row in dx])
    # what a heavier mass adds to the inertia is left out on purpose
    left_out = -dx[:, 12:13] * a
    value[:, :3] -= left_out
    value[:, 3:6] -= np.cross(calibration.com.value, left_out)
    assert h.difference(mean, dx) == pytest.approx(value, abs=1e-13)


def test_sigma_points_foretell_a_tilted_weight_better_than_the_jacobian(calibration):
    belief, h = pose_free_case(calibration)
    rng = np.random.default_rng(9)
    drawn = h.difference(belief.mean, rng.multivariate_normal(
        np.zeros(STATES), belief.cov, 100_000)).mean(axis=0)
    by_points = transform(belief, h).mean - h.value(belief.mean)
    # the Jacobian foretells no shift of the mean at all
    force = slice(0, 3)
    assert np.linalg.norm(by_points[force] - drawn[force]) < 0.25 * np.linalg.norm(drawn[force])
    assert np.linalg.norm(drawn[force]) > 1.0
