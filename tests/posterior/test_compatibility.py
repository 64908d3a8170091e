"""A response of another kind than modes: all that a user writes, and what follows."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef

# The user's code: a cantilever under an end load, measured at three points
POINTS, MEASURED, SD = np.array([0.4, 0.7, 1.0]), [1.1, 2.9, 5.2], 0.2


def deflect(parameters):
    """Deflection in mm of a cantilever of length 1 m, EI in kNm2, load 1 kN."""
    shape = POINTS**2 * (3 - POINTS) / 6 * 1e3
    return {"deflection": shape / parameters["EI"][:, None]}


deflect.variables = {"deflection": ef.Variable({"point": ["a", "b", "c"]}, "mm")}


class DeflectionTerm(ef.likelihoods.term.Term):
    name = "gauges"
    reads = deflect.variables
    observed = {"deflection": np.array(MEASURED)}

    def deviations(self, parameters, response):
        r = response["deflection"] - MEASURED
        return r, np.full(r.shape, SD)

    def restore(self, deviations):
        return MEASURED + deviations


prior = ef.IndependentPrior({"EI": (20, 200)})
posterior = ef.LogPosterior(deflect, DeflectionTerm(), prior)


def test_rows_hold_the_declared_variables_and_say_what_is_what():
    (row,) = posterior([[70.0]])
    expected = POINTS**2 * (3 - POINTS) / 6 * 1e3 / 70
    assert_allclose(row[posterior.columns["deflection"]], expected, rtol=1e-12)
    fit = stats.norm.logpdf(MEASURED, expected, SD).sum()
    assert_allclose(row[:3], [fit - np.log(180), -np.log(180), fit], rtol=1e-12)
    assert posterior.labels[3:] == (*(f"deflection[{point}]" for point in "abc"),)


def test_groups_and_units_follow_the_declaration_and_the_posterior_least_squares():
    run = ef.run(posterior, ef.DEMCMove(), 8, 300, ensembles=2, seed=1)
    idata = ef.to_inference_data(run, posterior, discard=50)
    response = idata["response"]["deflection"]
    assert response.dims == ("chain", "draw", "point")
    assert response.point.values.tolist() == ["a", "b", "c"]
    EI = idata["posterior"]["EI"]
    assert_allclose(response.sel(point="c"), 1e3 / 3 / EI, rtol=1e-12)
    constants = idata["constant_data"]["initial_deflection"]
    assert constants.attrs["units"] == "mm" and constants.dims == ("point",)
    assert idata["observed_data"]["deflection"].values.tolist() == MEASURED
    logs = idata["log_likelihood"]["gauges"]
    assert_allclose(logs, stats.norm.logpdf(MEASURED, response, SD), rtol=1e-12)
    noisy = idata["new_measurement"]["deflection"]
    assert (noisy - response).std().item() == pytest.approx(SD, rel=0.05)
    weights = POINTS**2 * (3 - POINTS) / 6 * 1e3
    flexibility = weights @ MEASURED / (weights @ weights)
    assert_allclose((1 / EI.values).mean(), flexibility, rtol=8e-3)


GAP = {"gap": ef.Variable({})}
BACKWARDS = {"deflection": ef.Variable({"point": ["c", "b", "a"]})}
FEWER = {"deflection": ef.Variable({"point": ["a", "b"]})}
FROM_ZERO = {"frequency": ef.Variable({"mode": range(4)}, "Hz")}
FREQUENCY = ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1)


@pytest.mark.parametrize(
    ("variables", "term", "named"),
    [
        (GAP, DeflectionTerm(), "'gauges'.*'deflection'"),
        (FEWER, DeflectionTerm(), "3 points"),
        (BACKWARDS, DeflectionTerm(), "point .'a', 'b', 'c'"),
        (FROM_ZERO, FREQUENCY, "'frequency'.*mode"),
    ],
)
def test_a_term_names_what_the_response_lacks(variables, term, named):
    model = ef.FunctionModel(lambda p: p["EI"], variables=variables)
    with pytest.raises(ValueError, match=named):
        ef.LogPosterior(model, term, prior)


def posterior_of(names=("w",), dims=("x",), term="gauges", parameter="EI"):
    variables = {name: ef.Variable(dict.fromkeys(dims, [1, 2])) for name in names}

    def compare(parameters, response):
        return np.zeros(len(parameters[parameter]))

    compare.name = term
    model = ef.FunctionModel(lambda p: np.ones(2), variables=variables)
    return ef.LogPosterior(model, compare, ef.IndependentPrior({parameter: (1, 2)}))


@pytest.mark.parametrize(
    ("changed", "argument"),
    [
        ({"parameter": "E/rho"}, "prior"),
        ({"parameter": "x"}, "model"),
        ({"names": ["chain"]}, "model"),
        ({"dims": ["step"]}, "model"),
        ({"term": "draw"}, "terms"),
    ],
)
def test_names_that_arviz_has_no_place_for_are_refused(changed, argument):
    assert posterior_of()([1.5]).shape == (5,)
    with pytest.raises(ValueError, match=f"^{argument}: "):
        posterior_of(**changed)


class Flat:
    """A prior of a user: uniform between its bounds."""

    names = "a", "b"

    def __init__(self, bounds):
        self.bounds = bounds

    def logpdf(self, theta):
        low, high = self.bounds.T
        inside = ((theta >= low) & (theta <= high)).all(axis=1)
        return np.where(inside, -np.log(high - low).sum(), -np.inf)

    def sample(self, rng, size):
        return rng.uniform(*self.bounds.T, (size, 2))


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ([[1, 2], [3, 4]], "floats"),
        (np.array([[1, 2], [3, 4]]), "floats"),
        (np.array([[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]), r"\(2, 2\)"),
        (np.array([[1.0, 2.0], [4.0, 3.0]]), r"low < high.*'b'"),
        (np.array([[1.0, np.nan], [3.0, 4.0]]), r"low < high.*'a'"),
    ],
)
def test_bounds_of_a_prior_are_checked(bounds, said):
    with pytest.raises((TypeError, ValueError), match=f"prior: .*{said}"):
        ef.LogPosterior(lambda p: {}, lambda p, r: -p["a"], Flat(bounds))


def test_names_of_a_prior_are_different():
    prior = Flat(np.array([[1.0, 2.0], [3.0, 4.0]]))
    prior.names = "a", "a"
    with pytest.raises(ValueError, match="different names"):
        ef.LogPosterior(lambda p: {}, lambda p, r: -p["a"], prior)
