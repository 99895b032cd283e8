"""A discrepancy is integrated out as the dense Gaussian says, and so is what a larger one adds."""

import tracemalloc

from forcecal_ros.core.noise.autoregression import AT_ONCE, Autoregression, ORDER
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.discrepancy import Basis, basis, Discrepancy, SCALES
from forcecal_ros.diagnose.model.evidence import fit, Prior
from forcecal_ros.diagnose.model.jacobian import Compact
from forcecal_ros.sim.signals import Signals
import numpy as np
import pytest
from scipy.stats import multivariate_normal

N, SIGMA, SIGNAL = (60, 50), 0.5, 200.0
SHARE = np.array([0.25, 0.25, 0.5])


def white(n):
    """Return white noise in the first channel, all that the others lack."""
    coefficients, sigma = np.zeros((3, len(CHANNELS), ORDER)), np.zeros((3, len(CHANNELS)))
    sigma[:, 0] = SIGMA
    there = np.ones((n, len(CHANNELS)), dtype=bool)
    return Autoregression(coefficients, sigma, there, there, np.zeros(n, dtype=np.intp))


def setting(seed):
    """Return features, a column, what is beside it, and the discrepancy of two recordings."""
    rng = np.random.default_rng(seed)
    rows = tuple(Compact.of(rng.standard_normal((3, n))) for n in N)
    train = [np.ones(N[0], dtype=bool), np.arange(N[1]) < 20]
    of = Discrepancy(Basis(rows, SHARE), np.full(len(CHANNELS), SIGNAL), train)
    columns = [[{0: Compact.of(rng.standard_normal(n))}] for n in N]
    residual = [np.zeros((n, len(CHANNELS))) for n in N]
    for r in residual:
        r[:, 0] = SIGMA * rng.standard_normal(len(r))
    return [one.values() for one in rows], columns, residual, of


def dense(rows, column, residual, chosen, size):
    """Log-likelihood of some samples, the column's coefficient of unit prior integrated out."""
    f, x = np.concatenate(rows, axis=1)[:, chosen], column[chosen]
    covariance = SIGMA ** 2 * np.eye(len(x)) + np.outer(x, x) \
        + (size * SIGNAL) ** 2 * (f.T * SHARE) @ f
    noise = multivariate_normal(np.zeros(len(x)), SIGMA ** 2 * np.eye(len(x)))
    full = multivariate_normal(np.zeros(len(x)), covariance)
    # an evidence leaves out what noise alone makes of a residual of zero
    return full.logpdf(residual[chosen]) - noise.logpdf(np.zeros(len(x)))


@pytest.mark.parametrize('size', SCALES)
def test_evidence_is_that_of_the_dense_gaussian_for_training_blocks_and_for_all(size):
    rows, columns, residual, of = setting(1)
    whitened = of.whitened([white(n) for n in N])
    training, every = (whitened.products(columns, residual, training=part).at((size,) * 4)
                       for part in (True, False))
    prior = Prior(np.zeros(1), np.ones(1), np.full(1, -np.inf), np.full(1, np.inf))
    flat = np.concatenate([r[:, 0] for r in residual])
    column = np.concatenate([c[0][0].values() for c in columns]).astype(float)
    trained = np.arange(sum(N)) < N[0] + 20
    assert fit(training, prior).log_evidence == pytest.approx(
        dense(rows, column, flat, trained, size), abs=1e-3)
    assert fit(every, prior).log_evidence == pytest.approx(
        dense(rows, column, flat, np.full(sum(N), True), size), abs=1e-3)


def test_as_much_of_a_residual_is_predicted_as_the_features_bear_out_and_nothing_of_noise():
    _, _, residual, of = setting(5)
    beside = of.whitened([white(n) for n in N])
    nothing = beside.predicted(residual)
    assert sum(float(np.sum(x ** 2)) for x in nothing) < 3.0 * SIGMA ** 2 * 3
    for one, rows in zip(residual, of.basis.rows):
        one[:, 0] += 2.0 * rows.values()[0]
    for one, rows in zip(beside.predicted(residual), of.basis.rows):
        assert np.std(one[:, 0] - 2.0 * rows.values()[0]) < 0.3


def signals(n, seed):
    rng = np.random.default_rng(seed)
    walk = lambda k: np.cumsum(rng.standard_normal((4 * n, k)), axis=0)  # noqa: E731
    rotations = np.broadcast_to(np.eye(3), (4 * n, 3, 3)).copy()
    return Signals(0.0, walk(6), walk(3), walk(1)[:, 0], walk(3), rotations, walk(3), walk(3),
                   walk(3), walk(3), walk(1)[:, 0], np.zeros((4 * n, 6)), walk(3))


def test_features_are_of_one_size_whatever_varies_and_groups_share_the_variance():
    found = basis([signals(500, 1), signals(300, 2)], [20.0])
    every = np.concatenate([rows.values() for rows in found.rows], axis=1)
    assert np.sqrt(np.mean(every ** 2, axis=1)) == pytest.approx(1.0, rel=1e-4)
    assert found.variance.sum() == pytest.approx(1.0)
    # 13 cosines less the constant, and a wave of two phases, are each recording's own
    own = [np.flatnonzero(~r.numbers.any(axis=1)) for r in found.rows]
    assert len(own[0]) == 0 or set(own[0]).isdisjoint(own[1])


def test_only_a_channel_that_is_whitened_otherwise_is_whitened_anew():
    _, columns, residual, of = setting(6)
    before = of.whitened([white(n) for n in N])
    modes = before.modes(0, False)
    assert of.whitened([white(n) for n in N]).modes(0, False) is modes
    louder = [one._replace(sigma=2.0 * one.sigma) for one in map(white, N)]
    other = of.whitened(louder)
    assert other.modes(0, False) is not modes
    fresh = setting(6)[3].whitened(louder)
    got, expected = (one.products(columns, residual).at((3e-3,) * 4) for one in (other, fresh))
    assert got.square == pytest.approx(expected.square)


def test_a_column_of_one_recording_alone_is_the_same_there_and_nothing_elsewhere():
    _, columns, residual, of = setting(12)
    alone = [[one[0], {} if i else one[0]] for i, one in enumerate(columns)]
    whitened = of.whitened([white(n) for n in N])
    found = whitened.products(alone, residual).at((3e-3,) * 4)
    rows = [[one[0], {0: Compact.of((i == 0) * one[0][0].values())}]
            for i, one in enumerate(columns)]
    expected = setting(12)[3].whitened(whitened.noise).products(rows, residual).at((3e-3,) * 4)
    assert found.matrix == pytest.approx(expected.matrix, rel=1e-4)
    assert found.vector == pytest.approx(expected.vector, rel=1e-4)


def test_products_that_are_kept_are_those_of_the_columns_at_hand_and_of_this_residual():
    _, columns, residual, of = setting(13)
    rng, whitened = np.random.default_rng(14), of.whitened([white(n) for n in N])

    def more(count):
        return [[{0: Compact.of(rng.standard_normal(n))} for _ in range(count)] for n in N]

    def agree(asked, training=False):
        got, expected = (one.products(asked, residual, training=training).at((3e-3,) * 4)
                         for one in (whitened, setting(13)[3].whitened(whitened.noise)))
        assert got.matrix == pytest.approx(expected.matrix, rel=1e-5, abs=1e-5)
        assert got.vector == pytest.approx(expected.vector, rel=1e-5, abs=1e-5)
        assert got.square == pytest.approx(expected.square)

    first, second = more(2), more(3)
    agree(columns)
    agree([[*a, *b] for a, b in zip(first, columns)])
    whitened.products(second, residual, absent=True)
    agree(second)
    # asked for one by one, but never with each other, and one of them twice
    agree([[*a, *b, *c, b[0]] for a, b, c in zip(columns, first, second)])
    agree(first, training=True)
    residual = [r + 1.0 for r in residual]
    first = more(4)  # the former two are gone
    agree([[*b, *a, c[1]] for a, b, c in zip(columns, first, second)])
    assert whitened.kept[0, False, 0].own.shape == (1 + 4 + 1 + 3,) * 2


def long(n, rng):
    """Return a discrepancy of one recording, and sixty columns in its first channel."""
    of = Discrepancy(Basis((Compact.of(rng.standard_normal((3, n))),), SHARE),
                     np.full(len(CHANNELS), SIGNAL), [np.arange(n) % 3000 < 2000])
    return of, [[{0: Compact.of(rng.standard_normal(n))} for _ in range(60)]]


def test_products_over_a_long_recording_are_those_of_all_of_it_at_once():
    n, rng = 3 * AT_ONCE + 100, np.random.default_rng(10)
    of, columns = long(n, rng)
    residual = rng.standard_normal((n, len(CHANNELS)))
    every = np.stack([residual[:, 0], *(c[0].values() for c in columns[0])]) / SIGMA
    for training, rows in ((True, of.train[0]), (False, np.full(n, True))):
        gram = of.whitened([white(n)]).products(
            columns, [residual], absent=True, training=training).at((0.0,) * 4)
        expected = every[:, rows] @ every[:, rows].T
        assert gram.matrix == pytest.approx(expected[1:, 1:])
        assert gram.vector == pytest.approx(expected[1:, 0])
        assert gram.n == rows.sum()


def test_products_need_no_room_for_all_columns_in_double_precision():
    n, rng = 100_000, np.random.default_rng(11)
    of, columns = long(n, rng)
    residual, whitened = [np.zeros((n, len(CHANNELS)))], of.whitened([white(n)])
    whitened.products([columns[0][:1]], residual)  # compiles, and whitens the features
    tracemalloc.start()
    whitened.products(columns, residual)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.5 * 8 * 60 * n


def test_of_a_column_that_is_a_feature_as_little_is_left_as_features_are_uncertain():
    n, rng = 100_000, np.random.default_rng(12)
    of, _ = long(n, rng)
    of = Discrepancy(of.basis, 100.0 * of.signal, of.train)
    rows = of.basis.rows[0]
    column, f = Compact(rows.numbers[0], rows.unit[0]), rows.values().astype(float) / SIGMA
    left, = of.whitened([white(n)]).products(
        [[{0: column}]], [np.zeros((n, len(CHANNELS)))]).at((0.25,) * 4).matrix[0]
    # the prior's precision alone tells the first feature, and with it the column
    prior = np.diag(1.0 / (SHARE * (25.0 * SIGNAL) ** 2))
    expected = np.linalg.solve(f @ f.T + prior, prior)[0] @ (f @ f[0])
    assert left == pytest.approx(expected, rel=0.1)


LENGTH, TRAINED, KNOWN, OWN = 80, 50, 3e-3, 0.03


def like_a_feature(rng):
    """Return features, two columns, the first like a feature, and the products of a residual."""
    features = Compact.of(rng.standard_normal((3, LENGTH)))
    rows = features.values()
    columns = Compact.of(np.stack([rows[0] + 0.3 * rng.standard_normal(LENGTH),
                                   rng.standard_normal(LENGTH)]))
    residual = np.zeros((LENGTH, len(CHANNELS)))
    residual[:, 0] = SIGMA * rng.standard_normal(LENGTH) \
        + OWN * SIGNAL * (np.sqrt(SHARE) * rng.standard_normal(3)) @ rows
    train = np.arange(LENGTH) < TRAINED
    of = Discrepancy(Basis((features,), SHARE), np.full(len(CHANNELS), SIGNAL), [train])
    products = [of.whitened([white(LENGTH)]).products(
        [[{0: Compact(*one)} for one in zip(columns.numbers, columns.unit)]], [residual],
        training=training) for training in (False, True)]
    return rows, columns.values().astype(float), residual, *products


def covariance(rows, size):
    return SIGMA ** 2 * np.eye(rows.shape[1]) + (size * SIGNAL) ** 2 * (rows.T * SHARE) @ rows


@pytest.mark.parametrize('known', [0.0, KNOWN])
def test_products_vary_by_what_a_larger_discrepancy_adds(known):
    rows, columns, _, products, _ = like_a_feature(np.random.default_rng(1))
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
        *_, products, _ = like_a_feature(rng)
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
    rows, _, residual, _, training = like_a_feature(np.random.default_rng(3))
    whitened = training.whitened
    found, = whitened.of_weights(training.weights({0: OWN}))
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
