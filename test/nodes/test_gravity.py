"""Behind the observer: samples of it come in, whatever their status."""

from forcecal_ros.gravity import begin, model_from_calibration, on_sample, Settings, weight
from forcecal_ros.observe import ContactSample, Status
from forcecal_ros.observe.filters.bias_filter import BAD_WRENCH, NO_LOAD
from forcecal_ros.observe.tracking import Rotation
import gravity_arm as arm
import numpy as np
import pytest
from scipy.spatial.transform import Rotation as R

ZERO = (0.0,) * 3
LOAD = np.array([1.0, 2.0, 6.0, 0.1, 0.2, 0.0])


@pytest.fixture(scope='module')
def calibration():
    return arm.calibrate(np.random.default_rng(31), seconds=0.2)[0]


@pytest.fixture(scope='module')
def model(calibration):
    return model_from_calibration(calibration)


def sample(t, force=0.0, status=0):
    measured = np.array([force, 0, 0, 0, 0, 0.0])
    return ContactSample(t, tuple(measured), status, tuple(measured), ZERO * 2, tuple(LOAD))


def fed(model, samples, live=None):
    live = live or begin(model)
    for one in samples:
        live, estimate = on_sample(live, one, None, model)
    return live, estimate


def test_the_wire_is_put_together_again(model):
    _, estimate = fed(model, [sample(k * 1e-3, 5.0) for k in range(300)])
    assert estimate.wrench[0] == pytest.approx(5.0, abs=1e-3)
    assert estimate.wrench[1:] == pytest.approx(np.zeros(5), abs=1e-3)
    assert estimate.contact


@pytest.mark.parametrize('observed, said', [
    (Status.BAD_WRENCH, BAD_WRENCH), (Status.NO_GRAVITY, NO_LOAD)])
def test_what_the_observer_could_not_use_is_skipped_and_its_time_is_made_up(
        model, observed, said):
    live, before = fed(model, [sample(k * 1e-3) for k in range(100)])
    after, estimate = on_sample(live, sample(0.1, 9.0, int(observed)), None, model)
    assert estimate.status == said
    assert after == live
    assert (estimate.wrench == before.wrench).all()
    later, _ = on_sample(after, sample(0.101), None, model)
    assert later.t == 0.101


def test_a_clock_that_went_back_starts_the_filter_anew(model):
    live, _ = fed(model, [sample(k * 1e-3, 5.0) for k in range(300)])
    live, estimate = on_sample(live, sample(-100.0), None, model)
    assert live.t == -100.0
    assert estimate.status == 0
    assert np.abs(estimate.wrench).max() < 1e-9


def test_static_takes_the_weight_from_the_pose_and_not_from_the_load(calibration):
    model = model_from_calibration(calibration, Settings(filter='static'))
    turned = R.from_euler('xyz', [2.9, 0.2, 0.1])
    omega = np.array([0.5, -0.3, 0.2])
    rotation = Rotation(1.0, tuple(turned.as_quat()), tuple(omega), ZERO)
    _, estimate = on_sample(begin(model), sample(1.004), rotation, model)
    now = (turned * R.from_rotvec(0.004 * omega)).as_matrix()
    assert estimate.wrench == pytest.approx(LOAD - weight(now, model), abs=1e-6)


@pytest.mark.parametrize('age', [0.2, None])
def test_static_without_a_fresh_pose_says_so(calibration, age):
    model = model_from_calibration(calibration, Settings(filter='static'))
    rotation = None if age is None else Rotation(1.0 - age, (0.0, 0, 0, 1), ZERO, ZERO)
    assert on_sample(begin(model), sample(1.0), rotation, model)[1].status == NO_LOAD
