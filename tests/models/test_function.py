"""A function as a model: what it may return is stacked, what it may not is named."""

import pickle

import numpy as np
import pytest
from support.contracts import assert_model
from support.derivatives import assert_jacobian

import emcee_femu as ef
from emcee_femu import FunctionModel, ModalSolution

PARAMETERS = {"k": np.array([40.0, 90.0, 10.0]), "m": np.array([0.1, 0.4, 2.5])}
OMEGA = np.array([20.0, 15.0, 2.0])  # sqrt(k / m)
EXPECTED = np.column_stack([OMEGA, 3 * OMEGA])


def frequencies_of(p):
    omega = (p["k"] / p["m"]) ** 0.5
    return [omega, 3 * omega]


def shapes_of(p):
    return np.array([[p["k"], 1.0], [p["m"], 2.0], [0.0, 3.0]])


def solve(p):
    return ModalSolution(frequencies_of(p), shapes_of(p))


def derive(p):
    """Return modes and derivatives; those of the shapes by m are left out."""
    omega = frequencies_of(p)[0]
    d_k, d_m = omega / (2 * p["k"]), -omega / (2 * p["m"])
    frequency = {"k": [d_k, 3 * d_k], "m": [d_m, 3 * d_m]}
    return solve(p), {"frequency": frequency, "shapes": {"k": np.eye(3, 2) * [1, 0]}}


@pytest.mark.parametrize("convert", [list, tuple, np.array, ModalSolution])
@pytest.mark.parametrize("n_modes", [None, 2])
def test_every_kind_of_return_is_stacked(convert, n_modes):
    model = FunctionModel(lambda p: convert(frequencies_of(p)), n_modes)
    solution = model(PARAMETERS)
    np.testing.assert_allclose(solution.frequencies, EXPECTED, rtol=1e-12)
    assert solution.frequencies.dtype == np.float64 and solution.shapes is None
    declared = {None: ef.modal_variables(2, ["a", "b", "c"]), 2: None}[n_modes]
    assert_model(FunctionModel(solve, n_modes, variables=declared), PARAMETERS)


def test_the_function_is_called_once_per_walker_with_plain_floats():
    calls = []
    FunctionModel(lambda p: calls.append(p) or [1.0])(PARAMETERS)
    rows = zip(*PARAMETERS.values(), strict=True)
    assert calls == [dict(zip("km", row, strict=True)) for row in rows]
    assert {type(value) for call in calls for value in call.values()} == {float}
    assert np.array_equal(FunctionModel(lambda p: [1, 2])({}).frequencies, [[1, 2]])


def test_derivatives_are_stacked_as_the_response_is():
    model = FunctionModel(solve, jacobian=derive)
    response, derivatives = pickle.loads(pickle.dumps(model)).jacobian(PARAMETERS)
    np.testing.assert_allclose(response.frequencies, EXPECTED, rtol=1e-12)
    assert response.shapes.shape == derivatives["shapes"]["k"].shape == (3, 3, 2)
    assert not derivatives["shapes"]["m"].any()  # omitted: zero
    square = FunctionModel(
        lambda p: [p["k"] ** 2],
        jacobian=lambda p: ([p["k"] ** 2], {"frequency": {"k": [2 * p["k"]]}}),
    )
    assert_jacobian(square, {"k": OMEGA})
    assert FunctionModel(solve).jacobian is None


def spoil(p):
    p.clear()
    raise RuntimeError("solver licence expired")


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (spoil, r"^solver licence expired\n.* 'm': 0.1\}"),
        (lambda k, m: [k / m], r"one dict, of \['k', 'm'\]"),
        (lambda p: (np.ones(2), np.eye(2)), r"ModalSolution\(f, shapes\)"),
    ],
)
def test_a_function_that_fails_is_told_its_parameters_and_the_form(function, words):
    with pytest.raises((RuntimeError, TypeError, ValueError), match=words):
        FunctionModel(function)(PARAMETERS)
