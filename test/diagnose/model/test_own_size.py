"""What a larger discrepancy does to a fit, and what it is held out, are the dense Gaussian's."""

from forcecal_ros.core.noise.autoregression import Autoregression, ORDER
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.basis import Basis
from forcecal_ros.diagnose.model.compact import Compact
from forcecal_ros.diagnose.model.discrepancy import Discrepancy
from forcecal_ros.diagnose.model.evidence import fit, Prior
import numpy as np
import pytest

N, TRAINED, SIGMA, SIGNAL = 80, 50, 0.5, 200.0
SHARE = np.array([0.25, 0.25, 0.5])
KNOWN, OWN = 3e-3, 0.03


def white():
    coefficients, sigma = np.zeros((3, len(CHANNELS), ORDER)), np.zeros((3, len(CHANNELS)))
    sigma[:, 0] = SIGMA
    there = np.ones((N, len(CHANNELS)), dtype=bool)
    return Autoregression(coefficients, sigma, there, there, np.zeros(N, dtype=np.intp))


def setting(rng):
    """Return features, two columns, the first like a feature, and the products of a residual."""
    features = Compact.of(rng.standard_normal((3, N)))
    rows = features.values()
    columns = Compact.of(np.stack([rows[0] + 0.3 * rng.standard_normal(N),
                                   rng.standard_normal(N)]))
    residual = np.zeros((N, len(CHANNELS)))
    residual[:, 0] = SIGMA * rng.standard_normal(N) \
        + OWN * SIGNAL * (np.sqrt(SHARE) * rng.standard_normal(3)) @ rows
    train = np.arange(N) < TRAINED
    of = Discrepancy(Basis((features,), SHARE), np.full(len(CHANNELS), SIGNAL), [train])
    products = [of.whitened([white()]).products(
        [[{0: Compact(*one)} for one in zip(columns.numbers, columns.unit)]], [residual],
        training=training) for training in (False, True)]
    return rows, columns.values().astype(float), residual, *products


def covariance(rows, size):
    return SIGMA ** 2 * np.eye(rows.shape[1]) + (size * SIGNAL) ** 2 * (rows.T * SHARE) @ rows


@pytest.mark.parametrize('known', [0.0, KNOWN])
def test_products_vary_by_what_a_larger_discrepancy_adds(known):
    rows, columns, _, products, _ = setting(np.random.default_rng(1))
    f, a = rows.astype(float), columns
    weighed = np.linalg.solve(covariance(f, known), a.T)
    more = covariance(f, OWN) - covariance(f, known)
    found = products.spread((known,) * 4, {0: OWN})
    assert found == pytest.approx(weighed.T @ more @ weighed, rel=1e-3)
    assert not products.spread((OWN,) * 4, {0: OWN}).any()
    assert not products.spread((known,) * 4, {}).any()


def test_a_number_that_a_discrepancy_is_like_is_off_by_as_much_as_it_is_said_to_be():
    rng, off, stated = np.random.default_rng(2), [], []
    prior = Prior(np.zeros(2), np.full(2, 1e-9), np.full(2, -np.inf), np.full(2, np.inf))
    for _ in range(100):
        *_, products, _ = setting(rng)
        scales = (KNOWN,) * 4
        found = fit(products.at(scales), prior)
        more = found.covariance @ products.spread(scales, {0: OWN}) @ found.covariance
        off.append(found.x)
        stated.append([np.diag(found.covariance), np.diag(found.covariance + more)])
    z = np.mean(np.square(off)[:, None] / np.array(stated), axis=0)
    # as the fit knows it, and as it is: the first is a feature's likeness, the second is not
    assert z[0, 0] > 3.0
    assert z[1] == pytest.approx([1.0, 1.0], abs=0.4)


def test_a_discrepancy_is_predicted_held_out_and_may_be_off_as_the_dense_gaussian_says():
    rows, _, residual, _, training = setting(np.random.default_rng(3))
    whitened = training.whitened
    found, = whitened.of_weights(training.weights({0: OWN}), [residual.shape])
    unseen = whitened.unseen({0: OWN})
    f, g = rows[:, :TRAINED].astype(float), rows[:, TRAINED:].astype(float)
    across = (OWN * SIGNAL) ** 2 * (g.T * SHARE) @ f
    solved = np.linalg.solve(covariance(f, OWN), np.column_stack([residual[:TRAINED, 0],
                                                                  across.T]))
    assert found[TRAINED:, 0] == pytest.approx(across @ solved[:, 0], rel=1e-3, abs=1e-3)
    prior = (OWN * SIGNAL) ** 2 * (g.T * SHARE) @ g
    assert unseen[0] == pytest.approx(
        np.mean(np.diag(prior - across @ solved[:, 1:])), rel=1e-2)
    assert not unseen[1:].any() and not whitened.unseen({}).any() and not training.weights({})
