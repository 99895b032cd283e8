"""What of a residual is more than noise, and matters."""

from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.residual_summary import (
    _other_lines,
    ResidualSummary,
    unexplained,
    WITHOUT_NAME,
)
from forcecal_ros.diagnose.localise import Line, TimeFrequencyBin
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.verdict import verdict
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest


def test_a_line_beside_that_of_an_explained_vibration_is_its_own():
    beside = Line('force.x', 64.31, 1.0, 5000.0)
    other = Line('force.y', 50.0, 1.0, 60.0)
    p = LinearisedModel(load_rig(None), (), effects={'spindle_vibration': {'frequency': 64.01}})
    lines, notes = _other_lines((beside, other), p)
    assert lines == (other,) and 'varies about 64.01 Hz' in notes[0]
    nominal = LinearisedModel(load_rig(None), ())
    assert _other_lines((beside, other), nominal) == ((beside, other), ())


LEFT = ('a part that follows the motion but matches no effect of the library, 0.0024 V RMS in '
        'accel.x')
WITHIN = f'within tolerance: {LEFT}, is 0.08 times its noise; up to 0.1 is within the tolerance'


def left(size=0.08, evidence=3.0 * WITHOUT_NAME, tolerance=0.1, excess=0.0):
    """Return the summary of a discrepancy in accel.x, of noise, and of one bin."""
    rows = np.zeros((100, len(CHANNELS)))
    rows[:, 6] = 0.03 * size
    sizes = np.where(np.arange(len(CHANNELS)) == 6, size, 0.0)
    one = TimeFrequencyBin(2, 'move', (4.0, 8.0), excess, 20.0 if excess else 0.0)
    return ResidualSummary((rows,), sizes, [one], (), np.zeros(len(CHANNELS)), (), evidence,
                           level=np.full(len(CHANNELS), 0.03), tolerance=tolerance)


@pytest.mark.parametrize('tolerance, excess, word, said', [
    (0.1, 0.0, 'no_gap', WITHIN),
    (0.05, 0.0, 'unknown', LEFT),
    (0.1, 0.2, 'unknown', 'force.z in move, 4 to 8 Hz (20.0 sigma)')])
def test_what_is_smaller_than_tolerated_is_no_gap_and_that_is_said_with_its_size(
        tolerance, excess, word, said):
    part = unexplained(left(tolerance=tolerance, excess=excess))
    assert (part.ratio >= 1.0) == (word == 'unknown')
    found, reason = verdict([], [], part, None, True)
    assert found == word and reason.endswith(said)


def test_noise_alone_needs_no_tolerance():
    part = unexplained(left(evidence=0.5 * WITHOUT_NAME))
    assert part.ratio < 1.0 and not part.within
