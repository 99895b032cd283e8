"""An arm that never rests, against a calibration: noise of its poses is in the residual, too."""

from dataclasses import replace

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.diagnose.sources.rig import ToolSource
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rigid_tool import rigid_tool_of_calibration
from longer import first
from moving_arm import BIAS, MASS, moving
import numpy as np
import pytest
from wrong_recordings import recording_of


@pytest.fixture(scope='module')
def tool():
    calibration = identify(recording_of(moving(200)))
    return rigid_tool_of_calibration(calibration, load_rig('rigid_tool.yaml'))


def found(tool, recorded):
    return ToolSource(tool).diagnose(recording_of(recorded))


def late(seconds, seed=201):
    one = moving(seed, seconds=seconds)
    return replace(one, stamp=one.stamp + 8_000_000)


def coupled(seconds, seed=201):
    one = moving(seed, seconds=seconds)
    wrench = one.wrench.copy()
    wrench[:, 0] += 0.04 * (wrench[:, 2] - BIAS[2])
    return replace(one, wrench=wrench)


@pytest.mark.parametrize('seed', first(range(201, 209)))
def test_the_ends_of_a_recording_that_moves_there_show_nothing(tool, seed):
    diagnosis = found(tool, moving(seed, seconds=25.0)).diagnosis
    assert diagnosis.verdict == 'no_gap' and not diagnosis.effects


SINGLE = {'tool_mass': ('change', 0.05, lambda s: moving(201, 1.05 * MASS, seconds=s)),
          'wrench_crosstalk': ('fx_of_fz', 0.04, coupled)}


@pytest.mark.parametrize('name', first(SINGLE))
@pytest.mark.parametrize('seconds', first([10.0, 285.0]))
def test_an_effect_is_named_and_gains_stay_however_long_the_recording(tool, name, seconds):
    parameter, size, make = SINGLE[name]
    outcome = found(tool, make(seconds)).outcome
    effect, = outcome.diagnosis.effects
    assert effect.name == name and effect.probability > 0.9
    value = effect.parameters[parameter]
    # the calibration's own error of the mass is 0.1 %
    assert abs(value.value - size) < 3.0 * np.hypot(value.std, 0.001)
    moved = outcome.recalibrations
    assert max(abs(moved[f'wrench.gain.{i}'][0]) for i in range(6)) < tool.spreads.wrench_gain


@pytest.mark.parametrize('seconds', first([10.0, 285.0]))
def test_a_slow_motion_tells_a_delay_from_no_filter(tool, seconds):
    """Below 1 Hz both are one delay; what a filter does to noise of poses decides nothing."""
    likely = dict(found(tool, late(seconds)).diagnosis.candidates)
    assert set(likely) == {'wrench_delay', 'wrench_lowpass'}
    assert min(likely.values()) > 0.2
