"""What a recording is compared with is named, or stated by the recording itself."""

from dataclasses import replace

import forcecal_ros as fc
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import UsageError
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.sources.source import express_in_unit
from forcecal_ros.io.bags import write_recording
import pytest
from rig_recordings import FREE, own_recording


def test_a_recording_that_states_no_model_is_refused_with_the_options(tmp_path, capsys):
    write_recording(tmp_path / 'bag', replace(own_recording(parts=FREE), contact_truth=None))
    out = tmp_path / 'out'
    assert main(['diagnose', str(tmp_path / 'bag'), '-o', str(out)]) == 2
    message = capsys.readouterr().err
    assert 'no model is given to compare it with' in message
    for option in ('--calibration', '--rig FILE', '--rig nominal', '--simulated', '--mujoco',
                   '--simulator'):
        assert option in message
    assert not out.exists()
    with pytest.raises(UsageError, match='pass against=.*nominal') as refused:
        fc.diagnose(tmp_path / 'bag')
    assert '--' not in str(refused.value)


def test_an_imu_is_in_its_own_unit_in_sentence_notes_and_numbers():
    words = 'a part without a name, 0.011 V RMS in accel.x'
    found = express_in_unit('m/s^2', Diagnosis('unknown', words, notes=(words,), effects=(
        NamedEffect('accel_bias', {'x': Parameter(0.1, 0.01, 'V')}, 0.9),)))
    assert found.reason == found.notes[0] == words.replace('V', 'm/s^2')
    assert found.effects[0].parameters['x'].unit == 'm/s^2'
