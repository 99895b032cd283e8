"""Effects among small departures that no library has: named beside them, not because of them."""

from dataclasses import replace
import json

from forcecal_ros.diagnose.dataset import CHANNELS as DIAGNOSED
from forcecal_ros.diagnose.result import to_document
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.replay import Replay
import numpy as np
import pytest
from rig_recordings import commands, FREE, own_recording

EFFECT = {'wrench_crosstalk': {'fx_of_fz': 0.05}}


def recorded(effects, seed=6):
    """Simulate torques that bend with a cable, and a force.y that depends on the place."""
    out = own_recording(seed, FREE, effects)
    down = np.stack([np.interp(out.wrench.t, out.pose.t, c)
                     for c in out.pose.R_base_sensor[:, 2, :].T], axis=1)
    place = np.interp(out.wrench.t, out.pose.t, out.pose.position[:, 0])
    values = out.wrench.values.copy()
    values[:, 1] += 0.15 * np.sin((place - place.mean()) / 0.02)
    values[:, 3:] += 0.02 * down[:, [1, 2, 0]] * np.abs(down)
    return replace(out, contact_truth=None, wrench=replace(out.wrench, values=values))


@pytest.mark.long
def test_an_effect_is_identified_beside_what_no_library_has_and_that_is_said():
    found = RigSource(load_rig()).diagnose(recorded(EFFECT)).diagnosis
    assert found.verdict == 'identified'
    assert [e.name for e in found.effects] == ['wrench_crosstalk']
    value = found.effects[0].parameters['fx_of_fz']
    assert value.value == pytest.approx(0.05, abs=0.01)
    assert 'matches no effect of the library' in found.reason
    document = to_document(found, {c.name: c.unit for c in DIAGNOSED}, None)
    assert json.loads(json.dumps(document, allow_nan=False))['gap']['closed'] > 0.5


@pytest.mark.long
def test_what_no_library_has_is_not_given_a_name_of_the_library():
    found = RigSource(load_rig()).diagnose(recorded({})).diagnosis
    assert found.verdict == 'unknown'
    assert all(p < 0.5 for name, p in found.candidates if name != 'unknown')
    assert 'matches no effect of the library' in found.reason


@pytest.mark.parametrize('rate', [250.0, 750.0])
def test_a_replay_is_the_same_at_any_rate_of_the_sensors(rate):
    target = commands(FREE)[0].rows(slice(500))
    usual = load_rig()
    other = replace(usual, wrench_sensor=replace(usual.wrench_sensor, rate=rate),
                    accelerometer=replace(usual.accelerometer, rate=rate),
                    optidrive=replace(usual.optidrive, rate=rate))
    one, two = (Replay(rig, target, 0.0, 1.9, 'acc1').signals(rig) for rig in (usual, other))
    # other steps are as good as the integration
    assert np.abs(one.wrench - two.wrench).max() < 5e-3
