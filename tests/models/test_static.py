"""Displacements under loads, against closed forms."""

import numpy as np
import pytest
from scipy.sparse import csc_array
from support.gradients import numerical

import emcee_femu as ef

LENGTH, PARTS = 2.0, 4  # of a cantilever
RNG = np.random.default_rng(1)
THETA = RNG.uniform(0.5, 2.0, (6, 2))
NAMES = ("root", "tip")


def bending(length):
    """Return the stiffness of a beam element of EI = 1."""
    rows = [
        [12, 6 * length, -12, 6 * length],
        [0, 4 * length**2, -6 * length, 2 * length**2],
        [0, 0, 12, -6 * length],
        [0, 0, 0, 4 * length**2],
    ]
    upper = np.array(rows, dtype=float) / length**3
    return upper + np.triu(upper, 1).T


def halves():
    """Return the stiffness of both halves of a cantilever of EI = 1."""
    size = 2 * PARTS
    found = {name: np.zeros((size + 2, size + 2)) for name in NAMES}
    for i in range(PARTS):
        at = slice(2 * i, 2 * i + 4)
        found[NAMES[2 * i // PARTS]][at, at] += bending(LENGTH / PARTS)
    return {name: matrix[2:, 2:] for name, matrix in found.items()}


LOADS = {
    "tip": {2 * PARTS - 2: 1.0},
    "moment": np.eye(2 * PARTS)[-1],
}
POINTS = {"middle": PARTS - 2, "tip": 2 * PARTS - 2}


def cantilever(kind=np.array):
    units = {name: kind(matrix) for name, matrix in halves().items()}
    empty = kind(np.zeros((2 * PARTS, 2 * PARTS)))
    return ef.StaticModel(empty, LOADS, units, points=POINTS)


def as_parameters(theta):
    return dict(zip(NAMES, theta.T, strict=True))


def closed_form(theta):
    """Return deflections (n, cases, points) by the integrals of M m / EI."""
    a, (root, tip) = LENGTH / 2, theta.T
    force_tip = (7 * a**3 / root + a**3 / tip) / 3
    force_middle = 5 * a**3 / 6 / root
    moment_tip = 1.5 * a**2 / root + 0.5 * a**2 / tip
    moment_middle = 0.5 * a**2 / root
    cases = [[force_middle, force_tip], [moment_middle, moment_tip]]
    return np.moveaxis(np.array(cases), 2, 0)


@pytest.mark.parametrize("kind", [np.array, csc_array])
def test_deflections_of_a_cantilever_of_two_halves(kind):
    found = cantilever(kind)(as_parameters(THETA))["displacement"]
    np.testing.assert_allclose(found, closed_form(THETA), rtol=1e-10)


@pytest.mark.parametrize("kind", [np.array, csc_array])
def test_derivatives(kind):
    response, by_name = cantilever(kind).jacobian(as_parameters(THETA))
    np.testing.assert_allclose(response["displacement"], closed_form(THETA))
    found = np.stack([by_name["displacement"][name] for name in NAMES], axis=1)
    expected = numerical(closed_form, THETA)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)


def test_rows_round_alike():
    model = cantilever()
    whole = model(as_parameters(THETA))["displacement"]
    single = [model(as_parameters(row[None]))["displacement"][0] for row in THETA]
    assert np.array_equal(whole, single)


def test_what_it_declares():
    model = cantilever()
    assert model.cases == ("tip", "moment") and model.names == NAMES
    variable = model.variables["displacement"]
    assert variable.coords == {"load_case": model.cases, "point": [*POINTS]}
    everywhere = ef.StaticModel(np.eye(3), {"a": np.ones(3)}, {"k": np.eye(3)})
    assert everywhere.variables["displacement"].shape == (1, 3)
    found = everywhere({"k": np.array([1.0])})["displacement"]
    np.testing.assert_allclose(found, [[[0.5, 0.5, 0.5]]])


@pytest.mark.parametrize("kind", [np.array, csc_array])
@pytest.mark.parametrize("tip", [0.0, -1.0])
def test_a_mechanism_is_named(kind, tip):
    theta = np.array([[1.0, 1.0], [1.0, tip]])
    with pytest.raises(ValueError, match=f"not positive definite at .*'tip': {tip}"):
        cantilever(kind)(as_parameters(theta))


WRONG = {
    "loads: expected {load case: forces}": {"loads": np.ones(2)},
    "loads.'a'.: expected forces .2,. .* got shape .2,. of zeros": {
        "loads": {"a": [0.0, 0.0]}
    },
    "loads.'a'.: expected forces .2,.": {"loads": {"a": [1.0, 2.0, 3.0]}},
    "loads.'a'.: no DOF 2; DOFs are 0 to 1": {"loads": {"a": {2: 1.0}}},
    "points: no DOF 5; DOFs are 0 to 1": {"points": [0, 5]},
    "points: expected DOFs, each once": {"points": []},
    "K.'k'.: expected the shape of K0": {"K": {"k": np.eye(3)}},
    "K.'k'.: a sparse matrix beside a dense K0": {"K": {"k": csc_array(np.eye(2))}},
    "K: expected at least one": {"K": {}},
}


@pytest.mark.parametrize("message", WRONG)
def test_mistakes_are_named(message):
    good = {"K0": np.eye(2), "loads": {"a": [1.0, 0.0]}, "K": {"k": np.eye(2)}}
    with pytest.raises((TypeError, ValueError), match=message):
        ef.StaticModel(**(good | WRONG[message]))
