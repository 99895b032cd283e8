"""From what the accelerometer sends to specific force and its integral, sample by sample."""

from math import inf

from forcecal_ros.observe.design import Model
from forcecal_ros.observe.status import saturated
from forcecal_ros.observe.tracking import Vector

Sample = tuple[float, float, float, float, float, float, float, float, bool]
"""(time, usable from, specific force (3), its integral (3), full)."""

NOTHING_BEFORE: Sample = (-inf, -inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)


def next_sample(before: Sample, highpass: Vector, t: float, reading: Vector, usable: float,
                begins: bool, model: Model) -> tuple[Sample, Vector]:
    """
    Turn one reading into a sample, the integral by trapezoids.

    Parameters
    ----------
    before
        The sample before; not looked at where a run begins.
    highpass : tuple of 3 float
        High-pass state: what an AC-coupled accelerometer had lost of the specific force then
        [m/s^2].
    t : float
        Stamp as sent [s].
    reading : tuple of 3 float
        In the unit of the calibration: volts, or m/s^2.
    usable : float
        From which stamp on it may be used [s].
    begins : bool
        Whether a run begins with it.
    model

    Returns
    -------
    sample : tuple
    highpass : tuple of 3 float
        Its state now [m/s^2].
    """
    o0, o1, o2, a, b, c, d, e, f, g, h, i = model.volts
    full = model.accelerometer_limit[0] < inf and saturated(reading, model.accelerometer_limit)
    v0, v1, v2 = reading[0] - o0, reading[1] - o1, reading[2] - o2
    fx, fy, fz = a * v0 + b * v1 + c * v2, d * v0 + e * v1 + f * v2, g * v0 + h * v1 + i * v2
    tau = t - model.delay
    if begins:
        return (tau, usable, fx, fy, fz, 0.0, 0.0, 0.0, full), (0.0, 0.0, 0.0)
    start, _, px, py, pz, jx, jy, jz, _ = before
    half = (tau - start) / 2
    if model.ac_rate > 0:
        # y is what the high-pass leaves of f: dz/dt = rate y, f = y + z
        zx, zy, zz = highpass
        gain = half * model.ac_rate
        zx += gain * (px - zx + fx)
        zy += gain * (py - zy + fy)
        zz += gain * (pz - zz + fz)
        highpass = (zx, zy, zz)
        fx, fy, fz = fx + zx, fy + zy, fz + zz
    jx, jy, jz = jx + half * (px + fx), jy + half * (py + fy), jz + half * (pz + fz)
    return (tau, usable, fx, fy, fz, jx, jy, jz, full), highpass
