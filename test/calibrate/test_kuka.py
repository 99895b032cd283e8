"""A real arm: 24 static poses of one sample each, results as a plain fit of others gives them."""

from dataclasses import replace

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from kuka import GRAVITY, static_recording
import numpy as np
import pytest


@pytest.fixture(scope='module')
def recording(kuka_data):
    return static_recording(kuka_data)


@pytest.fixture(scope='module')
def found(recording):
    return identify(recording, IdentificationSettings(gravity=GRAVITY))


def test_mass_centre_and_biases_are_those_of_the_plain_fit_and_raise_no_alarm(found):
    assert not [line for line in found.quality['warnings'] if 'suspect' in line]
    assert float(found.mass) == pytest.approx(0.9323, abs=5e-4)
    np.testing.assert_allclose(found.com.value, [0.0003, 0.0001, 0.0439], atol=1e-4)
    np.testing.assert_allclose(found.wrench_bias.value[:3], [9.077, -1.018, 9.985], atol=1e-3)
    np.testing.assert_allclose(found.wrench_bias.value[3:], [0.4325, -0.6916, -0.1570], atol=1e-4)
    residual = np.array([pose['residual'] for pose in found.quality['poses']])[:, :3]
    np.testing.assert_allclose(np.sqrt((residual**2).mean(axis=0)), [0.131, 0.047, 0.057],
                               atol=1e-3)


def test_with_another_gravity_the_mass_is_another(recording):
    found = identify(recording)
    assert float(found.mass) == pytest.approx(0.9337, abs=2e-4)


@pytest.mark.long
def test_standard_errors_match_what_leaving_poses_out_does(recording, found):
    n = len(recording.wrench)
    values = np.array([
        np.concatenate([[float(c.mass)], c.com.value, c.wrench_bias.value])
        for c in (identify(replace(
            recording, wrench=recording.wrench.rows(np.arange(n) != i),
            accelerometer=recording.accelerometer.rows(np.arange(n) != i),
            phases=(*recording.phases[:i], *recording.phases[i + 1:])),
            IdentificationSettings(gravity=GRAVITY)) for i in range(n))])
    jackknife = np.sqrt((n - 1) / n * ((values - values.mean(axis=0))**2).sum(axis=0))
    std = np.concatenate([[float(found.mass.std)], found.com.std, found.wrench_bias.std])
    assert ((jackknife / std > 0.4) & (jackknife / std < 2.0)).all()


def test_the_accelerometers_axes_offset_and_gain_are_found(found):
    a = found.accelerometer
    P = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(a.map.value, P, atol=0.02)
    assert np.linalg.det(a.map.value) > 0
    np.testing.assert_allclose(a.offset.value / GRAVITY, [-0.004, 0.009, 0.077], atol=5e-4)
    np.testing.assert_allclose(a.gain.value, [1.0005, 0.9991, 1.0039], atol=1e-4)
    words = ' '.join(found.quality['notes'])
    assert 'x of the accelerometer points along -z of ft_sensor' in words
    assert 'right-handed with positive gains' in words


def test_what_single_samples_cannot_tell_is_not_claimed(found):
    assert found.tool is None and found.noise is None and found.observer is None
    assert found.inertia is None
    assert np.isnan(found.accelerometer.delay.std)
