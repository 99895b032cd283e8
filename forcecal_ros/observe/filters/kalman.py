"""Filter ``kalman``: the stationary Kalman filter of a contact wrench that wanders."""

from math import exp, inf

from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.memory import Memory, STOPPED
from forcecal_ros.observe.filters.noise_level import LONGEST, rate_at, updated
from forcecal_ros.observe.sample import NO_WRENCH, Wrench
from forcecal_ros.observe.status import RESTARTED
from forcecal_ros.observe.tracking import ZERO
from forcecal_ros.observe.unload import Unloaded


def innovation(memory: Memory, reading: Unloaded, model: Model) -> tuple[int, Wrench]:
    """Return status and what the last estimate did not lead to expect; zero after a pause."""
    dt = reading.t - memory.t
    if dt > model.pause:
        return (reading.status | RESTARTED if memory.t > -inf else reading.status), NO_WRENCH
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
    dt = reading.t - memory.t
    if dt > model.pause:
        return Memory(reading.t, reading.measured, STOPPED, ZERO, memory.noise)
    c0, c1, c2, c3, c4, c5 = memory.contact
    e0, e1, e2, e3, e4, e5 = e
    noise, rate = memory.noise, model.rate
    if model.adaptive and dt <= LONGEST:
        noise = updated(noise, dt, (e0, e1, e2), model.innovation_scale)
        rate = rate_at(noise.level, rate, model.slowest)
    k = 1 - exp(-rate * dt)
    return Memory(
        reading.t, (c0 + k * e0, c1 + k * e1, c2 + k * e2, c3 + k * e3, c4 + k * e4, c5 + k * e5),
        STOPPED, ZERO, noise)
