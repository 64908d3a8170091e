"""Displacements under loads, against closed forms."""

import numpy as np
import pytest
from scipy.sparse import csc_array
from support.beams import assemble, bending
from support.contracts import assert_model
from support.gradients import numerical

import emcee_femu as ef

LENGTH, PARTS = 2.0, 4  # of a cantilever
THETA = np.random.default_rng(1).uniform(0.5, 2.0, (6, 2))
NAMES = ("root", "tip")
LOADS = {"tip": {2 * PARTS - 2: 1.0}, "moment": np.eye(2 * PARTS)[-1]}
POINTS = {"middle": PARTS - 2, "tip": 2 * PARTS - 2}


def cantilever(kind):
    block, halves = bending(LENGTH / PARTS), (range(2), range(2, PARTS))
    units = [kind(assemble(block, PARTS, half)[2:, 2:]) for half in halves]
    K = dict(zip(NAMES, units, strict=True))
    return ef.StaticModel(0 * units[0], LOADS, K, points=POINTS)


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
def test_deflections_of_a_cantilever_and_their_derivatives(kind):
    model = cantilever(kind)
    assert_model(model, as_parameters(THETA))
    found = model(as_parameters(THETA))["displacement"]
    np.testing.assert_allclose(found, closed_form(THETA), rtol=1e-10)
    response, by_name = model.jacobian(as_parameters(THETA))
    np.testing.assert_allclose(response["displacement"], found)
    slopes = np.stack([by_name["displacement"][name] for name in NAMES], axis=1)
    expected = numerical(closed_form, THETA)
    np.testing.assert_allclose(slopes, expected, rtol=1e-7, atol=1e-9)


def test_what_it_declares():
    model = cantilever(np.array)
    assert model.cases == ("tip", "moment") and model.names == NAMES
    variable = model.variables["displacement"]
    assert variable.coords == {"load_case": model.cases, "point": [*POINTS]}
    everywhere = ef.StaticModel(np.eye(3), {"a": np.ones(3)}, {"k": np.eye(3)})
    found = everywhere({"k": np.array([1.0])})["displacement"]
    np.testing.assert_allclose(found, [[[0.5, 0.5, 0.5]]])


@pytest.mark.parametrize("kind", [np.array, csc_array])
@pytest.mark.parametrize("tip", [0.0, -1.0])
def test_a_mechanism_is_named(kind, tip):
    theta = np.array([[1.0, 1.0], [1.0, tip]])
    with pytest.raises(ValueError, match=f"not positive definite at .*'tip': {tip}"):
        cantilever(kind)(as_parameters(theta))


def test_of_several_sets_the_mechanism_is_named_however_stiff_it_is_elsewhere():
    springs = {"soft": np.diag([1.0, 0.0]), "stiff": np.diag([0.0, 1.0])}
    model = ef.StaticModel(np.zeros((2, 2)), {"pull": np.ones(2)}, springs)
    with pytest.raises(ValueError, match="'soft': -1.0, 'stiff': 100"):
        model({"soft": np.array([1.0, -1.0, 2.0]), "stiff": np.array([1, 100.0, 2])})
