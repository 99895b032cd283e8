"""A tool that cannot be is refused with the reason."""

from dataclasses import replace

from forcecal_ros.calibrate.quality import refuse_unnatural, unnatural_inertia
from forcecal_ros.calibrate.tool import refuse_negative
from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import DataError
import numpy as np
import pytest
from whole_calibration import whole_calibration

WHOLE = whole_calibration()


def inertia(*moments, std=1e-3):
    Q, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    return Estimate(Q @ np.diag(moments) @ Q.T, std, 'kg m^2')


@pytest.mark.parametrize('moments', [(0.1, 0.2, 0.25), (0.1, 0.1, 0.2), (0.0, 0.1, 0.1),
                                     (-0.002, 0.1, 0.1)])
def test_bodies_rods_and_plates_pass(moments):
    assert not unnatural_inertia(replace(WHOLE, inertia=inertia(*moments)))
    assert not unnatural_inertia(replace(WHOLE, inertia=None))


@pytest.mark.parametrize('moments', [(-0.1, 0.2, 0.2), (0.05, 0.05, 0.2), (1e3, 1e3, 1e3)])
def test_the_inertia_of_no_body_is_named(moments):
    assert 'are impossible for' in unnatural_inertia(replace(WHOLE, inertia=inertia(*moments)))


def test_a_load_a_metre_away_is_refused():
    with pytest.raises(DataError, match='centre of mass is 1.2 m away'):
        refuse_unnatural(replace(WHOLE, com=Estimate([0.0, 0.0, 1.2], 1e-3, 'm')))


@pytest.mark.parametrize('mass', [0.0, -0.57, np.nan])
def test_no_mass_is_refused(mass):
    with pytest.raises(DataError, match='the estimated mass is'):
        refuse_negative(mass)
