"""The paper's observer, on the x axis of ft_sensor."""

from typing import NamedTuple


class NewtonState(NamedTuple):
    """Position [m] and velocity [m/s] of the tool along x, as the observer has them."""

    x: float
    v: float


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
    noise of x and dx/dt). The spectrum of Fig. 6 cannot come from Eq. 3 as printed; mode
    ``kalman`` is the one that filters.

    Parameters
    ----------
    state : NewtonState
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
