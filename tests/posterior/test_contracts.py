"""The checkers that CONTRIBUTING.md offers accept what is right, and only that."""

import numpy as np
import pytest
from scipy import stats
from support.contracts import assert_model, assert_term

import emcee_femu as ef

K = {"k1": np.array([1.0, 2.0, 3.0]), "k2": np.array([2.0, 2.5, 2.0])}
MEASURED, SD = np.array([1.0, 2.0]), 0.3
U = MEASURED + np.array([[0.1, 0.2], [-0.3, 0.1], [0.4, -0.5]])
RESPONSE = {"displacement": U[:, None]}
EXACT = stats.norm.logpdf(U, MEASURED, SD).sum(axis=1)


class Linear:
    """A right model, or one with a fault."""

    def __init__(self, fault=""):
        points = ["a", "b", "c"] if fault == "declared" else ["a", "b"]
        self.variables = {"u": ef.Variable({"point": points}, "mm")}
        self.fault, self.shift = fault, 0.0

    def __getstate__(self):
        return vars(self) | {"shift": float(self.fault == "pickled copy")}

    def __call__(self, parameters):
        u = np.stack([parameters["k1"], parameters["k2"]], axis=1) + self.shift
        if self.fault == "same for all":
            u = u[:1].repeat(3, axis=0)
        if self.fault == "alone":  # rows are mixed
            u = u + 1e-6 * u.mean(axis=0)
        if self.fault == "changed k1":
            parameters["k1"] *= 1.0 + 1e-12
        return {"u": u}


def test_models_of_the_package_and_a_right_one_pass():
    assert_model(Linear(), K)
    matrices = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
    model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), matrices, n_modes=2)
    assert_model(model, K)


FAULTS = ["same for all", "alone", "changed k1", "declared", "pickled copy"]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_model_is_found(fault):
    with pytest.raises(AssertionError, match=fault):
        assert_model(Linear(fault), {name: value.copy() for name, value in K.items()})


RIGHT = ef.DisplacementTerm(MEASURED[None], sd=SD)


class Mutant:
    """A term of the package with one method replaced."""

    def __init__(self, **methods):
        names = ("__call__", "pointwise", "deviations", "replicate", "observed")
        parts = {name: getattr(RIGHT, name) for name in names} | methods
        self.call = parts.pop("__call__")
        vars(self).update(parts)

    def __call__(self, parameters, response):
        return self.call(parameters, response)


def mixing(parameters, response):
    """Shift each likelihood by the mean of all."""
    return RIGHT(parameters, response) + response["displacement"].mean() - U.mean()


def test_a_right_term_passes_with_or_without_its_constant():
    assert_term(RIGHT, {}, RESPONSE, EXACT)
    assert_term(Mutant(), {}, RESPONSE, EXACT + 3.0)
    assert_term(lambda p, r: RIGHT(p, r), {}, RESPONSE, EXACT)


def nine_tenths(parameters, response):
    return {"u": 0.9 * RIGHT.pointwise(parameters, response)["displacement"]}


@pytest.mark.parametrize(
    ("methods", "message"),
    [
        ({"__call__": lambda p, r: 1.001 * RIGHT(p, r)}, "differs from the expected"),
        ({"__call__": lambda p, r: RIGHT(p, r).sum()}, "one number per"),
        ({"__call__": mixing}, "one by one"),
        ({"pointwise": nine_tenths}, "pointwise"),
        (
            {"deviations": lambda p, r: (2 * RIGHT.deviations(p, r)[0], SD)},
            "another density",
        ),
        (
            {"replicate": lambda rng, p, r: {"displacement": 0 * r["displacement"]}},
            "alike",
        ),
        ({"observed": {"displacement": MEASURED}}, "displacement"),
    ],
)
def test_a_wrong_term_is_found(methods, message):
    with pytest.raises(AssertionError, match=message):
        assert_term(Mutant(**methods), {}, RESPONSE, EXACT)
