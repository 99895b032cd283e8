"""Filter ``newton``: the paper's observer, on the x axis of ft_sensor."""

from math import inf, isfinite

from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.memory import Memory, NewtonState, STOPPED
from forcecal_ros.observe.filters.noise_level import AS_CALIBRATED
from forcecal_ros.observe.motion import gravity_in_sensor, MotionEstimate
from forcecal_ros.observe.tracking import rotate, ZERO
from forcecal_ros.observe.unload import Unloaded


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
