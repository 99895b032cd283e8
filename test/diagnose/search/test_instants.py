"""Fits at all instants at once are those of one instant after the other."""

from forcecal_ros.core.noise.autoregression import white
from forcecal_ros.diagnose.dataset import split_by_phase
from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY
from forcecal_ros.diagnose.model.evidence import fit, Prior
from forcecal_ros.diagnose.model.gates import Gate, gated
from forcecal_ros.diagnose.model.linearised import EFFECT, linearised_model
from forcecal_ros.diagnose.search.change_points import Instants
from forcecal_ros.diagnose.sources.rig import prepare_commanded
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest
from rig_recordings import FREE, own_recording

LENGTH = 50


@pytest.fixture(scope='module')
def model():
    dataset = split_by_phase(prepare_commanded(own_recording(5, FREE), load_rig()))
    out = linearised_model(load_rig(), (dataset,))
    # white noise keeps no history, so that a gate has no transient
    out.noise = [white(out.residuals[0], dataset.measured.present, dataset.groups)]
    return out


@pytest.mark.parametrize('ends', [False, True])
def test_a_fit_at_an_instant_is_that_of_the_gated_column(model, ends):
    columns = model.jacobian[0][:2]
    instants = Instants(model, model.jacobian, model.prior(), [columns], model.residuals, 0,
                        LENGTH)
    found = instants.fits([0, 1], ends, False)
    i = len(instants.blocks) // 2
    at = model.datasets[0].measured.start + 0.004 * float(instants.blocks[i])
    gate = Gate(0, at, ends)
    rows = gate.rows(model.datasets[0].measured, 0)
    every = model.products([[gated(one, rows) for one in columns]]).at(NO_DISCREPANCY)
    own = model.prior()
    prior = Prior(np.append(own.centre, [0.0, 0.0]), np.append(own.precision, [EFFECT, EFFECT]),
                  np.append(own.low, [-np.inf, -np.inf]), np.append(own.high, [np.inf, np.inf]))
    m = np.arange(len(own.centre))
    joint, alone = fit(every, prior), fit(every.of(m), own)
    assert found.x[i] == pytest.approx(joint.x[-2:], rel=0.02, abs=1e-3)
    assert found.evidence[i] == pytest.approx(joint.log_evidence - alone.log_evidence, abs=0.2)
