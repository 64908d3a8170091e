import numpy as np
import pytest

from emcee_femu import checks

NAN, INF = np.nan, np.inf
NOT_REAL = {
    "a bool": True,
    "bools": [True, False],
    "a complex number": 1 + 0j,
    "complex numbers": [1.0, 2j],
    "a string": "1.0",
    "strings": ["1", "2"],
    "None": None,
    "an object array": np.array([1.0, 2.0], dtype=object),
    "a hole": [1.0, None],
    "a dict": {"a": 1.0},
    "a set": {1.0, 2.0},
    "dates": np.array(["2020-01-01"], dtype="datetime64[D]"),
}
ARRAY_CHECKS = [checks.real_array, checks.numeric_array, checks.positive_array]


@pytest.mark.parametrize("check", [*ARRAY_CHECKS, checks.real_number])
@pytest.mark.parametrize("value", NOT_REAL.values(), ids=NOT_REAL)
def test_what_is_not_real_is_refused_by_argument_name(check, value):
    with pytest.raises(TypeError, match="^beta: expected real numbers"):
        check("beta", value)


@pytest.mark.parametrize("check", [*ARRAY_CHECKS, checks.real_number])
def test_a_ragged_list_is_refused_by_argument_name(check):
    with pytest.raises(ValueError, match="^beta: expected a rectangular array"):
        check("beta", [[1.0, 2.0], [3.0]])


@pytest.mark.parametrize("check", ARRAY_CHECKS)
@pytest.mark.parametrize("dtype", [np.int8, np.uint64, np.float16, np.float64])
def test_arrays_are_new_and_of_float64(check, dtype):
    given = np.array([[1, 2], [3, 4]], dtype=dtype)
    array = check("a", given)
    assert array.dtype == np.float64 and not np.shares_memory(array, given)
    np.testing.assert_array_equal(array, [[1.0, 2.0], [3.0, 4.0]])


@pytest.mark.parametrize("check", ARRAY_CHECKS)
@pytest.mark.parametrize("value", [2, 2.5, np.float32(2.5), [1, 2.5], [], ((1,), (2,))])
def test_shapes_are_kept(check, value):
    array = check("a", value)
    assert array.shape == np.shape(value)
    assert array.tolist() == np.asarray(value, dtype=float).tolist()


@pytest.mark.parametrize("check", [checks.real_array, checks.positive_array])
@pytest.mark.parametrize(
    ("value", "ndim"), [(1.0, 0), ([1.0], 1), ([], 1), ([[1.0]], 2), ([[[1.0]]], None)]
)
def test_the_right_dimension_passes_and_every_other_is_refused(check, value, ndim):
    assert check("a", value, ndim).shape == np.shape(value)
    for other in {0, 1, 2, 3} - {np.ndim(value)}:
        with pytest.raises(ValueError, match=rf"^a: expected {other} dimension\(s\)"):
            check("a", value, other)


@pytest.mark.parametrize("check", [checks.real_array, checks.positive_array])
@pytest.mark.parametrize("bad", [NAN, INF, -INF])
@pytest.mark.parametrize(
    ("shape", "index"), [((), r"\(\)"), ((3,), r"\(2,\)"), ((2, 2), r"\(1, 0\)")]
)
def test_what_is_not_finite_is_refused_with_its_place(check, bad, shape, index):
    value = np.ones(shape)
    value[{(): (), (3,): 2, (2, 2): (1, 0)}[shape]] = bad
    message = rf"^sd: expected finite numbers, got {bad} at index {index}$"
    with pytest.raises(ValueError, match=message):
        check("sd", value)


def test_numeric_array_keeps_nan_and_infinity():
    np.testing.assert_array_equal(
        checks.numeric_array("a", [NAN, INF, -INF]), [NAN, INF, -INF]
    )


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (0.0, r"got 0.0$"),
        (-0.0, r"got -0.0$"),
        (-1, r"got -1.0$"),
        ([1.0, 0.0, -1.0], r"got 0.0 at index \(1,\)$"),
        ([[1.0, 2.0], [3.0, -4.0]], r"got -4.0 at index \(1, 1\)$"),
    ],
)
def test_positive_array_refuses_zero_and_less_with_its_place(value, message):
    with pytest.raises(ValueError, match="^m: expected numbers above zero, " + message):
        checks.positive_array("m", value)


def test_positive_array_takes_the_smallest_float():
    assert checks.positive_array("m", 5e-324).item() == 5e-324


@pytest.mark.parametrize("value", [3, -3.5, np.float32(0.5), np.int64(7), np.ones(())])
def test_real_number_returns_a_python_float(value):
    number = checks.real_number("x", value)
    assert type(number) is float and number == value


def test_real_number_takes_low_itself_and_refuses_less():
    assert checks.real_number("x", 2, low=2.0) == 2.0
    with pytest.raises(ValueError, match="^x: expected at least 2, got 1.5$"):
        checks.real_number("x", 1.5, low=2.0)
    assert checks.real_number("x", -1e300) == -1e300


@pytest.mark.parametrize("value", [[1.0], [[1.0]], np.ones(1), [], NAN, INF, -INF])
def test_real_number_refuses_arrays_and_what_is_not_finite(value):
    with pytest.raises(ValueError, match="^x: expected"):
        checks.real_number("x", value)


@pytest.mark.parametrize("value", [3, np.int32(3), np.uint8(3), 10**30])
def test_whole_number_returns_a_python_int(value):
    number = checks.whole_number("n", value)
    assert type(number) is int and number == value


@pytest.mark.parametrize(
    "value",
    [True, np.True_, 3.0, np.float64(3), "3", None, 3 + 0j, [3], np.array(3)],
)
def test_whole_number_refuses_all_but_integers(value):
    with pytest.raises(TypeError, match="^n: expected a whole number, got"):
        checks.whole_number("n", value)


@pytest.mark.parametrize(("value", "low"), [(-1, 0), (0, 1), (np.int64(4), 5)])
def test_whole_number_takes_low_itself_and_refuses_less(value, low):
    assert checks.whole_number("n", value + 1, low) == low
    with pytest.raises(ValueError, match=f"^n: expected at least {low}, got {value}$"):
        checks.whole_number("n", value, low)


def test_whole_number_is_at_least_zero_unless_told():
    assert checks.whole_number("n", 0) == 0
    assert checks.whole_number("n", -2, -2) == -2
    with pytest.raises(ValueError, match="^n: expected at least 0, got -1$"):
        checks.whole_number("n", -1)


@pytest.mark.parametrize(
    "names", [["b", "a"], ("b", "a"), np.array(["b", "a"]), dict.fromkeys("ba")]
)
def test_names_become_a_tuple_in_their_order(names):
    result = checks.parameter_names("names", names)
    assert type(result) is tuple and result == ("b", "a")


@pytest.mark.parametrize(
    ("names", "error", "message"),
    [
        ("k1", TypeError, r"expected a sequence of names, got the string 'k1'; "),
        ("", TypeError, r"expected a sequence of names, got the string ''"),
        (["a", ""], TypeError, "expected non-empty strings, got ''"),
        (["a", 1], TypeError, "expected non-empty strings, got 1"),
        ([b"a"], TypeError, "expected non-empty strings, got b'a'"),
        ([None], TypeError, "expected non-empty strings, got None"),
        ([["a"]], TypeError, r"expected non-empty strings, got \['a'\]"),
        (["b", "a", "b", "c", "a"], ValueError, r"each name once, but \['a', 'b'\]"),
        ([], ValueError, "expected at least one name, got none"),
    ],
)
def test_names_are_refused(names, error, message):
    with pytest.raises(error, match="^springs: " + message):
        checks.parameter_names("springs", names)
