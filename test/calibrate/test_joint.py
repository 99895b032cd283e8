"""A tool from motion that never rests."""

from types import SimpleNamespace

from forcecal_ros.calibrate.findings import residuals_of
from forcecal_ros.calibrate.joint import blocks_of, joint_fit
from forcecal_ros.calibrate.residuals import largest_deviation
from forcecal_ros.core.streams import PoseStream, Stream
from moving_arm import COM, MASS, moving
import numpy as np
import pytest
from wrong_recordings import recording_of

GRAVITY = np.array([0.0, 0.0, -9.80665])


@pytest.mark.long
def test_standard_errors_cover():
    """Of twelve seeds with mass, centre of mass and delay, 85 % or more are within 2."""
    z = []
    for seed in range(12):
        one = recording_of(moving(seed))
        fit = joint_fit(one.wrench, blocks_of(one.wrench, one.pose, GRAVITY), has_position=True)
        z += [(fit.theta[0] - MASS) / fit.std[0], *(fit.com - COM) / fit.com_std,
              fit.delay / fit.delay_std]
    assert np.mean(np.abs(z) < 2) > 0.85, np.round(z, 1)


@pytest.mark.parametrize('late', ['wrench', 'pose', 'optidrive'])
def test_rows_beside_a_gap_of_20_ms_are_fitted_and_not_looked_at(late):
    one = recording_of(moving(1))
    streams = {'wrench': one.wrench, 'pose': one.pose,
               'optidrive': Stream(one.wrench.t, np.zeros((len(one.wrench), 1)))}
    whole = streams[late]
    kept = np.abs(whole.t - 10.0) > 0.01
    streams[late] = (PoseStream(whole.t[kept], whole.position[kept], whole.R_base_sensor[kept])
                     if late == 'pose' else Stream(whole.t[kept], whole.values[kept]))
    blocks = blocks_of(streams['wrench'], streams['pose'], GRAVITY,
                       optidrive=streams['optidrive'])
    beside = np.abs(blocks.times - 10.0) < 0.1
    assert beside.any() and not blocks.sampled[beside].any()
    assert blocks.sampled[np.abs(blocks.times - 10.0) > 0.3].all()


def test_what_all_rows_at_rest_scatter_is_no_touch_and_what_one_is_off_is():
    scatter = np.random.default_rng(2).normal(0, 5.0, (300, 1))
    blocks = SimpleNamespace(groups=np.repeat([0, 1], 150), times=np.arange(300.0),
                             sampled=np.ones(300, bool))
    assert largest_deviation(residuals_of(scatter, blocks, np.array([1.0]))).is_chance
    scatter[40] += 100.0
    found = largest_deviation(residuals_of(scatter, blocks, np.array([1.0])))
    assert not found.is_chance and abs(found.time - 40.0) < 2.0
