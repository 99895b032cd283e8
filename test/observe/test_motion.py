"""Following the pose, and the wrench of a tool that moves with it."""

from forcecal_ros.core.geometry import advance_rotation, rotation_between
from forcecal_ros.observe.bandwidth import butterworth
from forcecal_ros.observe.contact import tool_wrench
from forcecal_ros.observe.design import Load
from forcecal_ros.observe.motion import (
    Place,
    Rotation,
    track_place,
    track_rotation,
)
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
import numpy as np
from observing import ACCELEROMETER, COM, G, INERTIA, MASS
import pytest
from scipy.spatial.transform import Rotation as SciRotation

vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
directions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(x * x for x in q) > 0.01)
angles = st.one_of(st.floats(0.0, 1e-6), st.floats(0.0, 0.3))


def unit(q):
    return tuple(np.array(q) / np.linalg.norm(q))


@given(directions, vectors, angles)
@hypothesis_settings(max_examples=40, deadline=None)
def test_turning_and_the_rotation_between_undo_each_other(q, axis, angle):
    if np.linalg.norm(axis) < 1e-3:
        return
    q, d = unit(q), angle * np.array(unit(axis))
    there = advance_rotation(q, *d)
    exact = SciRotation.from_quat(q) * SciRotation.from_rotvec(d)
    assert (SciRotation.from_quat(there).inv() * exact).magnitude() < 1e-7
    for sign in (1, -1):
        back = rotation_between(q, tuple(sign * x for x in there))
        # both are series; the first term that rotation_between leaves out is 15/168 sin^7
        assert back == pytest.approx(d, abs=0.1 * np.sin(angle / 2) ** 7 + 1e-9)


def follow(rotvec, times, corner):
    state = Rotation(times[0], tuple(SciRotation.from_rotvec(rotvec(times[0])).as_quat()),
                     (0.0,) * 3, (0.0,) * 3)
    for t in times[1:]:
        q = tuple(SciRotation.from_rotvec(rotvec(t)).as_quat())
        state = track_rotation(state, t, q, butterworth(corner))
    return state


@pytest.mark.parametrize('dt', [0.002, 0.004, 0.01])
def test_a_steady_acceleration_is_followed_without_error(dt):
    """About a fixed axis, through several turns; the periods jitter by a fifth."""
    rng = np.random.default_rng(0)
    times = np.cumsum(dt * rng.uniform(0.8, 1.2, int(3.0 / dt)))
    axis = np.array([0.6, 0.0, 0.8])
    state = follow(lambda t: axis * (0.5 * t * t), times, 80.0)
    assert state.alpha == pytest.approx(axis, abs=1e-6)
    assert state.omega == pytest.approx(axis * times[-1], abs=1e-6)


def test_a_jump_of_the_pose_starts_the_filter_anew():
    state = follow(lambda t: np.array([0.0, 0.0, 0.2 * t]), np.arange(0.0, 1.0, 0.004), 80.0)
    far = tuple(SciRotation.from_rotvec([1.0, 0.0, 0.0]).as_quat())
    after = track_rotation(state, 1.004, far, butterworth(80.0))
    assert after == Rotation(1.004, far, (0.0,) * 3, (0.0,) * 3)
    place = Place(0.0, 0.0, -np.inf, (0.0,) * 3, (0.1, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0,) * 3)
    moved = track_place(place, 0.004, far, (0.0,) * 3, (2.0, 0.0, 0.0), (0.0,) * 3, G,
                        butterworth(20.0))
    assert moved.p == (2.0, 0.0, 0.0) and moved.v == (0.0,) * 3 and moved.o == place.o


@pytest.mark.parametrize('s', [0.0, 0.02])
def test_tool_wrench_is_newton_and_euler(s):
    rng = np.random.default_rng(2)
    a, omega, alpha = rng.normal(size=(3, 3))
    d = COM - ACCELEROMETER
    load = Load(*(MASS, *COM, *d, *np.diag(INERTIA), 0.01, -0.02, 0.005))
    J = INERTIA + np.array([[0, 0.01, -0.02], [0.01, 0, 0.005], [-0.02, 0.005, 0]])
    f = a + np.cross(alpha, d) + np.cross(omega, np.cross(omega, d))
    r = COM + [s, 0.0, 0.0]
    torque = np.cross(r, MASS * f) + J @ alpha + np.cross(omega, J @ omega)
    found = tool_wrench(load, tuple(a), tuple(omega), tuple(alpha), s)
    assert found == pytest.approx([*(-MASS * f), *(-torque)], abs=1e-9)
