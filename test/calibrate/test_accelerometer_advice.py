"""An accelerometer that drifts at rest is AC-coupled; the mount of another is loose."""

from types import SimpleNamespace

from forcecal_ros.calibrate.findings import _accelerometer_remedy
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.streams import Stream
import numpy as np
import pytest


@pytest.mark.parametrize('decays, coupling, said', [
    (True, 'dc', 'calibrate with --coupling ac'), (False, 'dc', 'tighten its mount'),
    (True, 'ac', 'tighten its mount')])
def test_the_advice_follows_from_what_the_readings_do_at_rest(decays, coupling, said):
    t = np.arange(0.0, 4.0, 0.001)
    values = np.random.default_rng(1).normal(0.0, 0.02, (len(t), 3))
    if decays:
        values += 3.0 * np.exp(-(t % 2.0) / 1.5)[:, None]
    stages = SimpleNamespace(
        recording=SimpleNamespace(accelerometer=Stream(t, values, 'accelerometer')),
        poses=[SimpleNamespace(start=0.1, end=1.9), SimpleNamespace(start=2.1, end=3.9)])
    settings = IdentificationSettings(coupling=coupling)
    assert said in _accelerometer_remedy(stages, settings)
