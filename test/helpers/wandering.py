"""A contact wrench that wanders at random, on a tool that swings: what kalman is made for."""

from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.streams import Stream
from forcecal_ros.observe.settings import CONTACT_WALK
import numpy as np
from observing import calibration, GAIN, OFFSET, record, Swing, VOLTS_NOISE

ACCELEROMETERS = {'acc1': (-0.2937, 0.0), 'acc2': (0.2525, 0.01)}
"""Gain [V/(m/s^2)] and corner of the high-pass [Hz] of those of the nominal rig."""

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.1, axis=(0.3, 1.0, 0.2))


def known(noise, name):
    """Give the calibration of the nominal rig with this accelerometer, ``noise`` times as loud."""
    gain, wash = ACCELEROMETERS[name]
    one = calibration(wash=wash, noise=noise, rigid=True)
    sensor = replace(one.accelerometer, gain=Estimate([gain] * 3, 0.0, 'V/(m/s^2)'))
    variance = (noise * VOLTS_NOISE / gain) ** 2
    return replace(one, accelerometer=sensor, noise=replace(
        one.noise, specific_force=Estimate(variance * np.eye(3), 0.0, '(m/s^2)^2')))


def wandering(noise, name, promised, seed, seconds=10.0):
    """Record it; ``promised`` says how fast the torques wander. Return recording and truth."""
    rng = np.random.default_rng([seed, 7])
    gain, wash = ACCELEROMETERS[name]
    quiet = record(seconds, SWING, seed=seed, noise=noise, wash=wash, without=('optidrive',))
    volts = OFFSET + (quiet.accelerometer.values - OFFSET) * gain / GAIN
    more = noise * VOLTS_NOISE * np.sqrt(1 - (gain / GAIN) ** 2)
    volts += rng.normal(scale=more, size=volts.shape)
    walk = np.r_[[CONTACT_WALK] * 3, promised.walk[3:]]
    wander = np.cumsum(
        rng.normal(size=quiet.wrench.values.shape) * walk * np.sqrt(1e-3), axis=0)
    return replace(
        quiet, wrench=Stream(quiet.wrench.t, quiet.wrench.values + wander),
        accelerometer=Stream(quiet.accelerometer.t, volts)), wander
