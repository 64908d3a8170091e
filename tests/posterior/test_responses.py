"""A response of another kind than modes: all that a user writes, and what follows."""

import copy
import dataclasses
import pickle
import warnings
from pathlib import Path

import arviz
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import emcee_femu as ef
from emcee_femu.interfaces import Pairing, read
from emcee_femu.results.arviz_objects import dataset

# --- the user's code: a cantilever under an end load, measured at three points
POINTS, MEASURED, SD = np.array([0.4, 0.7, 1.0]), [1.1, 2.9, 5.2], 0.2


def deflect(parameters):
    """Deflection in mm of a cantilever of length 1 m, EI in kNm2, load 1 kN."""
    shape = POINTS**2 * (3 - POINTS) / 6 * 1e3
    return {"deflection": shape / parameters["EI"][:, None]}


deflect.variables = {"deflection": ef.Variable({"point": ["a", "b", "c"]}, "mm")}


class DeflectionTerm:
    name = "gauges"
    reads = deflect.variables
    observed = {"deflection": np.array(MEASURED)}

    def __call__(self, parameters, response):
        return self.pointwise(parameters, response)["deflection"].sum(axis=1)

    def pointwise(self, parameters, stored):
        logs = stats.norm.logpdf(MEASURED, stored["deflection"], SD)
        return {"deflection": logs}

    def replicate(self, rng, parameters, stored):
        return {"deflection": rng.normal(stored["deflection"], SD)}


prior = ef.IndependentPrior({"EI": ef.uniform_between(20, 200)})
posterior = ef.LogPosterior(deflect, DeflectionTerm(), prior)
# --- the end of it


def test_a_toy_takes_at_most_forty_lines():
    lines = Path(__file__).read_text(encoding="utf-8").splitlines()
    start, end = (i for i, line in enumerate(lines) if line.startswith("# ---"))
    assert end - start <= 40


@pytest.fixture(scope="module")
def idata():
    samplers = ef.run(posterior, nwalkers=8, nsteps=300, ensembles=2, seed=1)
    return ef.to_inference_data(samplers, posterior, discard=50)


def test_rows_hold_the_declared_variables_and_say_what_is_what():
    (row,) = posterior([[70.0]])
    expected = POINTS**2 * (3 - POINTS) / 6 * 1e3 / 70
    assert_allclose(row[posterior.columns["deflection"]], expected, rtol=1e-14)
    fit = stats.norm.logpdf(MEASURED, expected, SD).sum()
    assert_allclose(row[:3], [fit - np.log(180), -np.log(180), fit], rtol=1e-12)
    assert posterior.labels == (
        "log_posterior",
        "log_prior",
        "log_likelihood[gauges]",
        *(f"deflection[{point}]" for point in "abc"),
    )


def test_groups_dimensions_and_units_follow_the_declaration(idata):
    response = dataset(idata, "response")["deflection"]
    assert response.dims == ("chain", "draw", "point")
    assert response.point.values.tolist() == ["a", "b", "c"]
    EI = dataset(idata, "posterior")["EI"]
    assert_allclose(response.sel(point="c"), 1e3 / 3 / EI, rtol=1e-12)
    constants = dataset(idata, "constant_data")["initial_deflection"]
    assert constants.attrs["unit"] == "mm" and constants.dims == ("point",)
    observed = dataset(idata, "observed_data")["deflection"]
    assert observed.values.tolist() == MEASURED
    logs = dataset(idata, "log_likelihood")["gauges"]
    assert_allclose(logs, stats.norm.logpdf(MEASURED, response, SD), rtol=1e-12)
    noisy = dataset(idata, "posterior_predictive")["deflection"]
    assert (noisy - response).std().item() == pytest.approx(SD, rel=0.05)


def test_the_posterior_is_the_one_of_least_squares(idata):
    EI = dataset(idata, "posterior")["EI"].values
    weights = POINTS**2 * (3 - POINTS) / 6 * 1e3
    flexibility = weights @ MEASURED / (weights @ weights)
    assert_allclose((1 / EI).mean(), flexibility, rtol=4e-3)


def test_leave_one_out_takes_the_factors_of_the_likelihood(idata):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # three data leave a large Pareto k
        loo = arviz.loo(idata, var_name="gauges", pointwise=True)
    assert loo.n_data_points == 3


def test_a_term_names_what_the_response_lacks():
    term = DeflectionTerm()
    other = ef.LogPosterior(
        ef.FunctionModel(lambda p: p["EI"], variables={"gap": ef.Variable({})}),
        lambda p, response: read(response, "deflection")[:, 0],
        prior,
    )
    with pytest.raises(TypeError, match=r"no 'deflection'; there are \['gap'\]"):
        other([70.0])
    with pytest.raises(ValueError, match="'gauges' reads 'deflection', which"):
        ef.LogPosterior(other.model, term, prior)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (["a", "b"], "compares 3 of 'deflection' along 'point', but .* returns 2"),
        (
            ["c", "b", "a"],
            r"measured at point \['a', 'b', 'c'\], but",
        ),
    ],
)
def test_other_labels_than_those_measured_are_refused(labels, message):
    variables = {"deflection": ef.Variable({"point": labels})}
    model = ef.FunctionModel(lambda p: np.ones(len(labels)), variables=variables)
    with pytest.raises(ValueError, match=message):
        ef.LogPosterior(model, DeflectionTerm(), prior)


@pytest.mark.parametrize(
    ("returned", "error", "message"),
    [
        ([1.0, 2.0], ValueError, r"'deflection' of shape \(3,\), got \(2,\); at {'EI'"),
        ({"gap": 1.0}, TypeError, r"got no \['deflection'\]; at {'EI'"),
        ("abc", TypeError, "expected real numbers"),
    ],
)
def test_a_function_that_returns_something_else_is_refused(returned, error, message):
    model = ef.FunctionModel(lambda p: returned, variables=deflect.variables)
    with pytest.raises(error, match=message):
        ef.LogPosterior(model, DeflectionTerm(), prior)([70.0])


def posterior_of(names, dims, term="gauges", parameter="EI"):
    variables = {name: ef.Variable(dict.fromkeys(dims, [1, 2])) for name in names}

    def compare(parameters, response):
        return np.zeros(len(parameters[parameter]))

    compare.name = term
    model = ef.FunctionModel(lambda p: np.ones(2), variables=variables)
    bounded = ef.IndependentPrior({parameter: ef.uniform_between(1, 2)})
    return ef.LogPosterior(model, compare, bounded)


@pytest.mark.parametrize(
    ("changed", "argument"),
    [
        ({"parameter": "step"}, "prior"),
        ({"parameter": "E/rho"}, "prior"),
        ({"parameter": "x"}, "prior"),
        ({"names": ["chain"]}, "model"),
        ({"names": ["a/b"]}, "model"),
        ({"names": ["x"]}, "model"),
        ({"dims": ["step"]}, "model"),
        ({"dims": ["lower"]}, "model"),
        ({"term": "draw"}, "terms"),
    ],
)
def test_names_that_arviz_has_no_place_for_are_refused_before_the_run(
    changed, argument
):
    assert posterior_of(["w"], ["x"])([1.5]).shape == (5,)
    with pytest.raises(ValueError, match=f"^{argument}: .*rename"):
        posterior_of(**{"names": ["w"], "dims": ["x"]} | changed)


@pytest.mark.parametrize(
    "observed", [{"gap": np.array(MEASURED)}, {"deflection": np.array(MEASURED[:2])}]
)
def test_measured_values_without_a_variable_are_refused_before_the_run(observed):
    term = DeflectionTerm()
    term.observed = observed
    with pytest.raises(ValueError, match="^terms: 'gauges' observed"):
        ef.LogPosterior(deflect, term, prior)


def test_more_than_was_declared_is_refused_and_labels_count_from_one_or_not():
    def more(parameters):
        return {"w": np.ones((len(parameters["EI"]), 3))}

    more.variables = {"w": ef.Variable({"x": [1, 2]})}
    plain = ef.LogPosterior(more, lambda p, response: np.zeros(len(p["EI"])), prior)
    with pytest.raises(ValueError, match=r"expected 'w' of shape \(1, 2\), got \(1, 3"):
        plain([70.0])
    from_zero = {"frequency": ef.Variable({"mode": range(4)}, "Hz")}
    model = ef.FunctionModel(lambda p: np.ones(4), variables=from_zero)
    with pytest.raises(ValueError, match="'frequency' was measured at mode"):
        ef.LogPosterior(model, ef.FrequencyTerm([1.0, 2.0], relative_sd=0.1), prior)


def test_a_paired_solution_pickles_copies_and_keeps_its_pairing():
    pairing = Pairing(np.ones((1, 2)), np.array([[2, 1]]), np.zeros((1, 2), bool))
    solution = ef.PairedSolution(np.array([[1.0, 2.0]]), np.ones((1, 3, 2)), pairing)
    copies = [pickle.loads(pickle.dumps(solution)), copy.deepcopy(solution)]
    copies.append(dataclasses.replace(solution, frequencies=np.array([[3.0, 4.0]])))
    for each in copies:
        assert_array_equal(each.model_mode, [[2, 1]])
        assert_array_equal(each.shapes, solution.shapes)
    assert copies[2].frequency.tolist() == [[3.0, 4.0]]
