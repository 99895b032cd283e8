"""What a diagnosis claims, measured again by its own rig file and ``forcecal simulate``."""

from dataclasses import replace
import json
import re

from bag_samples import START_NS
from forcecal_ros.cli.main import main
from forcecal_ros.diagnose.dataset import split_by_phase
from forcecal_ros.diagnose.sources.rig import prepare_commanded
from forcecal_ros.effects import with_effects
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import pytest
from rig_recordings import FREE, own_recording

EFFECTS = {'wrench_delay': {'delay': 0.006}}


@pytest.fixture(scope='module')
def diagnosed(tmp_path_factory):
    folder = tmp_path_factory.mktemp('patched')
    write_recording(folder / 'bag', replace(own_recording(4, FREE[:8], EFFECTS),
                                            start_ns=START_NS))
    # a recording of the simulated rig states its model
    assert main(['diagnose', str(folder / 'bag'), '-o', str(folder / 'out')]) == 0
    assert main(['simulate', '--rig', str(folder / 'out' / 'rig_patched.yaml'), '--commands',
                 str(folder / 'bag'), '--noise-free', '-o', str(folder / 'again')]) == 0
    return folder


def gap_rms(truth: np.ndarray, simulated: np.ndarray, noise: np.ndarray):
    """RMS of the wrench's gap, in its noise."""
    return float(np.sqrt(np.mean(((truth - simulated) / noise) ** 2)))


def test_the_patched_rig_shrinks_the_gap_as_claimed(diagnosed):
    document = json.loads((diagnosed / 'out' / 'diagnosis.json').read_text())
    assert [e['name'] for e in document['effects']] == list(EFFECTS)
    measured = read_recording(diagnosed / 'bag')
    again = read_recording(diagnosed / 'again')
    np.testing.assert_allclose(again.wrench.t, measured.wrench.t, atol=1e-6)
    truth, nominal = (simulate(rig, measured.target, noise=False).wrench.values for rig in (
        with_effects(load_rig(), EFFECTS), load_rig()))
    case = split_by_phase(prepare_commanded(measured, load_rig()))
    held = np.interp(measured.wrench.t, case.times, case.held.astype(float)) > 0.5
    channels = [f'{kind}.{axis}' for kind in ('force', 'torque') for axis in 'xyz']
    claimed = document['gap']['per_channel']
    noise = np.array([claimed[c]['noise_rms'] for c in channels])

    def overall(arm):
        return float(np.sqrt(np.mean([(claimed[c][f'{arm}_rms'] / claimed[c]['noise_rms']) ** 2
                                      for c in channels])))

    shrink = 1.0 - (gap_rms(truth[held], again.wrench.values[held], noise)
                    / gap_rms(truth[held], nominal[held], noise))
    assert shrink == pytest.approx(1.0 - overall('explained') / overall('nominal'), abs=0.01)
    assert shrink > 0.9


def test_the_report_is_one_file_with_all_parts(diagnosed):
    page = (diagnosed / 'out' / 'report.html').read_text()
    assert 'lags the simulated one: delay 6.0' in page
    for part in ('<h2>Where it shows most', '<h2>How far', '<h2>Where else', '<summary>Signals',
                 '<h2>Residuals', '<h2>Spectra', '<h2>Parameters'):
        assert part in page
    words = re.sub('</?span>', '', page)  # that keep a command from breaking within a word
    assert words.index('one (wrench_delay)') < words.index('forcecal diagnose NEW_BAG')
    assert page.count('src="data:image/png;base64,') == 3 + 4  # spectra of four channels
    assert not re.search(r'(?:src|href)="(?!data:|file:)', page)
