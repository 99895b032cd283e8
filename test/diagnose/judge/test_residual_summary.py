"""Spectral lines beside an explained vibration."""

from forcecal_ros.diagnose.judge.residual_summary import _other_lines
from forcecal_ros.diagnose.localise import Line
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.sim.rig.file import load_rig


def test_a_line_beside_that_of_an_explained_vibration_is_its_own():
    beside = Line('force.x', 64.31, 1.0, 5000.0)
    other = Line('force.y', 50.0, 1.0, 60.0)
    p = LinearisedModel(load_rig(None), (), effects={'spindle_vibration': {'frequency': 64.01}})
    lines, notes = _other_lines((beside, other), p)
    assert lines == (other,) and 'wanders about 64.01 Hz' in notes[0]
    nominal = LinearisedModel(load_rig(None), ())
    assert _other_lines((beside, other), nominal) == ((beside, other), ())
