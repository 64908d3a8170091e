import pickle

import numpy as np
import pytest
from scipy import integrate, stats

import emcee_femu as ef
from emcee_femu import GaussianPrior, IndependentPrior, uniform_between

INF = np.inf
CUTS = {  # (low, high) in standard deviations from the mean
    "around the mean": (-1.0, 2.0),
    "narrow": (-1e-3, 2e-3),
    "far upper tail": (30.0, 31.0),
    "far lower tail": (-38.0, -37.5),
    "half-infinite above": (-0.5, INF),
    "half-infinite below": (-INF, -3.0),
    "half-infinite far tail": (40.0, INF),
    "mean outside": (2.0, 5.0),
}
UNITS = {"1": (0.0, 1.0), "1e-8": (3e-8, 1e-8), "1e11": (2.1e11, 1e10)}


def check_cut_law(prior, uncut, low, high, start, stop):
    """Check the second of two parameters; the first is 0.5 and has density 1 there.

    Its density is the uncut one times a constant from low to high, integrates to one
    from start to stop, is zero an ulp beyond the ends, and is that of the draws.
    """

    def logpdf(values):
        return prior.logpdf(np.column_stack([0.5 + 0 * values, values]))

    assert prior.bounds.tolist() == [[0.0, 1.0], [low, high]]
    x = np.linspace(start, stop, 40_001)
    constant = (logpdf(x) - uncut.logpdf(x))[1:-1]
    np.testing.assert_allclose(constant, constant[0], rtol=1e-9, atol=1e-9)
    ends = np.array([end for end in (low, high) if np.isfinite(end)])
    assert np.isfinite(logpdf(ends)).all()
    beyond = np.nextafter([low, high], [-INF, INF])[np.isfinite([low, high])]
    assert (logpdf(beyond) == -INF).all()
    cumulative = integrate.cumulative_simpson(np.exp(logpdf(x)), x=x, initial=0)
    assert cumulative[-1] == pytest.approx(1, abs=1e-8)
    draws = prior.sample(np.random.default_rng(7), 20_000)
    assert ((draws >= prior.bounds[:, 0]) & (draws <= prior.bounds[:, 1])).all()
    assert abs(np.corrcoef(draws.T)[0, 1]) * np.sqrt(20_000) < 5
    assert stats.kstest(draws[:, 0], stats.uniform.cdf).pvalue > 1e-4
    found = stats.kstest(draws[:, 1], lambda value: np.interp(value, x, cumulative))
    assert found.pvalue > 1e-4


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("cut", CUTS)
def test_the_gaussian_is_cut_at_its_bounds(cut, unit):
    mean, sd = UNITS[unit]
    low, high = mean + sd * np.array(CUTS[cut])
    flat = [0.5, mean], [1e6, sd], [(0.0, 1.0), (low, high)]
    start = low if low > -INF else high - 9 * sd
    stop = high if high < INF else max(low, mean) + 9 * sd
    prior = GaussianPrior(["flat", "a"], *flat)
    check_cut_law(prior, stats.norm(mean, sd), low, high, start, stop)


def test_without_bounds_the_gaussian_is_a_sum_of_norm_logpdf():
    mean, sd = np.array([4e3, 3e-8, 2.1e11, -1.0]), np.array([5e2, 1e-8, 1e10, 1e-3])
    prior = GaussianPrior(["k", "I", "E", "c"], mean, sd)
    theta = mean + sd * np.random.default_rng(1).normal(0, 3, (50, 4))
    expected = stats.norm.logpdf(theta, mean, sd).sum(axis=1)
    np.testing.assert_allclose(prior.logpdf(theta), expected, rtol=1e-13)
    assert prior.names == ("k", "I", "E", "c")
    np.testing.assert_array_equal(prior.bounds, [[-INF, INF]] * 4)


def test_gaussian_copies_its_arguments():
    mean, sd, bounds = np.array([1.0]), np.array([2.0]), np.array([[-1.0, 3.0]])
    prior = GaussianPrior(["a"], mean, sd, bounds)
    before = prior.logpdf(np.array([[0.5]]))
    for array in (mean, sd, bounds):
        array += 1.0
    np.testing.assert_array_equal(prior.logpdf(np.array([[0.5]])), before)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"mean": [1.0]}, ValueError, "mean: .*2 names"),
        ({"mean": 1.0}, ValueError, r"mean: expected 1 dimension"),
        ({"mean": [1.0, np.nan]}, ValueError, r"mean: .*nan at index \(1,\)"),
        ({"mean": ["1", "2"]}, TypeError, "mean: expected real numbers"),
        ({"sd": [1.0, 1.0, 1.0]}, ValueError, "sd: "),
        ({"sd": 0.0}, ValueError, "sd: expected numbers above zero"),
        ({"sd": [1.0, -1.0]}, ValueError, r"sd: .*-1.0 at index \(1,\)"),
        ({"bounds": [(0, 9)]}, ValueError, r"bounds: .*\(2, 2\)"),
        ({"bounds": (0, 9)}, ValueError, r"bounds: .*\(2, 2\)"),
        ({"bounds": [(0, 9), (9, 0)]}, ValueError, "bounds: low < high for 'I'"),
        ({"bounds": [(5, 5), (0, 9)]}, ValueError, "bounds: low < high for 'k'"),
        ({"bounds": [(0, 9), (np.nan, 9)]}, ValueError, "bounds: low < high for 'I'"),
        ({"bounds": {"k": (0, 9), "I": (0, 9)}}, TypeError, "bounds: .* the order of"),
        ({"bounds": [(0, 9), (None, 9)]}, TypeError, "bounds: expected real numbers"),
        ({"names": ["k", "k"]}, ValueError, r"names: .*\['k'\]"),
        ({"names": "kI"}, TypeError, r"names: .*write \['kI'\]"),
        ({"names": []}, ValueError, "names: expected at least one"),
        ({"names": ["k", ""]}, TypeError, "names: expected non-empty strings"),
    ],
)
def test_gaussian_refuses(change, error, message):
    good = {"names": ["k", "I"], "mean": [1.0, 2.0], "sd": [1.0, 2.0]}
    good["bounds"] = [(0.0, 9.0), (0.0, 9.0)]
    GaussianPrior(**good)
    with pytest.raises(error, match=message.replace("low <", ".*low <")):
        GaussianPrior(**good | change)


MARGINALS = {
    "u": stats.uniform(1e3, 4e3),
    "ln": stats.lognorm(0.5, scale=3e-8),
    "tn": stats.truncnorm(-1.0, 3.0, loc=2.1e11, scale=1e10),
}


@pytest.mark.parametrize("order", [("u", "ln", "tn"), ("tn", "u", "ln")])
def test_independent_prior_is_its_marginals_in_their_order(order):
    prior = IndependentPrior({name: MARGINALS[name] for name in order})
    assert prior.names == order
    np.testing.assert_array_equal(prior.bounds, [MARGINALS[n].support() for n in order])
    draws = prior.sample(np.random.default_rng(3), 4000)
    assert draws.shape == (4000, 3)
    expected = np.zeros(4000)
    for name, column in zip(order, draws.T, strict=True):
        assert stats.kstest(column, MARGINALS[name].cdf).pvalue > 1e-4, name
        expected += MARGINALS[name].logpdf(column)
    np.testing.assert_allclose(prior.logpdf(draws), expected, rtol=1e-14)
    correlation = np.corrcoef(draws.T)[np.triu_indices(3, 1)]
    assert (abs(correlation) * np.sqrt(4000) < 5).all()


@pytest.mark.parametrize(
    ("column", "value"), [(0, 999.0), (0, 5001.0), (1, -1e-9), (2, 1.9e11), (2, 2.5e11)]
)
def test_independent_prior_is_minus_infinity_outside_one_support(column, value):
    prior = IndependentPrior(MARGINALS)
    theta = np.array([[2e3, 3e-8, 2.1e11]] * 2)
    theta[1, column] = value
    logpdf = prior.logpdf(theta)
    assert np.isfinite(logpdf[0]) and logpdf[1] == -INF


@pytest.mark.parametrize(
    ("marginals", "error", "message"),
    [
        ({"a": stats.norm}, TypeError, r"marginals\['a'\]: .*frozen"),
        ({"a": stats.poisson(3)}, TypeError, r"marginals\['a'\]: .*continuous"),
        ({"a": stats.norm(), "b": 3.0}, TypeError, r"marginals\['b'\]: .*3.0"),
        ({"a": (0.0, 1.0)}, TypeError, r"marginals\['a'\]: "),
        ({"a": stats.multivariate_normal([0, 0])}, TypeError, r"marginals\['a'\]: "),
        ({"a": stats.norm(0, -1)}, ValueError, "'a'.*nan"),
        ({"a": stats.norm([0, 1], 1)}, ValueError, "bounds: "),
        ([stats.norm()], TypeError, "marginals: .*list"),
        ({}, ValueError, "marginals: expected at least one"),
        ({1: stats.norm()}, TypeError, "marginals: expected non-empty strings"),
    ],
)
def test_independent_prior_refuses(marginals, error, message):
    with pytest.raises(error, match=message):
        IndependentPrior(marginals)


CUT_MARGINALS = {  # marginal, bounds given, bounds that result
    "lognormal": (stats.lognorm(0.5), (0.5, 1.5), (0.5, 1.5)),
    "one-sided": (stats.lognorm(0.5, scale=2.1e11), (1e11, INF), (1e11, INF)),
    "wider than the support": (stats.expon(), (-1.0, 2.0), (0.0, 2.0)),
    "upper tail": (stats.norm(3e-8, 1e-9), (4e-8, 4.1e-8), (4e-8, 4.1e-8)),
    "lower tail": (stats.norm(), (-9.0, -8.0), (-9.0, -8.0)),
}


@pytest.mark.parametrize("case", CUT_MARGINALS)
def test_a_cut_marginal_is_renormalised_and_drawn_from(case):
    marginal, given, (low, high) = CUT_MARGINALS[case]
    prior = IndependentPrior({"u": stats.uniform(), "a": marginal}, bounds={"a": given})
    stop = high if high < INF else marginal.isf(1e-13)
    again = pickle.loads(pickle.dumps(prior))
    check_cut_law(again, marginal, low, high, low, stop)


@pytest.mark.parametrize(
    ("bounds", "error", "message"),
    [
        ({"F": (0.0, 1.0)}, ValueError, r"bounds: no parameter \['F'\]"),
        ({"E": (1.5, 0.5)}, ValueError, "bounds: .*low < high for 'E'"),
        ({"E": (np.nan, 0.5)}, ValueError, "bounds: .*low < high for 'E'"),
        ({"E": ("a", "b")}, TypeError, "bounds: expected real"),
        ({"E": 0.5}, ValueError, r"bounds: .*\(1, 2\)"),
        ([(0.5, 1.5)], TypeError, "bounds: expected"),
        ({"E": (-2.0, -1.0)}, ValueError, "'E' has no probability"),
        ({"E": (1e9, 2e9)}, ValueError, "'E' has no probability"),
    ],
)
def test_wrong_bounds_of_marginals_are_refused(bounds, error, message):
    with pytest.raises(error, match=message):
        IndependentPrior({"E": stats.lognorm(0.2)}, bounds=bounds)


def test_a_model_that_holds_within_bounds_takes_a_lognormal_that_is_cut():
    model = ef.FunctionModel(lambda p: [p["E"]], n_modes=1)
    object.__setattr__(model, "bounds", {"E": (0.5, 1.5)})
    parts = model, ef.FrequencyTerm([1.0], relative_sd=0.1)
    with pytest.raises(ValueError, match=r"IndependentPrior.*bounds=.'E': \(0.5, 1.5"):
        ef.LogPosterior(*parts, IndependentPrior({"E": stats.lognorm(0.2)}))
    prior = IndependentPrior({"E": stats.lognorm(0.2)}, bounds={"E": (0.5, 1.5)})
    rows = ef.LogPosterior(*parts, prior)(np.array([[1.0], [1.6]]))
    assert np.isfinite(rows[0, 0]) and rows[1, 0] == -INF


def test_uniform_between_is_flat_from_low_to_high():
    uniform = uniform_between(1000.0, 5000.0)
    assert uniform.support() == (1000.0, 5000.0)
    x = np.array([999.9, 1000.0, 2345.0, 5000.0, 5000.1])
    flat = -np.log(4000.0)
    np.testing.assert_allclose(uniform.logpdf(x), [-INF, flat, flat, flat, -INF])


@pytest.mark.parametrize(
    ("low", "high", "error", "message"),
    [
        (5.0, 1.0, ValueError, "low: expected below high = 1, got 5"),
        (1.0, 1.0, ValueError, "low: "),
        (0.0, INF, ValueError, "high: expected finite"),
        (np.nan, 1.0, ValueError, "low: expected finite"),
        ("0", 1.0, TypeError, "low: expected real"),
        ([0.0, 1.0], 2.0, ValueError, r"low: expected 0 dimension"),
    ],
)
def test_uniform_between_refuses(low, high, error, message):
    with pytest.raises(error, match=message):
        uniform_between(low, high)
