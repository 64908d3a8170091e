"""Parameter sets at the border of a model: there, inside, and named in messages."""

import numpy as np
import pytest

from emcee_femu.models.parameter_sets import describe, read_batch, read_inside

BOUNDS = {"E": (1.0, 2.0), "I": (-np.inf, 5.0)}


def test_values_are_arrays_of_one_length():
    values, n = read_batch({"E": [1.0, 2.0], "I": (3, 4), "other": [0, 0]}, ("E", "I"))
    assert n == 2 and values["I"].dtype == float
    with pytest.raises(ValueError, match="no value for .'I'"):
        read_batch({"E": [1.0]}, ("E", "I"))


@pytest.mark.parametrize(
    ("name", "value"), [("E", 0.99), ("E", 2.01), ("I", 5.1), ("E", np.nan)]
)
def test_the_row_outside_is_named_with_its_bounds(name, value):
    given = {"E": np.array([1.0, 1.5, 2.0]), "I": np.array([5.0, -1e9, 0.0])}
    assert read_inside(given, BOUNDS, "reduce")[1] == 3
    given[name][1] = value
    low, high = BOUNDS[name]
    with pytest.raises(ValueError) as raised:
        read_inside(given, BOUNDS, "reduce")
    for part in (f"{name} = ", "row 1", f"[{low:g}, {high:g}]", "the reduced model"):
        assert part in str(raised.value)


def test_one_set_is_described_by_its_names():
    values = {"E": np.array([1.0, 2.0]), "I": np.array([3.0, 4.0])}
    assert describe(values, ["I"], 1) == "{'I': 4.0}"
