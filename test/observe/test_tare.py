"""Taring takes the tool's weight off first, and is refused when the tool moves or touches."""

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import DataError
from forcecal_ros.observe import design, noise_levels, Status, tare, with_bias
from forcecal_ros.observe.playback import run
import numpy as np
from observing import BIAS, calibration, FORCE_NOISE, push, record, Swing
import pytest
from scipy.spatial.transform import Rotation

LEVELS = noise_levels(calibration().noise)
MODEL = design(calibration())
UNTARED = design(calibration(wrench_bias=Estimate(np.zeros(6), 0.0, 'N, N m')))


def window(recording, start, end, model=MODEL):
    _, samples = run(recording, model)
    return [s for s in samples if start <= s.t < end]


@pytest.mark.parametrize('euler', [(np.pi, 0.0, 0.0), (2.0, 0.5, 1.0), (0.0, np.pi / 2, 0.0)])
def test_tare_finds_the_bias_in_any_orientation(euler):
    home = Rotation.from_euler('xyz', euler).as_matrix()
    found = tare(window(record(2.5, home=home), 0.5, 2.4, UNTARED), UNTARED, LEVELS)
    # the accelerometer's offset and the pose decide what is weight: 0.02 N or so
    assert np.abs(found.bias - BIAS)[:3].max() < 0.05
    assert np.abs(found.bias - BIAS)[3:].max() < 0.01
    assert found.shift == pytest.approx(found.bias)
    assert found.std[0] < 5 * FORCE_NOISE / np.sqrt(1900)


def test_after_taring_the_contact_wrench_is_zero():
    recording = record(2.5)
    found = tare(window(recording, 0.5, 2.4, UNTARED), UNTARED, LEVELS)
    after = np.array([s.contact for s in window(recording, 0.5, 2.4,
                                                with_bias(UNTARED, found.bias))])
    assert np.abs(after.mean(axis=0)[:3]).max() < 0.02


@pytest.mark.parametrize('swing', [
    Swing(place=(0.01, 0.0, 0.0), place_hz=1.0), Swing(turn=0.05, turn_hz=0.3, axis=(0., 1., 0.))])
def test_tare_is_refused_in_motion(swing):
    with pytest.raises(DataError, match='moves'):
        tare(window(record(2.5, swing), 1.2, 2.4), MODEL, LEVELS)


def test_tare_is_refused_while_a_contact_begins():
    with pytest.raises(DataError, match='touches something.*force.x'):
        tare(window(record(2.5, contact=push(0, 5.0, 1.5)), 0.5, 2.4), MODEL, LEVELS)


def test_tare_wants_long_enough_a_window_of_valid_samples():
    with pytest.raises(DataError, match='0.5 s at rest'):
        tare([], MODEL, LEVELS)
    with pytest.raises(DataError, match='0.5 s at rest'):
        tare(window(record(1.0), 0.5, 0.8), MODEL, LEVELS)
    blind = record(1.5, without=('pose', 'accelerometer'))
    with pytest.raises(DataError, match='weight unknown'):
        tare(window(blind, 0.5, 1.4), MODEL, LEVELS)


def test_single_samples_that_are_not_valid_do_not_count():
    samples = window(record(1.5), 0.9, 1.45)
    wanted = tare(samples, MODEL, LEVELS)

    def with_invalid(share):
        return [s._replace(status=Status.BAD_WRENCH, measured=(99.0,) * 6)
                if i % round(1 / share) == 0 else s for i, s in enumerate(samples)]

    found = tare(with_invalid(0.05), MODEL, LEVELS)
    assert np.abs(found.bias - wanted.bias).max() < 0.02
    with pytest.raises(DataError, match='of 550 samples are not valid: the wrench is no usable'):
        tare(with_invalid(0.2), MODEL, LEVELS)
