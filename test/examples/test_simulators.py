"""The examples of third-party simulators: a payload that is off is named."""

from pathlib import Path

import forcecal_ros as fc
from forcecal_ros.sim.samples import HEAVIER, recorded
from forcecal_ros.sim.third_party import third_party
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
NAMES = [('drake_arm', 'pydrake')]


@pytest.mark.parametrize('name', [path.stem for path in EXAMPLES.glob('*_arm.py')])
def test_an_example_has_at_most_60_lines(name):
    assert name in dict(NAMES)
    assert len((EXAMPLES / f'{name}.py').read_text().splitlines()) <= 60


@pytest.mark.long
@pytest.mark.parametrize(('name', 'module'), NAMES)
def test_a_heavier_payload_is_named(name, module, monkeypatch):
    pytest.importorskip(module, reason=f'requires {module}, which is not installed')
    monkeypatch.syspath_prepend(EXAMPLES)
    arm = third_party(name, __import__(name).make())
    gap = fc.diagnose(recorded(arm, HEAVIER, 1), against=arm)
    assert gap.to_dict()['verdict'] == 'identified'
    mass, = (effect for effect in gap.value.diagnosis.effects)
    value, = mass.parameters.values()
    assert mass.name == 'body_mass[gripper]'
    assert abs(value.value - 1.05 * 1.2) < 3.0 * value.std
