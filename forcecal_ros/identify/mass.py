"""The tool's mass: from two poses, as the paper has it, and from all of them."""

from typing import NamedTuple

from forcecal_ros.errors import UnobservableError
from forcecal_ros.geometry import Array
from forcecal_ros.identify.static_readings import check_weight, refuse_negative, Statics
import numpy as np
from scipy.linalg import block_diag


def mass_from_tilt(u_h: float, u_v: float, gravity: float, theta: float = 0.0) -> float:
    """
    Tool mass from the x force with x vertical (h) and with x horizontal (v), [Gamez2005] Eq. 16.

    Turning x of the sensor by theta about its own z before it is raised leaves it off the
    vertical by theta: it then carries only cos(theta) of the weight, and Eq. 16 as printed
    (theta = 0 here) is short by that factor.

    Parameters
    ----------
    u_h, u_v : float
        Mean force along x, Eq. 11 and Eq. 14 [N].
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


class Weight(NamedTuple):
    """
    Mass [kg] and force bias (3,) [N] from the forces alone.

    Attributes
    ----------
    force_bias : ndarray, shape (3,)
    covariance : ndarray, shape (4, 4)
    chi_square, degrees : float, int
        Of the residuals.
    """

    mass: float
    force_bias: Array
    covariance: Array
    chi_square: float
    degrees: int


def weigh(statics: Statics, condition: float = 100.0) -> Weight:
    """
    Fit mass and force bias to the forces of the static poses.

    Parameters
    ----------
    statics : Statics
        With covariance.
    condition : float
        See :func:`check_weight`.

    Raises
    ------
    UnobservableError, DataError
        As :func:`identify_tool`.
    """
    assert statics.covariance is not None
    check_weight(statics.gravity, condition)
    n = len(statics.gravity)
    design = np.zeros((n, 3, 4))
    design[:, :, 0] = statics.carried
    design[:, :, 1:] = np.eye(3)
    noise = block_diag(*statics.covariance[:, :3, :3])
    weight = 1 / np.diag(noise)
    rows, reading = design.reshape(3 * n, 4), statics.wrench[:, :3].ravel()
    bread = np.linalg.solve((rows * weight[:, None]).T @ rows, (rows * weight[:, None]).T)
    theta = bread @ reading
    refuse_negative(theta[0])
    residual = reading - rows @ theta
    return Weight(float(theta[0]), theta[1:], bread @ noise @ bread.T,
                  float(residual @ np.linalg.solve(noise, residual)), 3 * n - 4)
