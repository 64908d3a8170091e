import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, stats

from emcee_femu.interfaces import ModalSolution, modal_variables
from emcee_femu.likelihoods.frequency import FrequencyTerm
from emcee_femu.models.function import FunctionModel
from emcee_femu.models.mass_spring import MassSpringModel
from emcee_femu.models.matrix import MatrixModel
from emcee_femu.posterior.log_posterior import LogPosterior
from emcee_femu.posterior.priors import GaussianPrior, IndependentPrior, uniform_between

INF = np.inf
F0 = np.array([10.0, 25.0])
TERM = FrequencyTerm([10.5, 25.2], beta=4e2)
ONE = FrequencyTerm([1.0], beta=1.0)
PRIOR = GaussianPrior(["a", "b"], [0.0, 0.2], [0.1, 0.3], [(-0.1, 0.2), (0.0, 0.5)])
INSIDE, OUTSIDE = [0.05, 0.1], [0.05, 0.6]


class Linear:
    variables = modal_variables(2)

    def __init__(self, last=None, overwrite=False):
        self.rows, self.last, self.overwrite = [], last, overwrite

    def __call__(self, parameters):
        theta = np.column_stack([parameters["a"], parameters["b"]])
        self.rows.append(len(theta))
        frequencies = F0 * (1 + theta)
        if self.last is not None:
            frequencies[-1, 1] = self.last
        if self.overwrite:
            for value in parameters.values():
                value[:] = 1e9
        return ModalSolution(frequencies)


def negative_a(parameters, modes):
    return np.where(parameters["a"] > 0.1, -INF, -3.0 * parameters["a"])


def first_frequency(parameters):
    return [10.0 + parameters["a"], 20.0]


def chain(n):
    names = [f"k{i}" for i in range(n)]
    springs = {name: (i, i + 1, 100.0) for i, name in enumerate(names)}
    model = MassSpringModel(np.ones(n), springs)
    measured = 1.02 * model({"k0": np.array([90.0])}).frequencies[0]
    prior = GaussianPrior(names, [100.0] * n, 20.0, [(50.0, 130.0)] * n)
    return LogPosterior(model, FrequencyTerm(measured, beta=1e3), prior)


def test_row_is_posterior_prior_terms_frequencies():
    posterior = LogPosterior(Linear(), [TERM, negative_a], PRIOR)
    theta = np.array([INSIDE, [-0.09, 0.49], [0.0, 0.01]])
    rows = posterior(theta)
    assert rows.shape == (3, 2 + 2 + 2)
    frequencies = F0 * (1 + theta)
    cut = stats.truncnorm.logpdf(theta[:, 0], -1, 2, 0, 0.1)
    cut += stats.truncnorm.logpdf(theta[:, 1], -2 / 3, 1, 0.2, 0.3)
    measured = np.array([10.5, 25.2])
    fit = stats.norm.logpdf(frequencies, measured, measured / 20).sum(axis=1)
    expected = [cut + fit - 3 * theta[:, 0], cut, fit, -3 * theta[:, 0]]
    np.testing.assert_allclose(rows, np.c_[(*expected, frequencies)], rtol=1e-12)
    assert posterior.term_names == ("frequency", "negative_a")


@pytest.mark.parametrize("shape", [(), (0,), (1,), (4,)])
def test_one_vector_gives_one_row_and_a_batch_gives_rows(shape):
    posterior = LogPosterior(Linear(), TERM, PRIOR)
    assert posterior(np.full((*shape, 2), 0.1)).shape == (*shape, 5)


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
    np.testing.assert_array_equal(rows[out], [[-INF] * 3 + [np.nan] * 2] * 4)
    np.testing.assert_array_equal(rows[[1, 4]], posterior(batch[[1, 4]]))
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


@pytest.mark.parametrize("bad", [np.nan, INF])
@pytest.mark.parametrize("term", [TERM, ONE], ids=["compared", "only stored"])
def test_a_frequency_that_is_not_finite_is_an_error_at_its_parameters(term, bad):
    posterior = LogPosterior(Linear(last=bad), term, PRIOR)
    with pytest.raises(ValueError, match=r"\{'a': 0.05, 'b': 0.1\}"):
        posterior([OUTSIDE, [0.1, 0.2], INSIDE])


@pytest.mark.parametrize("bad", [np.nan, INF])
def test_a_log_likelihood_of_nan_or_infinity_is_an_error_at_its_parameters(bad):
    terms = [TERM, lambda p, modes: np.where(p["a"] == 0.05, bad, -INF)]
    posterior = LogPosterior(Linear(), terms, PRIOR)
    assert posterior([0.1, 0.2])[0] == -INF
    with pytest.raises(ValueError, match=r"\{'a': 0.05, 'b': 0.1\}"):
        posterior([OUTSIDE, [0.1, 0.2], INSIDE])


def test_an_error_of_a_large_batch_lists_a_few_of_its_parameter_sets():
    def broken(parameters):
        raise ArithmeticError("singular")

    posterior = LogPosterior(broken, TERM, PRIOR)
    with pytest.raises(ArithmeticError) as caught:
        posterior([INSIDE] * 256)
    assert caught.value.__notes__[0].count("{'a': 0.05") == 8
    assert "248 more" in caught.value.__notes__[0]


def test_minus_infinity_of_a_term_rejects_one_row_and_keeps_its_frequencies():
    rows = LogPosterior(Linear(), [TERM, negative_a], PRIOR)([[0.15, 0.1], INSIDE])
    assert rows[0, 0] == rows[0, 3] == -INF and np.isfinite(rows[0, [1, 2, 4, 5]]).all()
    assert np.isfinite(rows[1]).all()


def test_evidence_with_a_cut_prior_is_the_closed_form():
    prior = GaussianPrior(["a"], [0.02], 0.1, [(-0.05, 0.15)])
    posterior = LogPosterior(FunctionModel(lambda p: F0 * (1 + p["a"])), TERM, prior)
    value, _ = integrate.quad(lambda a: np.exp(posterior([a])[0]), -0.05, 0.15)
    noise = np.diag([10.5**2, 25.2**2]) / 4e2
    spread = noise + 0.1**2 * np.outer(F0, F0)
    full = stats.multivariate_normal.pdf([10.5, 25.2], F0 * 1.02, spread)
    precision = 100 + F0 @ np.linalg.solve(noise, F0)
    mean = (2.0 + F0 @ np.linalg.solve(noise, [0.5, 0.2])) / precision
    after = np.diff(stats.norm.cdf([-0.05, 0.15], mean, precision**-0.5)).item()
    before = np.diff(stats.norm.cdf([-0.05, 0.15], 0.02, 0.1)).item()
    assert value == pytest.approx(full * after / before, rel=1e-9)


SPRINGS = MassSpringModel([1.0, 1.0], {"k1": (0, 1, 9.0), "k2": (1, 2, 4.0)})
BOX = [(1.0, 9.0)]
EYE = np.eye(2)
MATRICES = MatrixModel(EYE, EYE, {"s": EYE, "t": EYE}, n_modes=1)
THREE = FrequencyTerm([1.0, 2.0, 3.0], beta=1.0)
LOW = GaussianPrior(["k1", "k2"], [5, 5], 1, [(1, 9), (-1e-9, 9)])
K1 = GaussianPrior(["k1"], [5], 1, BOX)
TWO_MODES = FunctionModel(abs, 2)


@pytest.mark.parametrize(
    ("model", "terms", "prior", "error", "message"),
    [
        (SPRINGS, ONE, GaussianPrior(["k3"], [5], 1, BOX), ValueError, r"\['k3'\]"),
        (MATRICES, ONE, GaussianPrior(["s"], [5], 1, BOX), ValueError, r"\['t'\]"),
        (SPRINGS, ONE, GaussianPrior(["k2"], [5], 1), ValueError, "'k2' must stay"),
        (SPRINGS, ONE, LOW, ValueError, "'k2' must stay above zero"),
        (TWO_MODES, THREE, K1, ValueError, "compares 3 of .* returns 2"),
        (3.0, TERM, PRIOR, TypeError, "^model: "),
        (Linear(), [TERM, 3.0], PRIOR, TypeError, "^terms: .*3.0"),
        (Linear(), "terms", PRIOR, TypeError, "^terms: "),
        (Linear(), [], PRIOR, ValueError, "^terms: expected at least one"),
        (Linear(), TERM, {"a": 1}, TypeError, "^prior: .*dict has no names"),
        (Linear(), PRIOR, TERM, TypeError, "^terms: "),
        (Linear(), [TERM, TERM], PRIOR, ValueError, r"^terms.*\['frequency'\]"),
        (
            FunctionModel(abs),
            negative_a,
            PRIOR,
            ValueError,
            "^model: what does it return",
        ),
    ],
)
def test_construction_refuses(model, terms, prior, error, message):
    with pytest.raises(error, match=message):
        LogPosterior(model, terms, prior)


def test_a_lower_bound_of_zero_is_enough_for_a_stiffness():
    prior = IndependentPrior({"k2": uniform_between(0.0, 9.0)})
    assert LogPosterior(SPRINGS, ONE, prior).names == ("k2",)


@pytest.mark.parametrize("bounds", [[(1.0, 9.0)], np.array([1.0, 9.0])])
def test_a_prior_of_ones_own_must_have_bounds_as_an_array(bounds):
    own = SimpleNamespace(names=("k1",), bounds=bounds, logpdf=abs, sample=abs)
    with pytest.raises(TypeError, match=r"^prior: expected bounds .* shape \(1, 2\)"):
        LogPosterior(SPRINGS, ONE, own)


@pytest.mark.parametrize(("own", "stored"), [(None, 1), (2, 2)])
def test_function_model_of_unknown_n_modes_stores_those_of_the_terms(own, stored):
    posterior = LogPosterior(FunctionModel(first_frequency, own), ONE, PRIOR)
    np.testing.assert_array_equal(posterior(INSIDE)[3:], [10.05, 20.0][:stored])


@pytest.mark.parametrize("frequencies", [[1.0, 2.0], [[1.0]] * 3, [[1.0, 2.0]] * 2])
def test_a_model_that_returns_a_wrong_shape_is_refused(frequencies):
    solution = ModalSolution(np.array(frequencies))
    posterior = LogPosterior(lambda parameters: solution, TERM, PRIOR)
    with pytest.raises(ValueError, match="^model: expected"):
        posterior([INSIDE] * 3)


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


@pytest.mark.parametrize("around", [None, INSIDE, [-0.1, 0.0], [0.2, 0.5], [-0.1, 0.5]])
def test_starts_are_inside_and_repeat_with_their_seed(around):
    posterior = LogPosterior(Linear(), TERM, PRIOR)
    first, again, other = (posterior.start(500, seed, around) for seed in (3, 3, 4))
    assert first.shape == (500, 2) and np.isfinite(PRIOR.logpdf(first)).all()
    np.testing.assert_array_equal(first, again)
    assert not np.isin(first, other).any()
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
        ((4, 1, [0.05, 0.51]), ValueError, r"^around: b = 0.51 .*\(0, 0.5\)"),
        ((4, 1, [-0.11, 0.1]), ValueError, "^around: a = -0.11"),
        ((4, 1, [0.1]), ValueError, "^around: expected one number for each of"),
        ((4, 1, [[0.1, 0.1]]), ValueError, "^around: expected 1 dimension"),
        ((4, 1, [np.nan, 0.1]), ValueError, "^around: expected finite"),
    ],
)
def test_start_refuses(arguments, error, message):
    with pytest.raises(error, match=message):
        LogPosterior(Linear(), TERM, PRIOR).start(*arguments)


@pytest.mark.parametrize("low", [0.9, 1.0])
@pytest.mark.parametrize("high", [2.0, 2.1])
def test_a_prior_wider_than_the_models_own_bounds_is_refused(low, high):
    class Bounded:
        names, bounds = ("k",), {"k": (1.0, 2.0)}

        def __call__(self, parameters):
            return ModalSolution(parameters["k"][:, None])

    prior = IndependentPrior({"k": stats.uniform(low, high - low)})
    term = FrequencyTerm([1.5], beta=10.0)
    if (low, high) == (1.0, 2.0):
        assert LogPosterior(Bounded(), term, prior).names == ("k",)
        return
    with pytest.raises(ValueError, match=r"'k' has bounds .* holds within \(1, 2\)"):
        LogPosterior(Bounded(), term, prior)


def test_a_lambda_has_a_name_that_files_take():
    prior = GaussianPrior(["k"], [1.0], [0.1])
    model = FunctionModel(lambda p: [p["k"]], n_modes=1)
    terms = [lambda p, modes: -(p["k"] ** 2), lambda p, modes: -p["k"]]
    assert LogPosterior(model, terms, prior).term_names == ("term0", "term1")
