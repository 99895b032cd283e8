"""A sound rig is neither refused nor stopped because the computer is late."""

from dataclasses import replace

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.streams import Stream
from forcecal_ros.sim.rig.file import load_rig, true_calibration
from late_computer import Conditions, run
import numpy as np
import pytest

pytestmark = pytest.mark.long


@pytest.mark.parametrize('conditions', [
    pytest.param(Conditions(latency=0.5, jitter=3e-3), id='late by half a second'),
    pytest.param(Conditions(stall=0.5, load=1), id='held back'),
    pytest.param(Conditions(latency=0.1, pause=0.05, jitter=1e-3, load=2),
                 id='pauses under load')])
def test_a_sound_rig_is_calibrated_as_well_on_a_computer_that_is_late(conditions):
    outcome = run(7, conditions)
    assert not outcome.aborted
    found = identify(outcome.recording, IdentificationSettings())
    truth = true_calibration(load_rig(), 'acc1')
    off = [(found.mass.value - truth['mass']) / found.mass.std,
           *((found.com.value - truth['com']) / found.com.std),
           *((found.wrench_bias.value - truth['wrench_bias']) / found.wrench_bias.std)]
    assert (np.abs(off) < 4).all(), off
    assert not [line for line in found.quality['warnings'] if 'suspect' in line]


def test_a_robot_that_leaves_is_not_taken_for_one_that_stands_while_the_tool_rings():
    found = identify(run(92).recording, IdentificationSettings())
    assert found.tool is not None
    assert not found.quality['warnings']


@pytest.mark.parametrize('seed', [98, 133, 137])
def test_what_a_touch_would_look_like_is_none_where_samples_are_late_or_lost(seed):
    settings = IdentificationSettings(coupling='ac' if seed % 4 == 3 else 'dc')
    found = identify(run(seed, accelerometer='acc2' if seed % 4 == 3 else 'acc1').recording,
                     settings)
    assert not found.quality['warnings']


def with_gaps(stream, t0):
    """Leave out 60 ms from each of three instants on, in motion [s]."""
    keep = np.ones(len(stream.t), dtype=bool)
    for t in t0:
        keep &= (stream.t < t) | (stream.t > t + 0.06)
    return Stream(stream.t[keep], stream.values[keep])


def test_a_high_pass_remembers_motion_through_gaps_of_both_sensors():
    outcome = run(323, Conditions(stall=0.43, jitter=3e-3, load=2), accelerometer='acc2')
    assert not outcome.aborted
    whole, truth = outcome.recording, true_calibration(load_rig(), 'acc2')
    moving = [p.start for p in whole.phases if p.name == 'move'][:3]
    cut = replace(whole, accelerometer=with_gaps(whole.accelerometer, moving))
    blind = replace(whole, wrench=with_gaps(whole.wrench, moving))
    for recording in (cut, blind):
        found = identify(recording, IdentificationSettings(coupling='ac'))
        gain, warnings = found.accelerometer.gain, found.quality['warnings']
        off = (gain.value - truth['accelerometer.gain']) / gain.std
        assert (np.abs(off) < 4).all(), off
        assert not warnings
