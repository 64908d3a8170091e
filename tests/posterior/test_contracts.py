"""The checkers that CONTRIBUTING.md offers do not accept what is wrong."""

import numpy as np
import pytest
from scipy import stats
from support.contracts import assert_model, assert_prior, assert_term
from support.derivatives import assert_jacobian

import emcee_femu as ef

K = {"k1": np.array([1.0, 2.0, 3.0]), "k2": np.array([2.0, 2.5, 2.0])}
MEASURED, SD = np.array([1.0, 2.0]), 0.3
U = MEASURED + np.array([[0.1, 0.2], [-0.3, 0.1], [0.4, -0.5]])
RESPONSE = {"displacement": U[:, None]}
EXACT = stats.norm.logpdf(U, MEASURED, SD).sum(axis=1)


class Linear:
    """A model with a fault."""

    def __init__(self, fault):
        points = ["a", "b", "c"] if fault == "declared" else ["a", "b"]
        self.variables = {"u": ef.Variable({"point": points}, "mm")}
        self.fault, self.shift = fault, 0.0
        self.names = "k1", "k2"

    def __getstate__(self):
        return vars(self) | {"shift": float(self.fault == "pickled copy")}

    def __call__(self, parameters):
        u = np.stack([parameters["k1"], parameters["k2"]], axis=1) + self.shift
        if self.fault == "same for all":
            u = u[:1].repeat(3, axis=0)
        if self.fault == "k2 by itself":  # a wrapper does not pass it on
            u = parameters["k1"][:, None] * [1.0, 2.0]
        if self.fault == "alone":  # rows are mixed
            u = u + 1e-6 * u.mean(axis=0)
        if self.fault == "changed k1":
            parameters["k1"] *= 1.0 + 1e-12
        return {"u": u}


@pytest.mark.parametrize(
    "fault",
    ["same for all", "alone", "changed k1", "declared", "pickled copy", "k2 by itself"],
)
def test_a_wrong_model_is_found(fault):
    parameters = {name: value.copy() for name, value in K.items()}
    with pytest.raises(AssertionError, match=fault):
        assert_model(Linear(fault), parameters)


class Slope:
    """A prior of density 2 x on the unit interval, with a fault."""

    names, bounds = ("x",), np.array([[0.0, 1.0]])

    def __init__(self, fault=""):
        self.fault = fault

    def logpdf(self, theta):
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.log(2 * theta[:, 0])
        outside = (theta[:, 0] > 1) | ~(theta[:, 0] > 0)
        return np.where(outside & (self.fault != "out of bounds"), -np.inf, values)

    def sample(self, rng, n):
        if self.fault == "generator":
            rng = np.random.default_rng(0)
        power = 0.55 if self.fault == "another law" else 0.5
        return rng.random((n - (self.fault == r"\(n, d\)"), 1)) ** power


def test_a_right_prior_is_accepted():
    assert_prior(Slope())
    laws = {"a": stats.lognorm(0.3), "b": (1.0, 2.0)}
    assert_prior(ef.IndependentPrior(laws))


@pytest.mark.parametrize(
    "fault", ["another law", "generator", "out of bounds", r"\(n, d\)"]
)
def test_a_wrong_prior_is_found(fault):
    with pytest.raises(AssertionError, match=fault):
        assert_prior(Slope(fault))


CHAIN = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
ONE = {"k": np.array([9.0, 10.0, 11.0])}


def paired_chain():
    """Return three masses whose one stiffness is a factor: shapes and pairs stay."""
    zero, mass = np.zeros((3, 3)), np.eye(3)
    model = ef.MatrixModel(zero, mass, {"k": CHAIN}, n_modes=3, shapes=True)
    modes = model(ONE)
    test = ef.Measurements(modes.frequencies[0, :2], modes.shapes[0, :, :2])
    return ef.PairedModel(model, test, candidates=3)


@pytest.mark.parametrize("of", [lambda pair: pair, lambda pair: pair.model])
def test_shapes_and_pairs_may_stay_and_their_slopes_be_zero(of):
    assert_model(of(paired_chain()), ONE)
    assert_jacobian(of(paired_chain()), ONE)


@pytest.mark.parametrize("factor", [0.0, 1.0 + 1e-5, None])
def test_a_wrong_jacobian_is_found(factor):
    """It is zero, off by a small factor, or not there."""

    class Wrong(ef.MatrixModel):
        def jacobian(self, parameters):
            response, slopes = super().jacobian(parameters)
            slope = slopes["frequency"].pop("k")
            if factor is not None:
                slopes["frequency"]["k"] = factor * slope
            return response, slopes

    model = Wrong(np.zeros((3, 3)), np.eye(3), {"k": CHAIN}, n_modes=3)
    with pytest.raises(AssertionError):
        assert_jacobian(model, ONE)


RIGHT = ef.DisplacementTerm(MEASURED[None], sd=SD)


WRONG = {
    "a factor": {"__call__": lambda self, p, r: 1.001 * RIGHT(p, r)},
    "one sum of all": {"__call__": lambda self, p, r: RIGHT(p, r).sum()},
    "mixed rows": {"__call__": lambda self, p, r: RIGHT(p, r) + RIGHT(p, r).mean()},
    "parts": {"pointwise": lambda self, p, r: {"u": 0.9 * RIGHT.pointwise(p, r)[
        "displacement"]}},
    "deviations": {"deviations": lambda self, p, r: (U - MEASURED, 2 * SD)},
    "replicates": {"replicate": lambda self, *given: {"displacement": 0 * RESPONSE[
        "displacement"]}},
}  # fmt: skip


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_term_is_found(fault):
    term = type("Wrong", (ef.DisplacementTerm,), WRONG[fault])(MEASURED[None], sd=SD)
    with pytest.raises(AssertionError):
        assert_term(term, {}, RESPONSE, EXACT)
