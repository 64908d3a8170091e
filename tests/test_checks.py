import numpy as np
import pandas as pd
import pytest

from emcee_femu import checks

TEXT = pd.DataFrame({"a": [1.0], "b": ["x"]})
NOT_REAL = [True, 1 + 0j, "1.0", ["1", "2"], None, [1.0, None], {"a": 1.0}, TEXT]
FOUR = np.array([[1, 2], [3, 4]])
ARRAY_CHECKS = [checks.real_array, checks.numeric_array, checks.positive_array]


@pytest.mark.parametrize("check", [*ARRAY_CHECKS, checks.real_number])
@pytest.mark.parametrize("value", NOT_REAL, ids=lambda value: type(value).__name__)
def test_what_is_not_real_is_refused_by_argument_name(check, value):
    with pytest.raises(TypeError, match="^beta: expected real numbers, got"):
        check("beta", value)


@pytest.mark.parametrize("check", [*ARRAY_CHECKS, checks.complex_array])
def test_ragged_and_masked_arrays_are_refused_by_argument_name(check):
    with pytest.raises(ValueError, match="^beta: expected a rectangular array"):
        check("beta", [[1.0, 2.0], [3.0]])
    with pytest.raises(ValueError, match="^beta: expected numbers, got masked"):
        check("beta", np.ma.masked_greater([1.0, -999.0], 0.0))


@pytest.mark.parametrize("check", [*ARRAY_CHECKS, checks.complex_array])
@pytest.mark.parametrize(
    "given", [FOUR.tolist(), FOUR.astype(np.int8), FOUR / 1.0, pd.DataFrame(FOUR)]
)
def test_arrays_are_new_and_of_float64(check, given):
    array = check("a", given)
    assert array.dtype == np.float64 and not np.shares_memory(array, given)
    np.testing.assert_array_equal(array, FOUR)


@pytest.mark.parametrize("value", [1.0, [1.0], [], [[1.0]]])
def test_the_right_dimension_passes_and_every_other_is_refused(value):
    for ndim in (0, 1, 2, None):
        if ndim in (None, np.ndim(value)):
            assert checks.positive_array("a", value, ndim).shape == np.shape(value)
            continue
        with pytest.raises(ValueError, match=rf"^a: expected {ndim} dimension\(s\)"):
            checks.real_array("a", value, ndim)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0])
def test_numbers_that_are_not_finite_or_positive_are_refused_with_their_place(bad):
    expected = "numbers above zero" if np.isfinite(bad) else "finite numbers"
    for value, place in ((bad, ""), ([[1.0, 2.0], [bad, 4.0]], r" at index \(1, 0\)")):
        np.testing.assert_array_equal(checks.numeric_array("m", value), value)
        with pytest.raises(
            ValueError, match=f"^m: expected {expected}, got {bad}{place}$"
        ):
            checks.positive_array("m", value)


def test_real_number_returns_a_python_float_from_low_on():
    number = checks.real_number("x", np.float32(2), low=2.0)
    assert type(number) is float and number == 2.0
    with pytest.raises(ValueError, match="^x: expected at least 2, got 1.5$"):
        checks.real_number("x", 1.5, low=2.0)


@pytest.mark.parametrize("low", [0, 3, -2])
def test_whole_number_returns_a_python_int_from_low_on(low):
    number = checks.whole_number("n", np.int32(low), low)
    assert type(number) is int and number == low
    with pytest.raises(ValueError, match=f"^n: expected at least {low}, got {low - 1}"):
        checks.whole_number("n", low - 1, low)
    for value in (True, 3.0, np.float64(3), "3", None, [3]):
        with pytest.raises(TypeError, match="^n: expected a whole number, got"):
            checks.whole_number("n", value, low)


@pytest.mark.parametrize(
    ("names", "error", "message"),
    [
        *((names, TypeError, "expected a sequence") for names in ("k1", {"a"}, 3)),
        *((["a", bad], TypeError, "expected a non-empty string") for bad in ("", 1)),
        (["b", "a", "b", "c", "a"], ValueError, r"expected names, each once, got "),
        ([], ValueError, "expected names, each once, got"),
    ],
)
def test_names_are_refused(names, error, message):
    with pytest.raises(error, match="^springs: " + message):
        checks.parameter_names("springs", names)


def test_a_batch_passes_floats_on_and_refuses_lengths_that_differ():
    given = {"a": np.array([1.0, 2.0]), "b": [3, 4]}
    values, n = checks.batch(given)
    assert n == 2 and values["a"] is given["a"] and values["b"].dtype == np.float64
    with pytest.raises(ValueError, match="^parameters: expected one length"):
        checks.batch({"a": [1.0], "b": [1.0, 2.0]})
    with pytest.raises(TypeError, match="^parameters: expected {name"):
        checks.batch([1.0])
