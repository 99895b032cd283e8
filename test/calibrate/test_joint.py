"""A tool from motion that never rests."""

from types import SimpleNamespace

from forcecal_ros.calibrate.findings import residuals_of
from forcecal_ros.calibrate.joint import blocks_of, joint_fit
from forcecal_ros.calibrate.residuals import largest_deviation
from forcecal_ros.core.geometry import skew
from forcecal_ros.core.streams import PoseStream, Stream
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

MASS, COM = 0.95, np.array([0.012, -0.006, 0.065])
INERTIA = np.diag([0.006, 0.0055, 0.001])
BIAS = np.array([3.0, -2.0, 5.0, 0.1, -0.2, 0.05])
DELAY = 0.006
GRAVITY = np.array([0.0, 0.0, -9.81])


def moving(seed, seconds=20.0, rate=500.0, contact=False):
    """Sample exact multi-sines by fine differences, with noise of pose and wrench."""
    rng = np.random.default_rng(seed)
    f, p, q = (rng.uniform(*ends, (6, 3)) for ends in ((0.2, 1.0), (0.0, 6.3), (0.5, 1.0)))

    def at(t):
        s = (q[:, :, None] * np.sin(2 * np.pi * f[:, :, None] * t + p[:, :, None])).sum(1)
        return 0.03 * s[:3].T, Rotation.from_rotvec(0.3 * s[3:].T).as_matrix()

    t, h = np.arange(0.0, seconds, 1 / rate), 1e-4
    late = t - DELAY
    (x0, R0), (x1, R1), (x2, R2) = at(late - h), at(late), at(late + h)
    accel = (x2 - 2 * x1 + x0) / h**2
    f_s = np.einsum('nij,ni->nj', R1, GRAVITY - accel)
    W = np.swapaxes(R1, 1, 2) @ (R2 - R0) / (2 * h)
    A = np.swapaxes(R1, 1, 2) @ (R2 - 2 * R1 + R0) / h**2 - W @ W

    def vee(M):
        return np.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0],
                         M[:, 1, 0] - M[:, 0, 1]], 1) / 2

    omega, alpha = vee(W), vee(A)
    force = MASS * f_s - MASS * (skew(alpha) + skew(omega) @ skew(omega)) @ COM
    torque = (MASS * np.cross(COM, f_s) - alpha @ INERTIA - np.cross(omega, omega @ INERTIA))
    w = np.column_stack([force, torque]) + BIAS
    w += rng.normal(0, [0.3] * 3 + [0.01] * 3, (len(t), 6))
    if contact:
        w[len(t) // 3: len(t) // 2] += [0, 10, 15, 1, 0, 0]
    x, R = at(t)
    R = R @ Rotation.from_rotvec(rng.normal(0, 2e-4, (len(t), 3))).as_matrix()
    return Stream(t, w), PoseStream(t, R_base_sensor=R, position=x + rng.normal(0, 1e-4, x.shape))


def fitted(wrench, pose):
    return joint_fit(wrench, blocks_of(wrench, pose, GRAVITY), has_position=True)


@pytest.mark.parametrize('contact', [False, True])
def test_tells_the_tool_from_motion_without_rest(contact):
    """Mass to 0.2 %, centre of mass to 1 mm, delay to 1 ms, also with contact for a sixth."""
    wrench, pose = moving(1, contact=contact)
    fit = fitted(wrench, pose)
    assert fit.theta[0] == pytest.approx(MASS, rel=2e-3)
    np.testing.assert_allclose(fit.com, COM, atol=1e-3)
    assert fit.delay == pytest.approx(DELAY, abs=1e-3)


@pytest.mark.long
def test_standard_errors_cover():
    """Of twelve seeds with mass, centre of mass and delay, 85 % or more are within 2."""
    z = []
    for seed in range(12):
        wrench, pose = moving(seed)
        fit = fitted(wrench, pose)
        z += [(fit.theta[0] - MASS) / fit.std[0], *(fit.com - COM) / fit.com_std,
              (fit.delay - DELAY) / fit.delay_std]
    assert np.mean(np.abs(z) < 2) > 0.85, np.round(z, 1)


@pytest.mark.parametrize('late', ['wrench', 'pose', 'optidrive'])
def test_rows_beside_a_gap_of_20_ms_are_fitted_and_not_looked_at(late):
    wrench, pose = moving(1)
    streams = {'wrench': wrench, 'pose': pose,
               'optidrive': Stream(wrench.t, np.zeros((len(wrench), 1)))}
    whole = streams[late]
    kept = np.abs(whole.t - 10.0) > 0.01
    streams[late] = (PoseStream(whole.t[kept], whole.position[kept], whole.R_base_sensor[kept])
                     if late == 'pose' else Stream(whole.t[kept], whole.values[kept]))
    blocks = blocks_of(streams['wrench'], streams['pose'], GRAVITY,
                       optidrive=streams['optidrive'])
    beside = np.abs(blocks.times - 10.0) < 0.1
    assert beside.any() and not blocks.sampled[beside].any()
    assert blocks.sampled[np.abs(blocks.times - 10.0) > 0.3].all()


def test_what_all_rows_at_rest_scatter_is_no_touch_and_what_one_is_off_is():
    scatter = np.random.default_rng(2).normal(0, 5.0, (300, 1))
    blocks = SimpleNamespace(groups=np.repeat([0, 1], 150), times=np.arange(300.0),
                             sampled=np.ones(300, bool))
    assert largest_deviation(residuals_of(scatter, blocks, np.array([1.0]))).is_chance
    scatter[40] += 100.0
    found = largest_deviation(residuals_of(scatter, blocks, np.array([1.0])))
    assert not found.is_chance and abs(found.time - 40.0) < 2.0
