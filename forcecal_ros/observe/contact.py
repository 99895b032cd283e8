"""
From a wrench on the wire to the contact wrench: bias, weight and inertia removed, then filtered.

``kalman`` is the stationary Kalman filter of a contact wrench that wanders at random, ``newton``
the paper's observer along x of ft_sensor; anything else passes unfiltered.

The innovations of ``kalman`` show how noisy the wrench is compared with the noise that was
calibrated, once the part that a contact puts into them is removed: a contact lasts longer than
4 ms, noise and vibrations do not, so that only the difference of an innovation from its own mean
over 4 ms counts. The level v is that of the variance; each reading moves it by
z = d^2 / (v E d^2), which is 1 on average where v is right:

    v <- v exp((min(z, 5) - 1) dt / 0.5 s)

A blow lasts for a few readings, each of which counts as 5 at most: no contact of its own looks
like noise. The filter of a random walk has a corner that goes as v^-1/2; its gain at zero
frequency stays one, so that a contact force appears later, not smaller.
"""

from math import exp, inf, isfinite, nan, sqrt
from typing import NamedTuple

from forcecal_ros.core.geometry import advance_rotation, rotate, Vector, ZERO
from forcecal_ros.observe import sample as st
from forcecal_ros.observe.align import Reading
from forcecal_ros.observe.design import KALMAN, Load, Model, NEWTON, SMOOTHING_TIME_S
from forcecal_ros.observe.motion import carried, gravity_in_sensor, MotionEstimate, NO_RUN
from forcecal_ros.observe.sample import (
    ContactSample,
    MAX_READING,
    NO_WRENCH,
    saturated,
    Unloaded,
    Wrench,
)


class Tool(NamedTuple):
    """
    What is remembered from the last wrench that was used.

    Attributes
    ----------
    t : float
        Its stamp [s].
    s : float
        Displacement along x of the tool [m].
    """

    t: float = -inf
    s: float = 0.0


def tool_wrench(
        load: Load, f: Vector, omega: Vector, alpha: Vector, s: float,
) -> tuple[float, float, float, float, float, float]:
    """
    Force [N] and torque [N m] that weight and motion of the tool put on the wire.

    With r = c + s x_hat and f_c = f + alpha x d + omega x (omega x d), all in ft_sensor:
    ``-(m f_c)`` and ``-(r x m f_c + I alpha + omega x I omega)``; [Gamez2005] Eq. 1 in six axes.
    The tool's sliding adds the same to accelerometer and centre of mass, so ``f`` holds it.
    At rest ``f = -g``, and the weight is what remains: ``m g`` and ``r x m g``.

    Parameters
    ----------
    f : tuple of 3 float
        Specific force at the accelerometer [m/s^2].
    omega, alpha : tuple of 3 float
        Angular velocity [rad/s] and acceleration [rad/s^2].
    s : float
        Displacement along x [m].
    """
    m, rx, ry, rz, dx, dy, dz, ixx, iyy, izz, ixy, ixz, iyz = load
    fx, fy, fz = f
    wx, wy, wz = omega
    ax, ay, az = alpha
    w2 = wx * wx + wy * wy + wz * wz
    wd = wx * dx + wy * dy + wz * dz
    fx = m * (fx + ay * dz - az * dy + wx * wd - w2 * dx)
    fy = m * (fy + az * dx - ax * dz + wy * wd - w2 * dy)
    fz = m * (fz + ax * dy - ay * dx + wz * wd - w2 * dz)
    rx += s
    hx = ixx * wx + ixy * wy + ixz * wz
    hy = ixy * wx + iyy * wy + iyz * wz
    hz = ixz * wx + iyz * wy + izz * wz
    return (-fx, -fy, -fz,
            rz * fy - ry * fz - (ixx * ax + ixy * ay + ixz * az) + wz * hy - wy * hz,
            rx * fz - rz * fx - (ixy * ax + iyy * ay + iyz * az) + wx * hz - wz * hx,
            ry * fx - rx * fy - (ixz * ax + iyz * ay + izz * az) + wy * hx - wx * hy)


def unload(tool: Tool, motion: MotionEstimate, t: float, wire: Wrench, force: Reading, s: float,
           model: Model) -> tuple[Tool, Unloaded]:
    """
    Take bias, weight and inertia off a wrench as on the wire.

    Parameters
    ----------
    t : float
        [s]
    wire : tuple of 6 float
        [N, N m]
    force
        Of the accelerometer at ``t``.
    s : float
        Displacement at ``t``; NaN without a sensor [m].
    """
    w0, w1, w2, w3, w4, w5 = wire
    b0, b1, b2, b3, b4, b5 = model.bias
    status = 0
    if s != s:
        s = 0.0
        if model.stiffness > 0:
            status = st.DISPLACEMENT_FROM_FORCE
            s = tool.s
            s += (1 - exp(-model.relaxation * (t - tool.t))) * ((w0 - b0) / model.stiffness - s)
    if model.weight_only:
        status, f, omega, alpha = _kinematics_at_rest(status, motion, t, model)
    else:
        status, f, omega, alpha = _kinematics(status, motion, t, force, model)
    if status & st.NO_GRAVITY:
        return tool, Unloaded(t, status, NO_WRENCH, NO_WRENCH, ZERO)
    if model.limited and saturated(wire, model.wrench_limit):
        status |= st.SATURATED
    i0, i1, i2, i3, i4, i5 = inertial = tool_wrench(model.load, f, omega, alpha, s)
    m0, m1, m2 = w0 - b0 - i0, w1 - b1 - i1, w2 - b2 - i2
    m3, m4, m5 = w3 - b3 - i3, w4 - b4 - i4, w5 - b5 - i5
    if not (m0 * m0 + m1 * m1 + m2 * m2 + m3 * m3 + m4 * m4 + m5 * m5 < MAX_READING * MAX_READING):
        return tool, Unloaded(t, st.BAD_WRENCH, NO_WRENCH, NO_WRENCH, ZERO)
    return Tool(t, s), Unloaded(t, status, (m0, m1, m2, m3, m4, m5), inertial, f)


def _kinematics(status: int, motion: MotionEstimate, t: float, force: Reading, model: Model
                ) -> tuple[int, Vector, Vector, Vector]:
    """Return status, specific force at the accelerometer, angular velocity and acceleration."""
    rotation, place = motion.rotation, motion.place
    omega = alpha = ZERO
    if t - rotation.t > model.pose_timeout:
        status |= st.NO_POSE
    else:
        h = t - rotation.t
        wx, wy, wz = rotation.omega
        ax, ay, az = alpha = rotation.alpha
        omega = (wx + h * ax, wy + h * ay, wz + h * az)
        if not motion.position:
            status |= st.NO_POSITION
    if force.known:
        fx, fy, fz = force.f
        if force.full:
            status |= st.SATURATED
        if motion.offset_known:
            ox, oy, oz = motion.offset
            fx, fy, fz = fx - ox, fy - oy, fz - oz
        elif model.ac_rate > 0:
            status |= st.NO_GRAVITY
        if place.t == -inf or status & st.NO_POSE:
            status |= st.OFFSET_HELD
        return status, (fx, fy, fz), omega, alpha
    if status & st.NO_POSE:
        return status | st.NO_ACCELEROMETER | st.NO_GRAVITY, ZERO, omega, alpha
    o = place.o
    if place.run != NO_RUN or place.t < rotation.t:
        o = gravity_in_sensor(rotation.q, model.gravity)
    ox, oy, oz = carried(o, omega, t - rotation.t)
    return status | st.NO_ACCELEROMETER, (-ox, -oy, -oz), omega, alpha


def _kinematics_at_rest(status: int, motion: MotionEstimate, t: float, model: Model
                        ) -> tuple[int, Vector, Vector, Vector]:
    """Return the same as if the tool hung still in its present orientation: weight alone."""
    rotation = motion.rotation
    h = t - rotation.t
    if h > model.pose_timeout:
        return status | st.NO_POSE | st.NO_GRAVITY, ZERO, ZERO, ZERO
    wx, wy, wz = rotation.omega
    q = advance_rotation(rotation.q, h * wx, h * wy, h * wz)
    x, y, z = gravity_in_sensor(q, model.gravity)
    return status, (-x, -y, -z), ZERO, ZERO


class NoiseLevel(NamedTuple):
    """
    What is remembered of the innovations.

    Attributes
    ----------
    level : float
        Variance of the noise over that in the calibration.
    mean : tuple of 3 float
        Of the force's innovation over the last 4 ms [N].
    """

    level: float
    mean: Vector


AS_CALIBRATED = NoiseLevel(1.0, ZERO)


def updated(before: NoiseLevel, dt: float, e: Vector, scale: Vector) -> NoiseLevel:
    """
    Take in an innovation.

    Parameters
    ----------
    dt : float
        Since the last one [s].
    e : tuple of 3 float
        Of the force [N].
    scale : tuple of 3 float
        By :func:`scale_of`.
    """
    (mx, my, mz), (ex, ey, ez), (sx, sy, sz) = before.mean, e, scale
    dx, dy, dz = ex - mx, ey - my, ez - mz
    z = (sx * dx * dx + sy * dy * dy + sz * dz * dz) / before.level
    # time constant: a level of ten is reached in half a second, and left in
    # 1.2 s, both within two [s]
    # what a single reading counts for at most: chance exceeds it twice in a thousand on three axes
    level = before.level * exp((min(z, 5.0) - 1) * min(dt / 0.5, 1.0))
    k = 1 - exp(-dt / SMOOTHING_TIME_S)
    # within the lowest and the highest level that is accepted
    return NoiseLevel(min(max(level, 0.25), 1e4),
                      (mx + k * dx, my + k * dy, mz + k * dz))


def accepted(level: float) -> float:
    """Return the level that the gain follows: 1 until it is plainly another."""
    # from the first level on the noise counts as another one, from the second on wholly so: noise
    # levels drift by a factor of two on their own
    low, high = 2.0, 4.0
    if level <= low:
        return 1.0
    return level if level >= high else 1.0 + (level - low) / (high - low) * (high - 1.0)


def rate_at(level: float, rate: float, slowest: float) -> float:
    """Return the corner of the contact wrench at a level, no slower than ``slowest`` [rad/s]."""
    return max(rate / sqrt(accepted(level)), min(rate, slowest))


class NewtonState(NamedTuple):
    """Position [m] and velocity [m/s] of the tool along x, as the paper's observer has them."""

    x: float
    v: float


STOPPED = NewtonState(nan, nan)


class Memory(NamedTuple):
    """
    What a filter remembers of the last wrench that was used.

    Attributes
    ----------
    t : float
        Its stamp [s].
    contact : tuple of 6 float
        [N, N m]
    newton : NewtonState
        NaN where it is not running.
    axis : tuple of 3 float
        x of ft_sensor in base, which ``newton`` is along.
    noise : NoiseLevel
        As ``kalman`` measures it.
    """

    t: float = -inf
    contact: Wrench = NO_WRENCH
    newton: NewtonState = STOPPED
    axis: Vector = ZERO
    noise: NoiseLevel = AS_CALIBRATED


def innovation(memory: Memory, reading: Unloaded, model: Model) -> tuple[int, Wrench]:
    """Return status and what the last estimate did not lead to expect; zero after a pause."""
    dt = reading.t - memory.t
    if dt > model.pause:
        return (reading.status | st.RESTARTED if memory.t > -inf else reading.status), NO_WRENCH
    m0, m1, m2, m3, m4, m5 = reading.measured
    c0, c1, c2, c3, c4, c5 = memory.contact
    return reading.status, (m0 - c0, m1 - c1, m2 - c2, m3 - c3, m4 - c4, m5 - c5)


def kalman_step(memory: Memory, reading: Unloaded, e: Wrench, model: Model) -> Memory:
    """
    Take in one wrench: F + K e, with the gain K = 1 - exp(-rate dt) of the stationary filter.

    The rate is that of the noise as it is now, where the model is ``adaptive``.

    Parameters
    ----------
    e : tuple of 6 float
        Its :func:`innovation` [N, N m].
    model
        ``rate`` by :func:`forcecal_ros.observe.bandwidth.contact_bandwidth`.
    """
    # from one reading to the next, up to which a contact's own motion is separated from noise by
    # that mean: slower readings show nothing of their noise [s]
    max_period = 2 * SMOOTHING_TIME_S
    dt = reading.t - memory.t
    if dt > model.pause:
        return Memory(reading.t, reading.measured, STOPPED, ZERO, memory.noise)
    c0, c1, c2, c3, c4, c5 = memory.contact
    e0, e1, e2, e3, e4, e5 = e
    noise, rate = memory.noise, model.rate
    if model.adaptive and dt <= max_period:
        noise = updated(noise, dt, (e0, e1, e2), model.innovation_scale)
        rate = rate_at(noise.level, rate, model.slowest)
    k = 1 - exp(-rate * dt)
    return Memory(
        reading.t, (c0 + k * e0, c1 + k * e1, c2 + k * e2, c3 + k * e3, c4 + k * e4, c5 + k * e5),
        STOPPED, ZERO, noise)


def newton_step(
        state: NewtonState, dt: float, u: float, a: float, x: float, v: float, m: float,
        K: tuple[float, float, float, float, float, float]) -> tuple[NewtonState, float]:
    """
    Carry the observer of [Gamez2005] Eq. 3-5 over one period and return its contact force.

    States [x, dx/dt], measurements y = [x, dx/dt, d2x/dt2], A the double integrator, B = [0, 1/m],
    C = [[1, 0], [0, 1], [0, 0]], D_u = [0, 0, 1/m]:

        d xi/dt = A xi + B u + K (y - C xi - D_u u)
        F = u - m d xi_2/dt
          = k23 u - k23 m a - m k21 (x - xi_1) - m k22 (dx/dt - xi_2)

    which is Eq. 3 with the k22 term that it drops. Mind what k23 = 1 does: the first two terms
    are u - m a, untouched by any dynamics, so the sensors' noise in u - m a passes undiminished
    (0 dB with the gains printed in Eq. 32 and 33, above 0 dB with faster ones, which add the
    noise of x and dx/dt). The spectrum of Fig. 6 cannot come from Eq. 3 as printed; filter
    ``kalman`` is the one that filters.

    Parameters
    ----------
    dt : float
        Time since the last call [s].
    u : float
        Force of the robot on the tool, weight removed [N].
    a, x, v : float
        Measured acceleration [m/s^2], position [m] and velocity [m/s] of the tool.
    m : float
        [kg]
    K : tuple of 6 float
        Gain, row by row (2 x 3), continuous time.

    Returns
    -------
    state : NewtonState
    force : float
        Of the tool on its environment (the paper's F) [N].
    """
    k11, k12, k13, k21, k22, k23 = K
    surplus = a - u / m
    w1 = k11 * x + k12 * v + k13 * surplus
    w2 = u / m + k21 * x + k22 * v + k23 * surplus
    # trapezoid in the states: stable for any stable A - K C and any period
    h = dt / 2
    r1 = state.x + h * ((1 - k12) * state.v - k11 * state.x) + dt * w1
    r2 = state.v - h * (k21 * state.x + k22 * state.v) + dt * w2
    a11, a12, a21, a22 = 1 + h * k11, -h * (1 - k12), h * k21, 1 + h * k22
    det = a11 * a22 - a12 * a21
    xi_1 = (a22 * r1 - a12 * r2) / det
    xi_2 = (a11 * r2 - a21 * r1) / det
    force = k23 * (u - m * a) - m * k21 * (x - xi_1) - m * k22 * (v - xi_2)
    return NewtonState(xi_1, xi_2), force


def along_x(memory: Memory, reading: Unloaded, motion: MotionEstimate, model: Model) -> Memory:
    """
    Run the paper's observer along x; its force comes back in the wire's sign.

    Position and velocity are those of the tool as the pose filter has them; without a position
    they count as met, which leaves Newton's law. The paper's x does not turn: where the sensor
    does, the observer's position and velocity are turned along, so that only translation drives
    its error. The other five components are not filtered.
    """
    state, m, f = memory.newton, model.load.m, reading.f
    _, m1, m2, m3, m4, m5 = reading.measured
    wire_x = reading.measured[0] + reading.inertial[0]
    rotation, place = motion.rotation, motion.place
    if place.t == -inf or not motion.position:
        return Memory(reading.t, (wire_x + m * f[0], m1, m2, m3, m4, m5), STOPPED, ZERO,
                      AS_CALIBRATED)
    g = gravity_in_sensor(rotation.q, model.gravity)[0]
    nx, ny, nz = axis = rotate(rotation.q, (1.0, 0.0, 0.0))
    v = nx * place.v[0] + ny * place.v[1] + nz * place.v[2]
    x = nx * place.p[0] + ny * place.p[1] + nz * place.p[2] + v * (reading.t - place.t)
    dt = reading.t - memory.t
    if not isfinite(state.x) or dt > model.pause:
        state = NewtonState(x, v)
        dt = 0.0
    else:
        dx, dy, dz = nx - memory.axis[0], ny - memory.axis[1], nz - memory.axis[2]
        (px, py, pz), (vx, vy, vz) = place.p, place.v
        state = NewtonState(state.x + dx * px + dy * py + dz * pz,
                            state.v + dx * vx + dy * vy + dz * vz)
    state, force = newton_step(state, dt, -wire_x + m * g, f[0] + g, x, v, m, model.K)
    return Memory(reading.t, (-force, m1, m2, m3, m4, m5), state, axis, AS_CALIBRATED)


def filtered(memory: Memory, reading: Unloaded, motion: MotionEstimate, model: Model
             ) -> tuple[Memory, ContactSample]:
    """Answer one wrench by ``kalman``, ``newton`` or no filter at all."""
    t, status, measured, inertial, _ = reading
    if status & st.INVALID:
        return memory, ContactSample(
            t, memory.contact, status, NO_WRENCH, NO_WRENCH, NO_WRENCH, None)
    if model.filter == KALMAN:
        status, e = innovation(memory, reading, model)
        memory = kalman_step(memory, reading, e, model)
        if accepted(memory.noise.level) > 1.0:
            status |= st.NOISY
    elif model.filter == NEWTON:
        status, e = innovation(memory, reading, model)
        memory = along_x(memory, reading, motion, model)
    else:
        e = NO_WRENCH
        memory = Memory(t, measured, STOPPED, ZERO, AS_CALIBRATED)
    return memory, ContactSample(t, memory.contact, status, measured, e, inertial, None)
