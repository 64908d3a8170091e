"""Rows of a posterior: densities and response, of one parameter set or of many."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import emcee_femu as ef

INF = np.inf
F0 = np.array([10.0, 25.0])
TERM = ef.FrequencyTerm([10.5, 25.2], beta=4e2)
ONE = ef.FrequencyTerm([1.0], beta=100.0)
BOUNDS = [(-0.1, 0.2), (0.0, 0.5)]
PRIOR = ef.GaussianPrior(["a", "b"], [0.0, 0.2], [0.1, 0.3], BOUNDS)
INSIDE, OUTSIDE = [0.05, 0.1], [0.05, 0.6]


class Linear:
    """Frequencies linear in a and b; it counts rows and may overwrite its input."""

    variables = ef.modal_variables(2)

    def __init__(self, overwrite=False):
        self.rows, self.overwrite = [], overwrite

    def __call__(self, parameters):
        frequencies = F0 * (1 + np.column_stack([parameters["a"], parameters["b"]]))
        self.rows.append(len(frequencies))
        if self.overwrite:
            for value in parameters.values():
                value[:] = 1e9
        return ef.ModalSolution(frequencies)


def negative_a(parameters, modes):
    return np.where(parameters["a"] > 0.1, -INF, -3.0 * parameters["a"])


def test_row_is_posterior_prior_terms_frequencies():
    posterior = ef.LogPosterior(Linear(), [TERM, negative_a], PRIOR)
    theta = np.array([INSIDE, [-0.09, 0.49], [0.0, 0.01]])
    frequencies = F0 * (1 + theta)
    prior = stats.truncnorm.logpdf(theta[:, 0], -1, 2, 0, 0.1)
    prior += stats.truncnorm.logpdf(theta[:, 1], -2 / 3, 1, 0.2, 0.3)
    measured = np.array([10.5, 25.2])
    fit = stats.norm.logpdf(frequencies, measured, measured / 20).sum(axis=1)
    densities = [prior + fit - 3 * theta[:, 0], prior, fit, -3 * theta[:, 0]]
    rows = posterior(theta)
    assert_allclose(rows, np.c_[(*densities, frequencies)], rtol=1e-12)
    assert_allclose(posterior.unfold(rows)["frequency"], frequencies, rtol=1e-12)
    assert posterior.term_names == ("frequency", "negative_a")
    terms = "log_likelihood[frequency]", "log_likelihood[negative_a]"
    modes = "frequency[1]", "frequency[2]"
    assert posterior.labels == ("log_posterior", "log_prior", *terms, *modes)
    assert_array_equal(rows[:, posterior.columns["frequency"]], rows[:, 4:])
    same = pickle.loads(pickle.dumps(posterior))
    assert_array_equal(same(theta), rows)


def test_a_batch_of_any_size_and_memory_order_equals_a_loop():
    for shape in ((), (0,), (1,), (4,)):
        small = ef.LogPosterior(Linear(), TERM, PRIOR)
        assert small(np.full((*shape, 2), 0.1)).shape == (*shape, 5)
    posterior = ef.paper.mass_spring().posterior
    theta = posterior.start(60, 1) * np.random.default_rng(2).uniform(0.9, 1.1, (60, 5))
    rows = posterior(theta)
    assert np.isfinite(rows[:, 0]).any() and (rows[:, 0] == -INF).any()
    for other in (posterior(np.asfortranarray(theta)), [posterior(t) for t in theta]):
        assert_allclose(rows, other, rtol=1e-11)


def test_rows_outside_are_rejected_and_never_reach_the_model():
    model = Linear()
    posterior = ef.LogPosterior(model, TERM, PRIOR)
    batch = np.array([OUTSIDE, INSIDE, [-0.2, 0.1], [np.nan, 0.1], [0.2, 0.5], OUTSIDE])
    rows = posterior(batch)
    assert model.rows == [2]
    out = [0, 2, 3, 5]
    assert_array_equal(rows[out], [[-INF] * 3 + [np.nan] * 2] * 4)
    assert_allclose(rows[[1, 4]], posterior(batch[[1, 4]]))
    posterior(batch[out])
    posterior(OUTSIDE)
    assert model.rows == [2, 2]


@pytest.mark.parametrize("batch", [[INSIDE, OUTSIDE], INSIDE])
def test_theta_and_other_models_survive_one_that_overwrites_its_input(batch):
    theta = np.array(batch, order="F")
    rows = ef.LogPosterior(Linear(overwrite=True), TERM, PRIOR)(theta)
    assert_array_equal(theta, batch)
    assert_array_equal(rows, ef.LogPosterior(Linear(), TERM, PRIOR)(batch))
    pair = {"a": (Linear(overwrite=True), TERM), "b": (Linear(), TERM)}
    joint = ef.LogPosterior.joint(pair, PRIOR)(np.atleast_2d(theta))
    assert_array_equal(joint[:, 2], joint[:, 3])


@pytest.mark.parametrize("bad", [np.nan, INF])
def test_a_log_likelihood_of_nan_or_infinity_is_an_error_at_its_place(bad):
    terms = [TERM, lambda p, modes: np.where(p["a"] == 0.05, bad, -INF)]
    posterior = ef.LogPosterior(Linear(), terms, PRIOR)
    rejected = posterior([0.1, 0.2])  # its frequencies are kept
    assert_array_equal(np.isfinite(rejected), [False, True, True, False, True, True])
    with pytest.raises(ValueError, match=r"\{'a': 0.05, 'b': 0.1\}"):
        posterior([OUTSIDE, [0.1, 0.2], INSIDE])


SPRINGS = ef.MassSpringModel([1.0, 1.0], {"k1": (0, 1, 9.0), "k2": (1, 2, 4.0)})
MATRICES = ef.MatrixModel(
    np.eye(2), np.eye(2), {"s": np.eye(2), "t": np.eye(2)}, n_modes=1
)


def within(parameters):
    """A model that holds within its bounds only."""
    return ef.ModalSolution(parameters["k"][:, None])


within.names, within.bounds = ("k",), {"k": (1.0, 2.0)}


@pytest.mark.parametrize(
    ("model", "terms", "marginals", "named"),
    [
        (SPRINGS, ONE, {"k3": (1, 9)}, "k3"),  # which no spring has
        (MATRICES, ONE, {"s": (1, 9)}, "t"),  # which the prior lacks
        (SPRINGS, ONE, {"k2": stats.norm(5, 1)}, "k2"),  # it may be below zero
        (ef.FunctionModel(abs, 2), ef.FrequencyTerm([1, 2, 3.0], sd=0.1),
         {"k1": (1, 9)}, "3 .*2"),
        (Linear(), [TERM, TERM], {"a": (0, 0.1), "b": (0, 0.1)}, "frequency"),
        (within, ONE, {"k": (0.9, 2.0)}, "k.*1, 2"),
        (within, ONE, {"k": (1.0, 2.1)}, "k.*1, 2"),
        (SPRINGS, ef.FrequencyTerm([1.0], discrepancy="noise"), {"k1": (1, 9)},
         "'noise'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_named(model, terms, marginals, named):
    with pytest.raises(ValueError, match=named):
        ef.LogPosterior(model, terms, ef.IndependentPrior(marginals))


@pytest.mark.parametrize(("n_modes", "stored"), [(None, [10.05]), (2, [10.05, 20])])
def test_a_function_of_unknown_n_modes_stores_those_of_the_terms(n_modes, stored):
    model = ef.FunctionModel(lambda p: [10.0 + p["a"], 20.0], n_modes)
    assert_allclose(ef.LogPosterior(model, ONE, PRIOR)(INSIDE)[3:], stored)


@pytest.mark.parametrize("frequencies", [[1.0, 2.0], [[1.0, 2.0]] * 2])
def test_a_model_that_returns_a_wrong_shape_is_refused(frequencies):
    solution = ef.ModalSolution(np.array(frequencies))
    posterior = ef.LogPosterior(lambda parameters: solution, TERM, PRIOR)
    with pytest.raises(ValueError, match="model"):
        posterior([INSIDE] * 3)


def test_starts_are_draws_of_the_prior_and_repeat_with_their_seed():
    posterior = ef.LogPosterior(Linear(), TERM, PRIOR)
    first, again, other = (posterior.start(500, seed) for seed in (3, 3, 4))
    assert first.shape == (500, 2) and np.isfinite(PRIOR.logpdf(first)).all()
    assert_array_equal(first, again)
    assert not np.isin(first, other).any()
    sd = PRIOR.sample(np.random.default_rng(9), 20_000).std(axis=0)
    assert_allclose(first.std(axis=0), sd, rtol=0.15)


@pytest.mark.parametrize("number", [2, 256])
def test_a_batch_that_fails_names_its_parameter_sets_but_not_hundreds(number):
    with pytest.raises(ArithmeticError, match="division") as caught:
        ef.LogPosterior(lambda p: 1 / 0, TERM, PRIOR)([INSIDE] * number)
    assert 1 < caught.value.__notes__[0].count("'a': 0.05, 'b': 0.1") < 20


@pytest.mark.parametrize(
    "function", [lambda p: [float(p["a"]), 2.0], lambda p: [p["a"], p["b"]]]
)
def test_a_function_of_one_parameter_set_is_told_how_it_becomes_a_model(function):
    with pytest.raises(TypeError) as caught:
        ef.LogPosterior(function, TERM, PRIOR)([INSIDE] * 2)
    assert "FunctionModel(function)" in f"{caught.value}{caught.value.__notes__}"


@pytest.mark.parametrize(
    ("function", "remedied"),
    [
        (lambda p: p["A"], True),
        (lambda p: [p[0], p[1]], True),
        (lambda p: {}["a"], False),  # a fault of another kind
    ],
)
def test_a_model_that_asks_for_a_wrong_name_is_told_the_right_ones(function, remedied):
    with pytest.raises(KeyError) as caught:
        ef.LogPosterior(ef.FunctionModel(function), TERM, PRIOR)(INSIDE)
    place, *names = caught.value.__notes__
    assert "'a': 0.05" in place
    assert ["a, b" in note for note in names] == [True] * remedied


def test_an_empty_unit_is_none():
    posterior = ef.LogPosterior(Linear(), TERM, PRIOR, units={"a": "", "b": "m"})
    run = ef.run(posterior, ef.DEMCMove(), 8, 10, seed=1, ensembles=1)
    figure = ef.figures.plot_prior_posterior(run, units={"b": ""})
    assert [axes.get_xlabel() for axes in figure.axes] == ["a", "b"]
    figure = ef.figures.plot_prior_posterior(run)
    assert [axes.get_xlabel() for axes in figure.axes] == ["a", "b [m]"]
    with pytest.raises(TypeError, match="units"):
        ef.LogPosterior(Linear(), TERM, PRIOR, units={"a": 1})
