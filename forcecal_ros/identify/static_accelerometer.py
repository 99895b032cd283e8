"""The accelerometer from static poses alone, where no motion between them was recorded."""

from forcecal_ros.errors import UnobservableError
from forcecal_ros.geometry import Array
from forcecal_ros.identify.accelerometer import AccelerometerFit
from forcecal_ros.identify.static_readings import gravity_spread
import numpy as np


def identify_static_accelerometer(
        gravity: Array, volts: Array, condition: float = 100.0) -> AccelerometerFit:
    """
    Fit V = V0 - M g_S to the means of the static poses, [Gamez2005] Eq. 2 on three axes.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    volts : ndarray, shape (n, 3)
        Means; their covariance is taken from the residuals.
    condition : float
        Largest ratio of the first to the third spread of gravity.

    Returns
    -------
    AccelerometerFit
        Delay, cutoff and position not estimated.

    Raises
    ------
    UnobservableError
        Gravity does not span three directions about its mean.
    """
    n = len(gravity)
    spread, directions = gravity_spread(gravity)
    if n < 5 or spread[2] * condition < spread[0]:
        axis = int(np.argmax(np.abs(directions[2])))
        raise UnobservableError(
            f"the accelerometer's map is not observable from {n} static poses without motion "
            f'between them (condition {spread[0] / max(spread[2], 1e-12):.3g} > {condition:.3g}, '
            f'at least 5 poses wanted); add poses with gravity along {"xyz"[axis]} of ft_sensor, '
            'or record the motion between the poses')
    rows = np.column_stack([np.ones(n), -gravity])
    bread = np.linalg.inv(rows.T @ rows)
    solution = bread @ rows.T @ volts
    residuals = volts - rows @ solution
    noise = np.diag((residuals**2).sum(axis=0) / (n - 4))
    spread_of = np.einsum('ab,ij->iajb', bread, noise)
    order = np.array([[i, 0] for i in range(3)]
                     + [[i, 1 + j] for i in range(3) for j in range(3)]).T
    full = np.full((17, 17), np.nan)
    full[:12, :12] = spread_of[order[0][:, None], order[1][:, None], order[0], order[1]]
    nan = float('nan')
    return AccelerometerFit(solution[0], solution[1:].T, nan, nan, np.full(3, nan), full, None,
                            nan, 3 * n - 12, float(np.abs(residuals).max()))
