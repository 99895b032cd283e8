"""What filter kalman promises: the error it has, innovations as large as it expects."""

from dataclasses import replace

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.io.calibration_file import dump, parse
from forcecal_ros.observe import design, ObserverSettings, replay, with_kalman_gains
from forcecal_ros.observe.design import accuracy
from longer import first
import numpy as np
from observing import calibration
import pytest
from wandering import known, wandering


def settings_for(noise):
    usual = ObserverSettings()
    return ObserverSettings(pose_position_std=noise * usual.pose_position_std,
                            pose_rotation_std=noise * usual.pose_rotation_std)


@pytest.mark.parametrize('noise, name', first([
    (1.0, 'acc1'), (10.0, 'acc2'), (0.1, 'acc1'), (0.1, 'acc2'), (1.0, 'acc2'), (10.0, 'acc1')],
    2))
def test_innovations_and_errors_are_as_large_as_promised(noise, name):
    one, settings = known(noise, name), settings_for(noise)
    promised = accuracy(one, design(one, settings), settings)
    recording, truth = wandering(noise, name, promised, seed=1, seconds=5.0)
    estimate = replay(recording, one, settings)
    late = estimate.t > 3.0
    e = estimate.innovation[late]
    nis = np.einsum('ni,ij,nj->n', e, np.linalg.inv(promised.innovation), e).mean() / 6
    # the motion itself, which no covariance knows of, adds a hundredth
    assert nis == pytest.approx(1.0, abs=0.01 + 4 * np.sqrt(2 / e.size))
    error = (estimate.contact - truth)[late]
    independent = 2 * np.pi * promised.bandwidth * (late.sum() * 1e-3)
    ratio = np.sqrt(np.mean((error / promised.std) ** 2))
    assert ratio == pytest.approx(1.0, abs=0.03 + 4 / np.sqrt(2 * 6 * independent))


def test_without_noise_or_with_another_filter_nothing_is_promised():
    one = calibration()
    assert accuracy(replace(one, noise=None), design(replace(one, noise=None))) is None
    newton = ObserverSettings('newton')
    assert accuracy(one, design(one, newton), newton) is None


def test_coloured_noise_makes_the_filter_slower():
    """Four times the density at low frequencies, samples as noisy: half the bandwidth."""
    one = calibration()
    noise = one.noise
    slow = replace(one, noise=replace(
        noise, wrench_density=Estimate(4e-3 * noise.wrench.value, np.nan, '(N, N m)^2 s'),
        specific_force_density=Estimate(
            4e-3 * noise.specific_force.value, np.nan, '(m/s^2)^2 s')))
    assert design(slow).rate == pytest.approx(design(one).rate / 2, rel=0.01)
    promised = accuracy(slow, design(slow))
    assert promised.std[0] == pytest.approx(
        2 ** 0.5 * accuracy(one, design(one)).std[0], rel=0.02)


def test_the_observer_runs_as_the_calibration_was_told():
    told = with_kalman_gains(calibration(), ObserverSettings(
        contact_walk=5.0, bandwidth_min_hz=1.0, bandwidth_max_hz=40.0))
    again = parse(dump(told), 'calibration.yaml')
    assert design(again).rate == pytest.approx(2 * np.pi * 40.0)
    assert design(again).rate == pytest.approx(
        2 * np.pi * float(again.observer.kalman['bandwidth']))
    slower = design(again, ObserverSettings(bandwidth_max_hz=20.0))
    assert slower.rate == pytest.approx(2 * np.pi * 20.0)
