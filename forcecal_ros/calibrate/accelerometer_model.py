"""The accelerometer's model, block by block: residuals, their derivatives, the score."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.kinematics import smoothed
from forcecal_ros.core.noise.autocovariance import Autocovariance
from forcecal_ros.core.streams import Stream
import numpy as np
from numpy.typing import NDArray

DEFAULT_CUTOFF = 0.01
"""Where the search for an unknown corner starts [Hz]."""

_TURNED = 3.0
"""Smallest singular value of the blocks' lever matrices from which a lever is fitted [1/s^2]."""


class MotionBlocks(NamedTuple):
    """
    What the specific force at the accelerometer follows from, block by block.

    Attributes
    ----------
    length : float
        Of the blocks [s].
    gravity : ndarray, shape (n, 3)
        In ft_sensor by the pose [m/s^2].
    force : ndarray, shape (n, 3)
        On the wire [N]; NaN where it is missing.
    rotation : ndarray, shape (n, 3, 3)
        [alpha]x + [omega]x [omega]x [1/s^2].
    still : ndarray of int, shape (n,)
        Which static pose; -1 for none.
    free : ndarray of bool, shape (n,)
        Moving freely, and smoothly enough for the turn to be known.
    untouched : ndarray of bool, shape (n,)
        The force is the tool's alone; a high-pass remembers these, abrupt or not.
    force_noise : Autocovariance
        Of blocks of the force [N].
    """

    length: float
    gravity: Array
    force: Array
    rotation: Array
    still: NDArray[np.intp]
    free: NDArray[np.bool_]
    untouched: NDArray[np.bool_]
    force_noise: Autocovariance


class ToolPart(NamedTuple):
    """Mass [kg], force bias (3,) [N], centre of mass (3,) [m] and their covariance (7, 7)."""

    mass: float
    force_bias: Array
    com: Array
    covariance: Array

    @property
    def vector(self) -> Array:
        """Shape (7,)."""
        return np.concatenate([[self.mass], self.force_bias, self.com])


class _Layout:
    """Which unknowns are estimated, and where they stand: V0, M, delay, lever, decay, cutoff."""

    def __init__(self, lever: bool, ac: bool, cutoff: bool) -> None:
        self.size = 13
        self.lever = self._take(3 if lever else 0)
        self.decay = self._take(3 if ac else 0)
        self.cutoff = self._take(1 if cutoff else 0)

    def _take(self, n: int) -> slice:
        self.size += n
        return slice(self.size - n, self.size)


class AccelerometerModel:
    """
    Residuals, their derivatives and the score, all by block.

    Unknowns are V0, M row by row, the delay, then as the recording wants them: the lever from
    the centre of mass to the accelerometer, and for an AC-coupled one the decay of its filter's
    initial state [V] and the corner. Methods take them as one vector ``theta``, and mass, force
    bias and centre of mass as ``tool``.

    Parameters
    ----------
    volts : callable
        Block means of the readings, shape (n, 3), the blocks shifted by a delay [s].
    coupling : str
        ``dc`` or ``ac``.
    cutoff : float or None
        Corner of the high-pass where known [Hz].
    place : ndarray, shape (3,), or None
        Of the accelerometer where known [m].
    """

    def __init__(self, motion: MotionBlocks, volts: Callable[[float], Array], tool: ToolPart,
                 coupling: str, cutoff: float | None, place: Array | None) -> None:
        self.motion, self.volts, self.tool = motion, volts, tool
        self.place, self.ac = place, coupling == 'ac'
        self.known_cutoff = cutoff
        at_rest = volts(0.0)
        self.use = (motion.free & np.isfinite(motion.force).all(1)) | (motion.still >= 0)
        self.use &= np.isfinite(at_rest).all(1)
        self.moving = self.use & (motion.still < 0)
        self.by_force = motion.untouched & np.isfinite(motion.force).all(1) & (motion.still < 0)
        self.lever = place is None and _turned(motion, self.moving)
        self.layout = _Layout(self.lever, self.ac, self.ac and cutoff is None)

    @property
    def tells_delay(self) -> bool:
        """Whether anything moves; at rest the delay stays where it is, at zero."""
        return bool(self.moving.any())

    def specific_force(self, tool: Array, lever: Array) -> Array:
        """Specific force at the accelerometer by force sensor or pose, shape (n, 3) [m/s^2]."""
        m = self.motion
        f = np.where(self.by_force[:, None], (tool[1:4] - m.force) / tool[0], -m.gravity)
        if self.place is not None:
            lever = self.place - tool[4:7]
        return np.asarray(f + np.einsum('nij,j->ni', m.rotation, lever))

    def split(self, theta: Array) -> tuple[Array, Array, float, Array, Array, float]:
        """Return the unknowns by name: V0, M, delay, lever, decay, cutoff."""
        layout = self.layout
        cutoff = theta[layout.cutoff]
        return (theta[:3], theta[3:12].reshape(3, 3), float(theta[12]),
                theta[layout.lever] if self.lever else np.zeros(3), theta[layout.decay],
                float(cutoff[0]) if len(cutoff) else (self.known_cutoff or DEFAULT_CUTOFF))

    def high_passed(self, specific_force: Array, cutoff: float) -> Array:
        """Output of the high-pass, starting from state 0; the input for a sensor that shows DC."""
        if not self.ac:
            return specific_force
        return np.asarray(specific_force - lowpassed(specific_force, self.motion.length, cutoff))

    def residuals(self, theta: Array, tool: Array) -> Array:
        """Return volts less model, shape (n, 3); zero in blocks that are not used."""
        offset, matrix, delay, lever, decay, cutoff = self.split(theta)
        model = offset + self.high_passed(self.specific_force(tool, lever), cutoff) @ matrix.T
        if self.ac:
            model = model + np.outer(fading(len(model), self.motion.length, cutoff), decay)
        r = self.volts(delay) - model
        return np.where(self.use[:, None] & np.isfinite(r), r, 0.0)

    def derivatives(self, theta: Array, tool: Array) -> Array:
        """Differentiate the model, as the residuals are weighed by it, shape (n, 3, p)."""
        _, matrix, _, lever, decay, cutoff = self.split(theta)
        layout, n = self.layout, len(self.use)
        specific_force = self.specific_force(tool, lever)
        x = self.high_passed(specific_force, cutoff)
        J = np.zeros((n, 3, layout.size))
        for i in range(3):
            J[:, i, i] = 1
            J[:, i, 3 + 3 * i:6 + 3 * i] = x
        if self.tells_delay:
            J[:, :, 12] = -_slope(x, self.motion.length) @ matrix.T
        if self.lever:
            by_lever = smoothed(self.high_passed(self.motion.rotation, cutoff))
            J[:, :, layout.lever] = matrix @ by_lever
        if self.ac:
            J[:, :, layout.decay] = (fading(n, self.motion.length, cutoff)[:, None, None]
                                  * np.eye(3))
        if layout.cutoff.stop > layout.cutoff.start:
            h = 1e-3 * cutoff
            more, less = (self.high_passed(specific_force, cutoff + e) @ matrix.T
                          + np.outer(fading(n, self.motion.length, cutoff + e), decay)
                          for e in (h, -h))
            J[:, :, layout.cutoff] = ((more - less) / (2 * h))[:, :, None]
        J[~self.use] = 0
        return J

    def weights(self, matrix: Array, noise: Array) -> Array:
        """Invert the covariance of each block's residual, shape (n, 3, 3)."""
        still = np.linalg.inv(noise)
        moving = np.linalg.inv(noise + matrix @ self.force_noise @ matrix.T)
        return np.asarray(np.where(self.moving[:, None, None], moving, still))

    @property
    def force_noise(self) -> Array:
        """Variance of a block of f_c, shape (3, 3)."""
        return np.asarray(self.motion.force_noise.covariance / self.tool.mass**2)

    def score(self, theta: Array, tool: Array, weight: Array) -> Array:
        """Weigh the residuals by the derivatives, freed of what noise in f_c adds."""
        J = self.derivatives(theta, tool)
        weighted = weight @ self.residuals(theta, tool)[:, :, None]
        g = np.tensordot(J, weighted[:, :, 0], ((0, 1), (0, 1)))
        matrix = theta[3:12].reshape(3, 3)
        if self.tells_delay:
            g[3:12] += (weight[self.moving].sum(axis=0) @ matrix @ self.force_noise).ravel()
        return np.asarray(g)

    def slope(self, theta: Array, tool: Array, weight: Array) -> Array:
        """Differentiate the score, residuals taken for zero."""
        J = self.derivatives(theta, tool)
        true, h = J.copy(), 1e-4
        if self.tells_delay:
            shifted = (self.volts(theta[12] - h) - self.volts(theta[12] + h)) / (2 * h)
            true[:, :, 12] = np.where(np.isfinite(shifted) & self.use[:, None], shifted, 0.0)
        g = -np.tensordot(J, weight @ true, ((0, 1), (0, 1)))
        if self.tells_delay:
            g[3:12, 3:12] += np.kron(weight[self.moving].sum(axis=0), self.force_noise)
        else:
            g[12, 12] = -1.0
        return np.asarray(g)


def _slope(x: Array, length: float) -> Array:
    """Differentiate over two blocks each way, free of the noise of the block itself."""
    out = np.zeros_like(x)
    out[2:-2] = (x[4:] - x[:-4]) / (4 * length)
    return out


def _turned(motion: MotionBlocks, moving: NDArray[np.bool_]) -> bool:
    """Whether the robot turned enough to tell a lever of centimetres, whatever its direction."""
    rows = smoothed(motion.rotation)[moving].reshape(-1, 3)
    return len(rows) > 60 and float(np.linalg.svd(rows, compute_uv=False)[-1]) > _TURNED


def lowpassed(f: Array, length: float, cutoff: float) -> Array:
    """
    Block means of what a first-order high-pass takes off, starting from state 0.

    The output of the high-pass is f minus this, but for its unknown initial state w0, which adds
    ``w0 * fading(...)``; within a block f is taken as constant.

    Parameters
    ----------
    f : ndarray, shape (n, ...)
        Block means of consecutive blocks.
    length : float
        Of the blocks [s].
    cutoff : float
        Corner [Hz].

    Returns
    -------
    ndarray, shape (n, ...)
    """
    from scipy.signal import lfilter  # takes a second, which a node does not start with

    x = 2 * np.pi * cutoff * length
    keep = np.exp(-x)
    at_start = lfilter([0.0, 1 - keep], [1.0, -keep], f, axis=0)
    return np.asarray(f + (at_start - f) * (1 - keep) / x)


def fading(n: int, length: float, cutoff: float) -> Array:
    """
    Block means of exp(-2 pi cutoff t), t from the start of the first block.

    Parameters
    ----------
    length, cutoff : float
        [s], [Hz]

    Returns
    -------
    ndarray, shape (n,)
    """
    x = 2 * np.pi * cutoff * length
    return np.asarray(np.exp(-x * np.arange(n)) * (1 - np.exp(-x)) / x)


def without_fading(stream: Stream, poses: list[StaticPose], cutoff: float) -> Stream:
    """
    Take off what fades in each static pose, once it is fitted as a * exp(-2 pi cutoff t).

    Parameters
    ----------
    stream : Stream
        Behind the high-pass.
    cutoff : float
        Corner [Hz].

    Returns
    -------
    Stream
        The same outside the poses.
    """
    values = stream.values.copy()
    for pose in poses:
        i, j = np.searchsorted(stream.t, [pose.start, pose.end])
        shape = np.exp(-2 * np.pi * cutoff * (stream.t[i:j] - pose.start))
        x = np.column_stack([shape, np.ones_like(shape)])
        good = np.isfinite(values[i:j]).all(axis=1)
        size = np.linalg.lstsq(x[good], values[i:j][good], rcond=None)[0][0]
        values[i:j] -= np.outer(shape, size)
    return replace(stream, values=values)
