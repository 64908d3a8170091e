"""Priors are normalised, cut at their bounds, drawn from and differentiated."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import integrate, stats

import emcee_femu as ef

INF = np.inf


def check_cut_law(prior, uncut, low, high, start, stop):
    """Check the second of two parameters; the first is 0.5 and has density 1 there.

    It is the uncut density times a constant, integrates to one, and is drawn from.
    """

    def logpdf(values):
        return prior.logpdf(np.column_stack([0.5 + 0 * values, values]))

    assert prior.bounds.tolist() == [[0.0, 1.0], [low, high]]
    x = np.linspace(start, stop, 8_001)
    constant = (logpdf(x) - uncut.logpdf(x))[1:-1]
    assert_allclose(constant, constant[0], rtol=1e-9, atol=1e-9)
    ends = np.array([end for end in (low, high) if np.isfinite(end)])
    assert np.isfinite(logpdf(ends)).all()
    beyond = np.nextafter([low, high], [-INF, INF])[np.isfinite([low, high])]
    assert (logpdf(beyond) == -INF).all()
    cumulative = integrate.cumulative_simpson(np.exp(logpdf(x)), x=x, initial=0)
    assert cumulative[-1] == pytest.approx(1, abs=1e-6)
    draws = prior.sample(np.random.default_rng(7), 4_000)
    assert ((draws >= prior.bounds[:, 0]) & (draws <= prior.bounds[:, 1])).all()
    assert abs(np.corrcoef(draws.T)[0, 1]) * np.sqrt(4_000) < 5
    assert stats.kstest(draws[:, 0], stats.uniform.cdf).pvalue > 1e-4
    test = stats.kstest(draws[:, 1], lambda value: np.interp(value, x, cumulative))
    assert test.pvalue > 1e-4


@pytest.mark.parametrize(("mean", "sd"), [(3e-8, 1e-8), (2.1e11, 1e10)])
@pytest.mark.parametrize(
    "cut",  # in standard deviations from the mean
    [
        (-1.0, 2.0),
        (-1e-3, 2e-3),
        (30.0, 31.0),
        (-38.0, -37.5),
        (-INF, -3.0),
        (40.0, INF),
    ],
)
def test_the_gaussian_is_cut_at_its_bounds(cut, mean, sd):
    low, high = mean + sd * np.array(cut)
    flat = [0.5, mean], [1e6, sd], [(0.0, 1.0), (low, high)]
    start = low if low > -INF else high - 9 * sd
    stop = high if high < INF else max(low, mean) + 9 * sd
    prior = ef.GaussianPrior(["flat", "a"], *flat)
    check_cut_law(prior, stats.norm(mean, sd), low, high, start, stop)
    assert ef.GaussianPrior(["a"], [mean], sd).bounds.tolist() == [[-INF, INF]]


MARGINALS = {
    "u": stats.uniform(1e3, 4e3),
    "ln": stats.lognorm(0.5, scale=3e-8),
    "tn": stats.truncnorm(-1.0, 3.0, loc=2.1e11, scale=1e10),
}


def test_an_independent_prior_is_its_marginals_in_their_order():
    pair = {"u": (1e3, 5e3)}  # which is flat
    prior = ef.IndependentPrior(MARGINALS | pair)
    assert prior.names == (*MARGINALS,)
    assert_array_equal(prior.bounds, [m.support() for m in MARGINALS.values()])
    draws = prior.sample(np.random.default_rng(3), 4000)
    assert draws.shape == (4000, 3)
    expected = np.zeros(4000)
    for (name, marginal), column in zip(MARGINALS.items(), draws.T, strict=True):
        assert stats.kstest(column, marginal.cdf).pvalue > 1e-4, name
        expected += marginal.logpdf(column)
    assert_allclose(prior.logpdf(draws), expected, rtol=1e-12)
    assert_allclose(prior.logpdfs(draws).sum(axis=1), expected, rtol=1e-12)
    correlation = np.corrcoef(draws.T)[np.triu_indices(3, 1)]
    assert (abs(correlation) * np.sqrt(4000) < 5).all()
    theta = np.tile([2e3, 3e-8, 2.1e11], (3, 1)) + np.diag([-1001, -4e-8, 4e10])
    assert (prior.logpdf(theta) == -INF).all()


@pytest.mark.parametrize(
    ("marginal", "bounds"),
    [
        (stats.lognorm(0.5), (0.5, 1.5)),
        (stats.lognorm(0.5, scale=2.1e11), (1e11, INF)),
        (stats.expon(), (-1.0, 2.0)),  # wider than the support
        (stats.norm(), (-9.0, -8.0)),
        (stats.norm(), (9.0, 10.0)),  # where probabilities from below are all one
    ],
)
def test_a_cut_marginal_is_renormalised_and_drawn_from(marginal, bounds):
    low, high = np.clip(bounds, *marginal.support())
    marginals = {"u": stats.uniform(), "a": marginal}
    prior = ef.IndependentPrior(marginals, bounds={"a": bounds})
    stop = high if high < INF else marginal.isf(1e-13)
    again = pickle.loads(pickle.dumps(prior))
    check_cut_law(again, marginal, low, high, low, stop)


@pytest.mark.parametrize(
    ("marginal", "slope"),
    [
        (stats.norm(3, 2), lambda x: (3 - x) / 4),
        (stats.lognorm(0.3, 0, 1e9), lambda x: -(1 + np.log(x / 1e9) / 0.09) / x),
        (stats.beta(1, 3), lambda x: -2 / (1 - x)),
    ],
)
def test_gradients_are_those_of_the_densities(marginal, slope):
    low, high = marginal.ppf([0.1, 0.8])
    prior = ef.IndependentPrior({"x": marginal}, bounds={"x": (low, high)})
    model = ef.FunctionModel(lambda p: 1.0, variables={"y": ef.Variable({})})
    posterior = ef.LogPosterior(model, lambda p, y: np.zeros(len(p["x"])), prior)
    x = np.linspace(low, high, 7)[:, None]  # on the bounds too
    assert_allclose(posterior.gradient(x)[1], slope(x), 1e-6, 1e-7 / (high - low))


@pytest.mark.parametrize(
    ("marginal", "bounds", "named"),
    [
        (stats.lognorm(0.2), {"E": (1e9, 2e9)}, "'E'"),  # no probability is there
        ((40e3, 8e3), None, r"marginals\['E'\]"),  # a mean and a standard deviation
    ],
)
def test_bounds_that_hold_nothing_are_refused(marginal, bounds, named):
    with pytest.raises(ValueError, match=named):
        ef.IndependentPrior({"E": marginal}, bounds=bounds)


class _Norm(stats.rv_continuous):
    """A law of one's own by the name of another, twice as wide."""

    def _logpdf(self, x):
        return stats.norm.logpdf(x, 0, 2)


@pytest.mark.parametrize("order", [1, -1])
def test_marginals_of_one_family_are_evaluated_together_each_by_its_own_law(order):
    laws = [
        *(stats.uniform(low, 4) for low in (-2, -1)),
        *(stats.lognorm(sd, scale=2) for sd in (0.3, 0.6)),
        *(stats.lognorm(s=sd, loc=-3) for sd in (0.3, 0.6)),
        *(stats.norm(mean, 1) for mean in (0, 1)),
        *(_Norm(name="norm")(loc=mean, scale=1) for mean in (0, 1)),
        *(stats.rv_histogram(([1, n], [-3, 0, 3]))() for n in (1, 5)),
    ][::order]
    prior = ef.IndependentPrior({f"x{i}": law for i, law in enumerate(laws)})
    theta = np.random.default_rng(1).uniform(-3, 3, (50, len(laws)))
    alone = np.stack([law.logpdf(x) for law, x in zip(laws, theta.T, strict=True)], 1)
    assert_allclose(prior.logpdfs(theta), alone, rtol=1e-14)
