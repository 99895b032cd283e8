"""Tool, biases and delay from any motion, by one robust fit."""

from typing import NamedTuple

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.estimation import robust_fit, RobustFit
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.rigid_body import block_means, body_motion, regressor
from forcecal_ros.core.streams import PoseStream, Stream
import numpy as np
from scipy.ndimage import gaussian_filter1d

STEP_S, LOWPASS_S = 0.01, 0.03
"""Grid, and standard deviation of the low-pass that wrench and regressor pass [s]."""


class JointFit(NamedTuple):
    """
    What a recording tells of its tool.

    Attributes
    ----------
    theta, std : ndarray, shape (16,)
        Mass [kg], first moments [kg m], inertia about the sensor (xx, yy, zz, xy, xz, yz)
        [kg m^2], biases [N, N m].
    com, com_std : ndarray, shape (3,)
        [m]
    delay, delay_std : float
        By which the wrench is late [s].
    """

    theta: Array
    std: Array
    com: Array
    com_std: Array
    delay: float
    delay_std: float
    fit: RobustFit


def joint_fit(wrench: Stream, pose: PoseStream, gravity: Array, largest_delay: float = 0.05
              ) -> JointFit:
    """
    Fit a rigid tool to wrench and pose, moving or at rest.

    Parameters
    ----------
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    largest_delay : float
        Delays up to this are looked for [s].

    Notes
    -----
    Nothing of it says whether the recording makes sense: no check of excitation, of a delay at
    its limit, or of positions that are missing. Callers do that.

    Raises
    ------
    UnobservableError
        The recording is too short.
    """
    step = max(STEP_S, float(np.median(np.diff(pose.t))), float(np.median(np.diff(wrench.t))))
    first = max(wrench.t[0], pose.t[0]) + largest_delay
    last = min(wrench.t[-1], pose.t[-1]) - largest_delay - step
    starts = np.arange(first, last, step)
    if len(starts) < 100:
        raise UnobservableError('wrench and pose overlap for less than 100 readings')
    width = LOWPASS_S / STEP_S  # in steps: slower recordings are smoothed over as many samples
    motion = body_motion(pose, starts, step, gravity)
    X = gaussian_filter1d(regressor(motion), width, axis=0)
    bias = np.broadcast_to(np.eye(6), (len(X), 6, 6))
    edge = int(4 * width) + 2
    inner = slice(edge, -edge)

    def fitted(delay: float, theta: Array | None) -> RobustFit:
        y = gaussian_filter1d(block_means(wrench.t, wrench.values, starts + delay, step), width,
                              axis=0)
        columns = [X, bias]
        if theta is not None:
            columns.append(-np.gradient(X @ theta[:10], step, axis=0)[:, :, None])
        return robust_fit(np.concatenate(columns, axis=2)[inner], y[inner])

    coarse = np.linspace(-largest_delay, largest_delay, 11)
    tried = [fitted(delay, None) for delay in coarse]
    best = int(np.argmin([np.log(one.scale).sum() for one in tried]))
    delay, fit = float(coarse[best]), tried[best]
    for _ in range(4):
        fit = fitted(delay, fit.theta)
        change = float(fit.theta[16])
        delay = float(np.clip(delay + change, -largest_delay, largest_delay))
        if abs(change) < 1e-6:
            break
    theta, C = fit.theta[:16], fit.covariance
    com = theta[1:4] / theta[0]
    J = np.column_stack([-com, np.eye(3)]) / theta[0]
    com_std = np.sqrt(np.diag(J @ C[:4, :4] @ J.T))
    return JointFit(theta, fit.std[:16], com, com_std, delay, float(fit.std[16]), fit)
