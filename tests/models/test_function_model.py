import pickle

import numpy as np
import pytest

from emcee_femu.interfaces import ModalSolution, SolveError, Variable
from emcee_femu.models.function import FunctionModel

PARAMETERS = {"k": np.array([40.0, 90.0, 10.0]), "m": np.array([0.1, 0.4, 2.5])}
OMEGA = np.array([20.0, 15.0, 2.0])  # sqrt(k / m)
EXPECTED = np.column_stack([OMEGA, 3 * OMEGA])


def frequencies_of(p):
    omega = (p["k"] / p["m"]) ** 0.5
    return [omega, 3 * omega]


def shapes_of(p):
    return np.array([[p["k"], 1.0], [p["m"], 2.0], [0.0, 3.0]])


@pytest.mark.parametrize(
    "convert",
    [list, tuple, np.array, ModalSolution],
    ids=["list", "tuple", "array", "ModalSolution"],
)
@pytest.mark.parametrize("n_modes", [None, 2])
def test_every_kind_of_return_is_stacked(convert, n_modes):
    model = FunctionModel(lambda p: convert(frequencies_of(p)), n_modes)
    solution = model(PARAMETERS)
    np.testing.assert_allclose(solution.frequencies, EXPECTED, rtol=1e-15)
    assert solution.frequencies.dtype == np.float64
    assert solution.shapes is None


def test_whole_number_frequencies_become_floats():
    frequencies = FunctionModel(lambda p: [1, 2])(PARAMETERS).frequencies
    assert frequencies.dtype == np.float64
    assert np.array_equal(frequencies, [[1.0, 2.0]] * 3)


def test_shapes_are_stacked_walker_by_walker():
    model = FunctionModel(lambda p: ModalSolution(frequencies_of(p), shapes_of(p)))
    frequencies, shapes = model(PARAMETERS)
    assert shapes.shape == (3, 3, 2)
    np.testing.assert_allclose(frequencies, EXPECTED, rtol=1e-15)
    assert np.array_equal(shapes[:, 0, 0], PARAMETERS["k"])
    assert np.array_equal(shapes[:, 1, 0], PARAMETERS["m"])
    assert np.array_equal(shapes[:, :, 1], [[1.0, 2.0, 3.0]] * 3)


def test_the_function_is_called_once_per_walker_with_plain_floats():
    calls = []
    FunctionModel(lambda p: calls.append(p) or [1.0])(PARAMETERS)
    assert calls == [
        {"k": 40.0, "m": 0.1},
        {"k": 90.0, "m": 0.4},
        {"k": 10.0, "m": 2.5},
    ]
    assert {type(value) for call in calls for value in call.values()} == {float}
    assert {type(call) for call in calls} == {dict}


def test_a_function_of_no_parameters_is_called_once():
    calls = []
    solution = FunctionModel(lambda p: calls.append(p) or [1.0, 2.0])({})
    assert calls == [{}]
    assert np.array_equal(solution.frequencies, [[1.0, 2.0]])


def test_a_batch_equals_a_loop_to_the_bit():
    model = FunctionModel(frequencies_of)
    loop = [
        model({name: value[i : i + 1] for name, value in PARAMETERS.items()})
        for i in range(3)
    ]
    expected = np.concatenate([solution.frequencies for solution in loop])
    assert np.array_equal(model(PARAMETERS).frequencies, expected)


def test_the_returned_frequencies_do_not_alias_what_the_function_reuses():
    buffer = np.empty(1)

    def reuse(p):
        buffer[:] = p["k"]
        return buffer

    frequencies = FunctionModel(reuse)(PARAMETERS).frequencies
    assert np.array_equal(frequencies[:, 0], PARAMETERS["k"])


def test_a_failed_solve_may_return_nan():
    model = FunctionModel(lambda p: [np.nan if p["k"] > 50 else 1.0])
    expected = [[1.0], [np.nan], [1.0]]
    assert np.array_equal(model(PARAMETERS).frequencies, expected, equal_nan=True)


def test_a_model_of_a_module_level_function_pickles():
    copy = pickle.loads(pickle.dumps(FunctionModel(frequencies_of, 2)))
    assert copy == FunctionModel(frequencies_of, 2)
    np.testing.assert_allclose(copy(PARAMETERS).frequencies, EXPECTED, rtol=1e-15)


def at_the_second_walker(result):
    return lambda p: result if p["k"] == 90.0 else [1.0, 2.0]


@pytest.mark.parametrize(
    ("result", "error", "message"),
    [
        ([1.0], ValueError, r"shape \(2,\), got \(1,\)"),
        ([1.0, 2.0, 3.0], ValueError, r"shape \(2,\), got \(3,\)"),
        ([[1.0, 2.0]], ValueError, r"shape \(2,\), got \(1, 2\)"),
        (1.0, ValueError, r"shape \(2,\), got \(\)"),
        ([[1.0], [1.0, 2.0]], ValueError, r"function: expected a rectangular array"),
        ("1 2", TypeError, r"function: expected real numbers, got str"),
        (["1", "2"], TypeError, r"function: expected real numbers, got list"),
        ([1j, 2j], TypeError, r"function: expected real numbers"),
        ([True, False], TypeError, r"function: expected real numbers"),
        (None, TypeError, r"function: expected real numbers, got NoneType"),
        (
            ModalSolution([1.0, 2.0], [1.0, 2.0]),
            ValueError,
            r"function \(shapes\): expected 2 dimension",
        ),
        (
            ModalSolution([1.0, 2.0], [[1.0, np.nan]]),
            ValueError,
            r"function \(shapes\): expected finite",
        ),
    ],
)
def test_a_wrong_return_is_refused_with_the_parameters(result, error, message):
    model = FunctionModel(at_the_second_walker(result), 2)
    where = r" at \{'k': 90.0, 'm': 0.4\}"
    with pytest.raises(error, match=message + r".*" + where):
        model(PARAMETERS)


def test_the_error_names_the_parameters_even_if_the_function_changed_them():
    def spoil(p):
        p.clear()
        return "wrong"

    with pytest.raises(TypeError, match=r"at \{'k': 40.0, 'm': 0.1\}"):
        FunctionModel(spoil)(PARAMETERS)


def test_a_2d_return_is_refused_without_n_modes_too():
    with pytest.raises(ValueError, match=r"\(n_modes,\), got \(1, 2\); at \{'k': 40.0"):
        FunctionModel(lambda p: [[1.0, 2.0]])(PARAMETERS)


def test_an_exception_of_the_function_says_where_it_was_raised():
    def fail(p):
        raise RuntimeError("solver licence expired")

    with pytest.raises(RuntimeError, match=r"^solver licence expired\nraised by .*40"):
        FunctionModel(fail)(PARAMETERS)


def test_a_varying_number_of_frequencies_is_refused_with_the_parameters():
    model = FunctionModel(at_the_second_walker([1.0, 2.0, 3.0]))
    with pytest.raises(ValueError, match=r"\{'k': 90.0, 'm': 0.4\}"):
        model(PARAMETERS)


def test_shapes_must_have_one_column_per_frequency():
    model = FunctionModel(lambda p: ModalSolution([1.0, 2.0], np.ones((3, 5))))
    with pytest.raises(ValueError, match=r"\(3, 5\).*\{'k': 40.0, 'm': 0.1\}"):
        model(PARAMETERS)


@pytest.mark.parametrize(
    "odd",
    [None, np.ones((4, 2))],
    ids=["missing once", "of another size once"],
)
def test_shapes_of_varying_size_are_refused(odd):
    def solve(p):
        shapes = odd if p["k"] == 90.0 else np.ones((3, 2))
        return ModalSolution([1.0, 2.0], shapes)

    with pytest.raises(ValueError, match=r"shapes"):
        FunctionModel(solve)(PARAMETERS)


@pytest.mark.parametrize("function", [None, 3.0, [1.0], "solve"])
def test_what_cannot_be_called_is_refused(function):
    with pytest.raises(TypeError, match=r"function: expected a callable, got"):
        FunctionModel(function)


@pytest.mark.parametrize(
    ("n_modes", "error"),
    [(True, TypeError), (2.0, TypeError), ("2", TypeError), (0, ValueError)],
)
def test_a_wrong_n_modes_is_refused(n_modes, error):
    with pytest.raises(error, match=r"n_modes: expected"):
        FunctionModel(frequencies_of, n_modes)


def derivatives_of(p):
    omega = frequencies_of(p)[0]
    d_k, d_m = omega / (2 * p["k"]), -omega / (2 * p["m"])
    frequency = {"k": [d_k, 3 * d_k], "m": [d_m, 3 * d_m]}
    shapes = {"k": np.eye(3, 2) * [1, 0]}  # m is left out
    return ModalSolution(frequencies_of(p), shapes_of(p)), {
        "frequency": frequency,
        "shapes": shapes,
    }


def test_derivatives_are_stacked_as_the_response_is():
    model = FunctionModel(frequencies_of, jacobian=derivatives_of)
    response, derivatives = pickle.loads(pickle.dumps(model)).jacobian(PARAMETERS)
    np.testing.assert_allclose(response.frequencies, EXPECTED, rtol=1e-15)
    assert response.shapes.shape == derivatives["shapes"]["k"].shape == (3, 3, 2)
    assert list(derivatives["shapes"]) == ["k"]
    for name, step in ("k", 1e-3), ("m", 1e-6):
        ahead, behind = (
            model(PARAMETERS | {name: PARAMETERS[name] + side}).frequencies
            for side in (step, -step)
        )
        numbers = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(
            derivatives["frequency"][name], numbers, rtol=1e-6, atol=1e-6
        )


def test_without_a_jacobian_there_is_none():
    assert not hasattr(FunctionModel(frequencies_of), "jacobian")


def test_derivatives_of_other_variables():
    model = FunctionModel(
        lambda p: {"tip": p["k"] ** 2, "base": 0.0},
        variables={"tip": Variable({}, "m"), "base": Variable({}, "m")},
        jacobian=lambda p: (
            {"tip": p["k"] ** 2, "base": 0.0},
            {"tip": {"k": 2 * p["k"]}, "base": {}},
        ),
    )
    response, derivatives = model.jacobian({"k": np.array([1.0, 3.0])})
    assert np.array_equal(response["tip"], [1, 9])
    assert np.array_equal(derivatives["tip"]["k"], [2, 6])
    assert derivatives["base"] == {}


@pytest.mark.parametrize(
    ("returned", "kind", "message"),
    [
        ([1.0], TypeError, "jacobian: expected what function returns"),
        (([1.0], [2.0]), TypeError, "jacobian: expected what function returns"),
        (
            ([1.0], {"shapes": {}}),
            ValueError,
            "for each of .'frequency'., got 'shapes'",
        ),
        (([1.0], {"frequency": [1.0]}), ValueError, "parameter: array"),
        (([1.0], {"frequency": {"k": 1.0}}), SolveError, r"d frequency / d k.*\(1,\)"),
        (([1.0], {"frequency": {"k": ["x"]}}), TypeError, "d frequency / d k"),
    ],
)
def test_wrong_derivatives_are_refused_with_the_parameters(returned, kind, message):
    model = FunctionModel(lambda p: [1.0], jacobian=lambda p: returned)
    with pytest.raises(kind, match=f"(?s){message}.*'k': 40.0"):
        model.jacobian(PARAMETERS)
