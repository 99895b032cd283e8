"""The contact wrench: quick, quiet, right in the mean, and free of the tool's own motion."""

from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.io.bags import read_recording
from forcecal_ros.observe import noise_levels, ObserverSettings, replay
from forcecal_ros.observe.bandwidth import contact_bandwidth
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import Simulator
from longer import first
import numpy as np
from observing import calibration, push, record, Swing, TIP
import pytest
from scipy.signal import welch

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2, axis=(0.3, 1.0, 0.2), slide=0.003)


def step_response(axis, settings=ObserverSettings(), swing=SWING):
    """
    Return the estimate of a 20 N step at 1 s, without noise and motion.

    The observer is linear in the wrench, so two runs that differ by the step alone differ by the
    response alone, noise and motion and all.
    """
    on, off = (replay(record(3.0, swing, contact, seed=3), calibration(), settings)
               for contact in (push(axis, 20.0, 1.0), None))
    return on.t, (on.contact - off.contact)[:, axis]


def rise_time(t, y):
    """10-90 % of the final 20 N, interpolated between samples [s]."""
    a, b = (np.interp(x, y[np.argmax(y > 1) - 1:][:300], t[np.argmax(y > 1) - 1:][:300])
            for x in (2.0, 18.0))
    return b - a


@pytest.mark.parametrize('axis', first([0, 2, 1], 2))
def test_step_of_20_newton_rises_within_15_ms_and_hardly_overshoots(axis):
    t, y = step_response(axis)
    assert rise_time(t, y) < 0.015
    assert y.max() < 20.0 * 1.05


def test_static_gain_is_one_within_two_per_mille_in_the_mean_of_two_seconds():
    recording = record(4.2, contact=push(0, 20.0, 2.1), seed=8)
    estimate = replay(recording, calibration())
    tared = estimate.contact[100:2100, 0].mean()
    assert estimate.contact[2200:, 0].mean() - tared == pytest.approx(20.0, rel=0.002)


def power(t, y, low=50.0, high=200.0):
    f, p = welch(y, 1 / np.median(np.diff(t)), nperseg=1024, axis=0)
    return p[(f >= low) & (f <= high)].mean(axis=0)


def test_noise_between_50_and_200_hz_is_10_db_below_that_of_u_minus_m_a():
    estimate = replay(record(8.0, seed=4), calibration())
    decibels = 10 * np.log10(power(estimate.t, estimate.contact)
                             / power(estimate.t, estimate.measured))
    assert (decibels[:3] < -10.0).all()


def test_the_bandwidth_is_what_the_user_says():
    t, y = step_response(0, ObserverSettings(bandwidth_hz=10.0))
    assert rise_time(t, y) == pytest.approx(np.log(9) / (2 * np.pi * 10.0), rel=0.03)


def bandwidth(noise, **choices):
    """Return the bandwidth [Hz] that follows from ``noise`` times the rig's."""
    return contact_bandwidth(
        noise_levels(calibration(noise=noise).noise), 13.0, ObserverSettings(**choices))


def test_the_bandwidth_stays_within_the_limits():
    assert bandwidth(10.0, bandwidth_min_hz=20.0) == 20.0
    assert bandwidth(0.1, bandwidth_max_hz=30.0) == 30.0
    assert bandwidth(1e-3) == 250.0 and bandwidth(1e3) == 2.0
    with pytest.raises(ConfigError, match='bandwidth_min_hz is 30.*at most bandwidth_max_hz, 20'):
        ObserverSettings(bandwidth_min_hz=30.0, bandwidth_max_hz=20.0)


def oscillation(accelerometer):
    """Free oscillation along x on the simulated rig, 12 s, about 27 N RMS."""
    rig = load_rig()
    t = np.arange(0, 8.0, rig.robot.period)
    positions = np.tile(rig.home.position, (len(t), 1))
    positions[:, 0] += 0.012 * np.clip(t - 1, 0, 1) * np.sin(4 * np.pi * (t - 1))
    orientations = np.tile(rig.home.orientation_xyzw, (len(t), 1))
    return Simulator(rig, accelerometer, seed=2).run(positions, orientations)


@pytest.mark.parametrize('coupling, delay', first([
    ('acc1', 0.010), ('acc2', -0.010), ('acc1', 0.0), ('acc1', -0.010), ('acc2', 0.006)], 2))
def test_free_oscillation_is_33_db_below_the_sensor_whatever_the_delay(coupling, delay):
    s = oscillation(coupling)
    model = getattr(load_rig().accelerometer, coupling)
    known = calibration(delay, wash=model.highpass)
    known = replace(known, accelerometer=replace(
        known.accelerometer, gain=Estimate(model.gain, 0.0, 'V/(m/s^2)'),
        offset=Estimate(model.offset, 0.0, 'V')))
    estimate = replay(Recording(
        wrench=Stream(s.wrench_t, s.wrench),
        accelerometer=Stream(s.accelerometer_t + delay, s.volts),
        optidrive=Stream(s.optidrive_t, s.optidrive[:, None]),
        pose=PoseStream(s.pose_t, s.position, s.R_base_sensor)), known)
    swinging = (estimate.t > 3.0) & (estimate.t < 7.9)
    free = estimate.contact[swinging, 0]
    sensor = s.wrench[np.searchsorted(s.wrench_t, estimate.t[swinging]), 0] - 4.0
    assert 20 * np.log10(free.std() / np.sqrt(np.mean(sensor ** 2))) < -33.0


def test_six_axes_are_right_while_the_tool_moves_turns_and_slides_in_contact():
    """Without noise what is left is what a causal pose filter lags behind an angular swing."""
    recording = record(5.0, SWING, push(1, 20.0, 0.0), noise=0.0)
    estimate = replay(recording, calibration())
    error = estimate.contact - recording.contact_truth.values
    assert error[1000:].std(axis=0).max() < 0.05
    load = recording.wrench.values[1000:].std(axis=0)
    assert (error[1000:].std(axis=0)[:3] < 0.005 * load[:3].max()).all()


def test_torque_is_about_the_origin_of_the_sensor():
    estimate = replay(record(3.0, contact=push(1, 20.0), seed=5), calibration())
    torque = np.cross(TIP, [0.0, 20.0, 0.0])
    error = estimate.contact[1000:, 3:].mean(axis=0) - torque
    assert np.abs(error).max() < 5 * 0.05 / np.sqrt(2000)


def test_recorded_rig_of_other_code_agrees_in_six_axes(other_rig):
    """Free motion, then contact at rest; truth and noise by another implementation."""
    recording = read_recording(other_rig / 'bag')
    truth = np.load(other_rig / 'clean.npz')
    estimate = replay(recording, calibration())
    level = np.repeat([0.16, 0.022], 3)
    still = (estimate.t > 1.0) & (estimate.t < 10.5)
    free = estimate.contact[still]
    assert (free.std(axis=0) < level).all()
    assert (np.abs(free.mean(axis=0)) < 5 * level / np.sqrt(len(free) / 20)).all()
    pressed = (estimate.t > 19.0) & (estimate.t < 20.0)
    error = estimate.contact[pressed, :3] - truth['contact_force'][pressed]
    assert np.abs(truth['contact_force'][pressed, 0]).mean() > 50.0
    assert np.abs(error.mean(axis=0)).max() < 0.2
