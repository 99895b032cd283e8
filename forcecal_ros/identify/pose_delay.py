"""How much later than the wrench the pose shows the same instant."""

from forcecal_ros.geometry import Array
from forcecal_ros.recording.kinematics import PoseKinematics, rate_of_change, smoothed
from forcecal_ros.recording.noise.autocovariance import noise_of_windows
from forcecal_ros.recording.time_grid import TimeGrid
import numpy as np


def pose_delay(kinematics: PoseKinematics, force: Array, slide: Array, grid: TimeGrid,
               mass: float, bias: Array, com: Array, gravity: float, largest: float
               ) -> tuple[float, float] | None:
    """
    Find how much later than the wrench the pose shows the same instant.

    The weight turns through the sensor's axes while the robot rotates, and the force shows it:
    F - b + m (R^T (a_S - g) + ...) has to stay at its noise. Along y and z only, where the
    tool's slide adds next to nothing.

    Parameters
    ----------
    force : ndarray, shape (n, 3)
        Block means on the wire [N].
    slide : ndarray, shape (n,)
        Displacement of the tool along x [m].
    bias, com : ndarray, shape (3,)
        Of the force [N]; centre of mass [m].
    largest : float
        Delays are looked for up to this [s].

    Returns
    -------
    delay, std : float, float, or None
        [s]; None where the robot did not turn, or its position is not known.
    """
    slip = np.zeros_like(force)
    slip[:, 0] = rate_of_change(slide[:, None], grid.length)[:, 0]
    lever = com + slide[:, None] * np.array([1.0, 0.0, 0.0])

    def misfit(delay: float) -> Array:
        turn, a = kinematics.angular(delay), kinematics.acceleration(delay)
        assert a is not None
        a = smoothed(a)
        a[:, 2] += gravity
        f = (np.einsum('nji,nj->ni', turn.R_base_sensor, a)
             + np.einsum('nij,nj->ni', turn.lever, lever) + 2 * np.cross(turn.omega, slip))
        return np.asarray(force - bias + mass * f)[:, 1:]

    if kinematics.acceleration() is None:
        return None
    turn = kinematics.angular()
    down = -gravity * turn.R_base_sensor[:, 2]
    slope = smoothed(mass * np.cross(turn.omega, down))[:, 1:]
    use = grid.free & np.isfinite(force).all(1) & np.isfinite(slip).all(1)
    slope[~use] = 0
    delay, size = 0.0, 1e-3
    for _ in range(6):
        low, middle, high = (float(np.nansum(slope * misfit(delay + e))) for e in (-size, 0, size))
        rate = (high - low) / (2 * size)
        if abs(rate) < 1e-12:
            return None
        move = -middle / rate
        delay = float(np.clip(delay + move, -largest, largest))
        if abs(move) < 1e-7:
            break
    residual = misfit(delay)
    noise = noise_of_windows([residual[grid.still == i] for i in range(grid.still.max() + 1)])
    std = float(np.sqrt(noise.covariance_of_sum(slope[:, :, None])[0, 0]) / abs(rate))
    return (delay, std) if std < largest / 10 else None
