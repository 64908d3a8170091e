import itertools
import pickle

import numpy as np
import pytest
from scipy import integrate, stats

from emcee_femu.interfaces import ModalSolution
from emcee_femu.likelihoods import FrequencyTerm
from emcee_femu.models.affine import MatrixModel
from emcee_femu.models.function import FunctionModel
from emcee_femu.models.mass_spring import MassSpringModel
from emcee_femu.posterior import LogPosterior
from emcee_femu.priors import GaussianPrior, IndependentPrior, uniform_between

INF = np.inf
F0 = np.array([10.0, 25.0])
TERM = FrequencyTerm([10.5, 25.2], beta=4e2)
PRIOR = GaussianPrior(["a", "b"], [0.0, 0.2], [0.1, 0.3], [(-0.1, 0.2), (0.0, 0.5)])
INSIDE, OUTSIDE = [0.05, 0.1], [0.05, 0.6]


class Linear:
    """f = F0 (1 + a, 1 + b); keeps the number of rows of each call."""

    def __init__(self, output=None, overwrite=False):
        self.rows, self.output, self.overwrite = [], output, overwrite

    def __call__(self, parameters):
        theta = np.column_stack([parameters["a"], parameters["b"]])
        self.rows.append(len(theta))
        frequencies = F0 * (1 + theta)
        if self.output is not None:
            frequencies[-1, 1] = self.output
        if self.overwrite:
            for value in parameters.values():
                value[:] = 1e9
        return ModalSolution(frequencies)


def negative_a(parameters, modes):
    """A term that is a plain function: it rejects a > 0.1 by -inf."""
    return np.where(parameters["a"] > 0.1, -INF, -3.0 * parameters["a"])


def first_frequency(parameters):
    return [10.0 + parameters["a"], 20.0]


def chain(n, springs=None):
    names = [f"k{i}" for i in range(n)]
    model = MassSpringModel(np.ones(n), {k: (i, i + 1, 100.0) for i, k in enumerate(names)})
    measured = 1.02 * model({"k0": np.array([90.0])}).frequencies[0]
    prior = GaussianPrior(names, [100.0] * n, 20.0, [(50.0, 130.0)] * n)
    return LogPosterior(model, FrequencyTerm(measured, beta=1e3), prior)


def test_row_is_posterior_prior_terms_frequencies():
    posterior = LogPosterior(Linear(), [TERM, negative_a], PRIOR)
    theta = np.array([INSIDE, [-0.1, 0.5], [0.0, 0.0]])
    rows = posterior(theta)
    assert rows.shape == (3, 2 + 2 + 2)
    frequencies = F0 * (1 + theta)
    cut = stats.truncnorm.logpdf(theta[:, 0], -1, 2, 0, 0.1)
    cut += stats.truncnorm.logpdf(theta[:, 1], -2 / 3, 1, 0.2, 0.3)
    measured = np.array([10.5, 25.2])
    fit = stats.norm.logpdf(frequencies, measured, measured / 20).sum(axis=1)
    expected = [cut + fit - 3 * theta[:, 0], cut, fit, -3 * theta[:, 0]]
    np.testing.assert_allclose(
        rows, np.column_stack([*expected, frequencies]), rtol=1e-12
    )
    assert posterior.term_names == ("frequency", "negative_a")
    assert (posterior.names, posterior.ndim, posterior.n_modes) == (("a", "b"), 2, 2)


def test_one_vector_gives_one_row_and_a_batch_gives_rows():
    posterior = LogPosterior(Linear(), TERM, PRIOR)
    row, rows = posterior(INSIDE), posterior([INSIDE, OUTSIDE])
    assert row.shape == (5,) and rows.shape == (2, 5)
    np.testing.assert_array_equal(rows[0], row)
    np.testing.assert_array_equal(rows[1], posterior(OUTSIDE))
    assert posterior(np.empty((0, 2))).shape == (0, 5)


@pytest.mark.parametrize("order", "CF")
@pytest.mark.parametrize("n", [2, 5, 7, 8, 9, 16])
def test_a_batch_equals_a_loop_to_the_bit(n, order):
    posterior = chain(n)
    theta = np.random.default_rng(2).normal(100, 20, (60, n)) % 85 + 50
    rows = posterior(np.array(theta, order=order))
    assert np.isfinite(rows[:, 0]).any() and (n < 5 or (rows[:, 0] == -INF).any())
    np.testing.assert_array_equal(rows, [posterior(row) for row in theta])
    np.testing.assert_array_equal(rows[13:20], posterior(theta[13:20]))


def test_rows_outside_are_rejected_and_never_reach_the_model():
    model = Linear()
    posterior = LogPosterior(model, TERM, PRIOR)
    batch = np.array([OUTSIDE, INSIDE, [-0.2, 0.1], [np.nan, 0.1], [0.2, 0.5], OUTSIDE])
    rows = posterior(batch)
    assert model.rows == [2]
    out = [0, 2, 3, 5]
    np.testing.assert_array_equal(rows[out, :3], np.full((4, 3), -INF))
    np.testing.assert_array_equal(rows[out, 3:], np.full((4, 2), np.nan))
    np.testing.assert_array_equal(rows[[1, 4]], posterior(batch[[1, 4]]))
    assert model.rows == [2, 2]
    posterior(batch[out])
    posterior(OUTSIDE)
    assert model.rows == [2, 2]


@pytest.mark.parametrize("batch", [[INSIDE] * 3, [INSIDE, OUTSIDE], INSIDE])
@pytest.mark.parametrize("order", "CF")
def test_theta_is_not_modified_even_by_a_model_that_overwrites_its_input(batch, order):
    theta = np.array(batch, order=order)
    rows = LogPosterior(Linear(overwrite=True), TERM, PRIOR)(theta)
    np.testing.assert_array_equal(theta, batch)
    np.testing.assert_array_equal(rows, LogPosterior(Linear(), TERM, PRIOR)(batch))


@pytest.mark.parametrize("bad", [np.nan, INF, -INF])
@pytest.mark.parametrize("who", ["model", "term"])
def test_nan_and_infinity_are_errors_that_name_the_parameters(who, bad):
    def term(parameters, modes):
        wrong = parameters["a"] == 0.05
        return np.where(wrong, bad, 0.0)

    batch = np.array([OUTSIDE, [0.1, 0.2], INSIDE])
    if who == "model":
        posterior = LogPosterior(Linear(output=bad), TERM, PRIOR)
    else:
        posterior = LogPosterior(Linear(), [TERM, term], PRIOR)
    if bad == -INF or (who, bad) == ("model", INF):  # (inf - f)^2: rejections
        rows = posterior(batch)
        assert rows[2, 0] == -INF and np.isfinite(rows[1, 0])
        return
    with pytest.raises(ValueError, match=r"\{'a': 0.05, 'b': 0.1\}"):
        posterior(batch)


def test_minus_infinity_of_a_term_rejects_one_row_and_keeps_its_frequencies():
    rows = LogPosterior(Linear(), [TERM, negative_a], PRIOR)([[0.15, 0.1], INSIDE])
    assert rows[0, 0] == rows[0, 3] == -INF and np.isfinite(rows[0, [1, 2, 4, 5]]).all()
    assert np.isfinite(rows[1]).all()


def test_evidence_with_a_cut_prior_is_the_closed_form():
    prior = GaussianPrior(["a"], [0.02], 0.1, [(-0.05, 0.15)])
    posterior = LogPosterior(FunctionModel(lambda p: F0 * (1 + p["a"])), TERM, prior)
    value, _ = integrate.quad(lambda a: np.exp(posterior([a])[0]), -0.05, 0.15)
    noise = np.diag(np.array([10.5, 25.2]) ** 2 / 4e2)
    full = stats.multivariate_normal.pdf(
        [10.5, 25.2], F0 * 1.02, noise + 0.1**2 * np.outer(F0, F0)
    )
    precision = 100 + F0 @ np.linalg.solve(noise, F0)
    mean = (2.0 + F0 @ np.linalg.solve(noise, [0.5, 0.2])) / precision
    after = np.diff(stats.norm.cdf([-0.05, 0.15], mean, precision**-0.5)).item()
    before = np.diff(stats.norm.cdf([-0.05, 0.15], 0.02, 0.1)).item()
    assert value == pytest.approx(full * after / before, rel=1e-9)


SPRINGS = MassSpringModel([1.0, 1.0], {"k1": (0, 1, 9.0), "k2": (1, 2, 4.0)})
MATRICES = MatrixModel(np.eye(2), np.eye(2), {"s": np.eye(2), "t": np.eye(2)}, n_modes=1)
ONE = FrequencyTerm([1.0], beta=1.0)
BOX = [(1.0, 9.0)]


@pytest.mark.parametrize(
    ("model", "terms", "prior", "error", "message"),
    [
        (SPRINGS, ONE, GaussianPrior(["k3"], [5], 1, BOX), ValueError, r"\['k3'\]"),
        (MATRICES, ONE, GaussianPrior(["s"], [5], 1, BOX), ValueError, r"\['t'\]"),
        (SPRINGS, ONE, GaussianPrior(["k2"], [5], 1), ValueError, "'k2' must stay"),
        (
            SPRINGS,
            ONE,
            GaussianPrior(["k1", "k2"], [5, 5], 1, [(1, 9), (-1e-9, 9)]),
            ValueError,
            "'k2' must stay above zero",
        ),
        (
            SPRINGS,
            FrequencyTerm([1.0, 2.0, 3.0], beta=1.0),
            GaussianPrior(["k1"], [5], 1, BOX),
            ValueError,
            "3 modes were measured, but the model returns 2",
        ),
        (3.0, TERM, PRIOR, TypeError, "^model: "),
        (Linear(), [TERM, 3.0], PRIOR, TypeError, "^terms: .*3.0"),
        (Linear(), "terms", PRIOR, TypeError, "^terms: "),
        (Linear(), [], PRIOR, ValueError, "^terms: expected at least one"),
        (Linear(), TERM, {"a": 1}, TypeError, "^prior: .*dict has no names"),
        (Linear(), PRIOR, TERM, TypeError, "^terms: "),
        (Linear(), [TERM, TERM], PRIOR, ValueError, r"^terms.*\['frequency'\]"),
        (Linear(), negative_a, PRIOR, ValueError, "^model: how many frequencies"),
    ],
)
def test_construction_refuses(model, terms, prior, error, message):
    with pytest.raises(error, match=message):
        LogPosterior(model, terms, prior)


def test_a_lower_bound_of_zero_is_enough_for_a_stiffness():
    prior = IndependentPrior({"k2": uniform_between(0.0, 9.0)})
    assert LogPosterior(SPRINGS, ONE, prior).n_modes == 2


@pytest.mark.parametrize(("own", "stored"), [(None, 1), (2, 2)])
def test_function_model_of_unknown_n_modes_stores_those_of_the_terms(own, stored):
    posterior = LogPosterior(FunctionModel(first_frequency, own), ONE, PRIOR)
    assert posterior.n_modes == stored
    np.testing.assert_array_equal(posterior(INSIDE)[3:], [10.05, 20.0][:stored])


@pytest.mark.parametrize("shape", [(), (1,), (3,), (4, 3), (2, 1), (1, 1, 2)])
def test_theta_of_a_wrong_shape_is_refused(shape):
    with pytest.raises(ValueError, match=r"^theta: expected shape \(2,\) or \(n, 2\)"):
        LogPosterior(Linear(), TERM, PRIOR)(np.zeros(shape))


@pytest.mark.parametrize("model", [SPRINGS, FunctionModel(first_frequency, 2)])
def test_a_pickled_posterior_gives_the_same_bits(model):
    names = getattr(model, "names", ("a", "b"))
    prior = IndependentPrior({name: uniform_between(0.5, 2.0) for name in names})
    posterior = LogPosterior(model, FrequencyTerm([1.0, 2.0], beta=3.0), prior)
    theta = posterior.start(20, 1)
    copy = pickle.loads(pickle.dumps(posterior))
    np.testing.assert_array_equal(copy(theta), posterior(theta))
    np.testing.assert_array_equal(copy.start(20, 1), theta)


@pytest.mark.parametrize("around", [None, INSIDE, [-0.1, 0.0], [0.2, 0.5], [-0.1, 0.5]])
def test_starts_are_inside_and_repeat_with_their_seed(around):
    posterior = LogPosterior(Linear(), TERM, PRIOR)
    first = posterior.start(500, 3, around=around)
    assert first.shape == (500, 2) and np.isfinite(PRIOR.logpdf(first)).all()
    np.testing.assert_array_equal(first, posterior.start(500, 3, around=around))
    others = posterior.start(500, 4, around=around)
    assert not np.isin(first, others).any()
    sd = PRIOR.sample(np.random.default_rng(9), 50_000).std(axis=0)
    if around is None:
        np.testing.assert_allclose(first.std(axis=0), sd, rtol=0.15)
        return
    distance = (first - around) / (0.1 * sd)  # (half-)normal about the point
    assert np.abs(distance).max() < 5
    np.testing.assert_allclose((distance**2).mean(axis=0), 1.0, atol=0.35)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((4.0, 1), TypeError, "^nwalkers: expected a whole number"),
        ((True, 1), TypeError, "^nwalkers: expected a whole number"),
        ((0, 1), ValueError, "^nwalkers: expected at least 1"),
        ((4, 1, OUTSIDE), ValueError, r"^around: b = 0.6 .*\(0, 0.5\)"),
        ((4, 1, [-0.11, 0.1]), ValueError, "^around: a = -0.11"),
        ((4, 1, [0.1]), ValueError, "^around: expected one number for each of"),
        ((4, 1, [[0.1, 0.1]]), ValueError, "^around: expected 1 dimension"),
        ((4, 1, [np.nan, 0.1]), ValueError, "^around: expected finite"),
    ],
)
def test_start_refuses(arguments, error, message):
    with pytest.raises(error, match=message):
        LogPosterior(Linear(), TERM, PRIOR).start(*arguments)
