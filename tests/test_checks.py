import numpy as np
import pandas as pd
import pytest

from emcee_femu import checks

FOUR = np.array([[1, 2], [3, 4]])
ARRAY_CHECKS = [checks.real_array, checks.numeric_array, checks.positive_array]


@pytest.mark.parametrize("check", [*ARRAY_CHECKS, checks.complex_array])
@pytest.mark.parametrize(
    "given", [FOUR.tolist(), FOUR.astype(np.int8), FOUR / 1.0, pd.DataFrame(FOUR)]
)
def test_arrays_are_new_and_of_float64(check, given):
    array = check("a", given)
    assert array.dtype == np.float64 and not np.shares_memory(array, given)
    np.testing.assert_array_equal(array, FOUR)


def test_a_batch_passes_floats_on_and_refuses_lengths_that_differ():
    given = {"a": np.array([1.0, 2.0]), "b": [3, 4]}
    values, n = checks.batch(given)
    assert n == 2 and values["a"] is given["a"] and values["b"].dtype == np.float64
    with pytest.raises(ValueError, match="^parameters: expected one length"):
        checks.batch({"a": [1.0], "b": [1.0, 2.0]})
    with pytest.raises(TypeError, match="^parameters: expected {name"):
        checks.batch([1.0])
