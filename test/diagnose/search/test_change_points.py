"""Effects that begin or end during a recording: named, with their instant, and no others."""

import json
import re
from types import SimpleNamespace

from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.model.gates import Gate
from forcecal_ros.diagnose.model.jacobian import Compact
from forcecal_ros.diagnose.result import Diagnosis, load_diagnosis, to_document
from forcecal_ros.diagnose.search.change_points import _to_a_sample
from forcecal_ros.diagnose.search.posterior import _further_step
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.report.effect_words import phrase
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest
from rig_recordings import bare, FREE, own_recording, switched

ENDED = NamedEffect('tool_mass', {'change': Parameter(0.1, 0.001, '1')}, 0.9,
                    end=4.5, end_ci95=(4.49, 4.52), recording=0)
UNITS = {c.name: c.unit for c in CHANNELS}


@pytest.mark.long
@pytest.mark.parametrize(('effects', 'ends', 'at'), [
    ({'tool_mass': {'change': 0.1}}, True, 4.2),
    # while force.z is loaded: from 2.5 to 4.5 s it is zero, and no instant would show
    ({'wrench_crosstalk': {'fx_of_fz': 0.05}}, False, 5.0)])
def test_an_effect_of_half_a_recording_is_named_with_its_instant(effects, ends, at):
    (name, values), = effects.items()
    before, after = (own_recording(31, FREE, effects if there == ends else None)
                     for there in (True, False))
    diagnosis = RigSource(load_rig()).diagnose(switched(before, after, at)).diagnosis
    assert diagnosis.verdict in ('identified', 'ambiguous')
    effect, = (e for e in to_document(diagnosis, UNITS, None)['effects'] if e['name'] == name)
    word, other = ('to', 'from') if ends else ('from', 'to')
    assert abs(effect[word] - at) < 0.1 and other not in effect
    low, high = effect[f'{word}_ci95']
    assert low - (high - low) <= at <= high + (high - low)
    for key, value in values.items():
        found = effect['parameters'][key]
        assert found['value'] == pytest.approx(value, abs=4.0 * found['std'])
    said = re.search(rf'{name} {"until" if ends else "from"} ([\d.]+)', diagnosis.reason)
    assert float(said[1]) == pytest.approx(effect[word], abs=1e-3)


@pytest.mark.parametrize(('effects', 'where'), [
    ({'tool_mass': {'change': 0.3}}, 0),
    pytest.param({'wrench_bias_drift': {'fz': 0.05, 'ty': 0.002}}, 1, marks=pytest.mark.long),
    pytest.param({'wrench_crosstalk': {'fx_of_fz': 0.03}}, 0, marks=pytest.mark.long)])
def test_an_effect_of_one_of_two_recordings_is_named_with_its_recording(effects, where):
    pair = [bare(own_recording(40 + i, FREE[:5], effects if i == where else None))
            for i in (0, 1)]
    diagnosis = RigSource(load_rig()).diagnose(*pair).diagnosis
    (name, values), = effects.items()
    effect, = to_document(diagnosis, UNITS, None)['effects']
    assert (diagnosis.verdict, effect['name'], effect['recording']) == ('identified', name, where)
    assert 'from' not in effect and 'to' not in effect
    for key, value in values.items():
        found = effect['parameters'][key]
        assert found['value'] == pytest.approx(value, abs=4.0 * found['std'])
    assert f'{name} in the {("first", "second")[where]} recording alone' in diagnosis.reason
    assert diagnosis.gap.closed > 0.8


def test_an_instant_is_written_and_read_again(tmp_path):
    document = to_document(Diagnosis('identified', 'tool_mass', (ENDED,)), UNITS, None)
    effect, = document['effects']
    assert effect['to'] == 4.5 and effect['to_ci95'] == [4.49, 4.52] and effect['recording'] == 0
    assert 'from' not in effect
    file = tmp_path / 'diagnosis.json'
    file.write_text(json.dumps(document))
    assert load_diagnosis(file)[0].effects[0].end == 4.5


def test_where_no_sample_is_near_an_instant_stays_as_coarse_as_its_blocks():
    ended = SimpleNamespace(times=lambda stream: np.arange(0.0, 10.0, 0.008))
    model = SimpleNamespace(datasets=[SimpleNamespace(measured=ended)], noise=[None],
                            level=np.ones(len(CHANNELS)))
    gate = Gate(0, 20.0)
    added = {6: Compact.of(np.array([0.0, 1.0]))}
    assert _to_a_sample(model, gate, added, None, 20.0, 20.1) is None


def test_a_further_step_of_the_bias_takes_the_name_that_is_free():
    assert [_further_step(SimpleNamespace(effects=dict.fromkeys(names))) for names in (
        (), ('wrench_bias_step',), ('wrench_bias_step', 'wrench_bias_step.2'),
        ('wrench_bias_step.2',))] == [
            'wrench_bias_step', 'wrench_bias_step.2', 'wrench_bias_step.3', 'wrench_bias_step']
    step = NamedEffect('wrench_bias_step.2', {}, 0.9)
    assert phrase(step.name) == phrase('wrench_bias_step') != phrase('other')
