"""The tool's mass from two poses, as the paper has it."""

from forcecal_ros.errors import UnobservableError
import numpy as np


def mass_from_tilt(u_h: float, u_v: float, gravity: float, theta: float = 0.0) -> float:
    """
    Tool mass from the x force with x vertical (h) and with x horizontal (v), [Gamez2005] Eq. 16.

    Turning x of the sensor by theta about its own z before it is raised leaves it off the
    vertical by theta: it then carries only cos(theta) of the weight, and Eq. 16 as printed
    (theta = 0 here) is short by that factor.

    Parameters
    ----------
    u_h, u_v : float
        Mean force along x, [Gamez2005] Eq. 11 and Eq. 14 [N].
    gravity : float
        Magnitude [m/s^2].
    theta : float
        As in Eq. 9 [rad].

    Returns
    -------
    float
        [kg]

    Raises
    ------
    UnobservableError
        With that theta x is as good as horizontal in both poses.
    """
    share = abs(np.cos(theta))
    if share < 0.1:
        raise UnobservableError(
            f'x of ft_sensor carries {share:.2g} of the weight at theta = {theta:.3g} rad, '
            'too little to weigh with; take theta nearer to 0')
    return float(abs(u_v - u_h) / (gravity * share))
