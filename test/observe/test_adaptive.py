"""Filter kalman in more noise than was calibrated: it follows, and takes no contact for noise."""

from dataclasses import replace

from forcecal_ros.core.streams import Stream
from forcecal_ros.observe import ObserverSettings, replay, Status
from forcecal_ros.observe.design import design
from forcecal_ros.observe.live import LiveObserver
import numpy as np
from observing import answers_of, calibration, GAIN, MASS, push, record, Swing, VOLTS_NOISE
import pytest

FOLLOWED = 2.0
"""Within this the gain is to follow [s]."""

START, END = 2.0, 5.0
SWING = Swing(turn=0.2, place=(0.05, 0.0, 0.0))
READING = np.hypot([0.25] * 3 + [0.02] * 3, MASS * VOLTS_NOISE / abs(GAIN)
                   * np.array([1.0] * 3 + [0.14] * 3))
"""Noise of u - m a [N, N m]."""


def noisier(recording, factor, colour=lambda noise: noise):
    """Multiply the variance of u - m a by a factor between START and END."""
    t, values = recording.wrench.t, recording.wrench.values.copy()
    on = (t >= START) & (t < END)
    more = colour(np.random.default_rng(9).normal(size=(on.sum(), 6)))
    values[on] += np.sqrt(factor - 1) * more * READING
    return replace(recording, wrench=Stream(t, values))


@pytest.fixture(scope='module')
def pressed():
    return record(8.0, SWING, contact=push(0, 20.0, 3.0), seed=1)


def noisy_from_to(estimate):
    on = estimate.t[estimate.status & Status.NOISY > 0]
    return on[0], on[-1]


def test_the_gain_follows_ten_times_the_noise_and_back_and_says_so(pressed):
    estimate = replay(noisier(pressed, 10.0), calibration())
    begin, end = noisy_from_to(estimate)
    assert START < begin < START + FOLLOWED and END < end < END + FOLLOWED
    fixed = replay(noisier(pressed, 10.0), calibration(), ObserverSettings(adaptive=False))
    assert not (fixed.status & Status.NOISY).any()
    part = (estimate.t > 3.5) & (estimate.t < END)
    ours, theirs = (one.contact[part, 0].std() for one in (estimate, fixed))
    # that of a first-order filter goes as its corner's root: 10^-1/4
    assert ours / theirs == pytest.approx(10 ** -0.25, rel=0.15)


def test_a_contact_force_is_told_whole_in_noise(pressed):
    estimate = replay(noisier(pressed, 10.0), calibration())
    part = (estimate.t > 4.0) & (estimate.t < END)
    error = estimate.contact[part, 0].mean() - 20.0
    assert abs(error) < 4 * np.sqrt(10.0) * READING[0] / np.sqrt(part.sum())


def test_contact_is_not_noise(pressed):
    def hits(t):
        force = np.zeros((len(t), 3))
        force[:, 2] = 30.0 * (np.sin(2 * np.pi * 2.0 * t) > 0.5) + 10 * np.sin(2 * np.pi * 4 * t)
        return force

    for recording in (pressed, record(6.0, SWING, contact=hits, seed=2)):
        estimate = replay(recording, calibration())
        fixed = replay(recording, calibration(), ObserverSettings(adaptive=False))
        assert not (estimate.status & Status.NOISY).any()
        np.testing.assert_array_equal(estimate.contact, fixed.contact)


def test_a_spindle_is_noise():
    def spindle(noise):
        t = np.arange(len(noise)) / 1000.0
        return np.sqrt(2) * np.sin(2 * np.pi * 120.0 * t)[:, np.newaxis] * np.ones(6)

    estimate = replay(noisier(record(7.0, SWING, seed=3), 10.0, spindle), calibration())
    begin, end = noisy_from_to(estimate)
    assert START < begin < START + FOLLOWED and END < end < END + FOLLOWED


def test_node_and_replay_hear_the_same(pressed):
    recording = noisier(pressed, 10.0)
    live = LiveObserver(0.5, 0.5)
    live.take_over(design(calibration()))
    samples = answers_of(live, recording, 3.0)
    expected = replay(recording, calibration())
    n = len(samples)
    assert n > 2900 and live.bandwidth < 0.5 * design(calibration()).rate / (2 * np.pi)
    np.testing.assert_allclose([one.contact for one in samples], expected.contact[:n], atol=1e-9)
    assert [one.status for one in samples] == expected.status[:n].tolist()


def test_where_the_bandwidth_is_said_or_no_noise_is_known_nothing_adapts():
    assert design(calibration()).adaptive
    assert not design(calibration(), ObserverSettings(bandwidth_hz=20.0)).adaptive
    assert not design(replace(calibration(), noise=None)).adaptive
