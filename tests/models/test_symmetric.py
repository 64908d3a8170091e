"""What a sparse MatrixModel refuses when it is made."""

import numpy as np
import pytest
from scipy import sparse

from emcee_femu.models.matrix import MatrixModel


def shifted(matrix, i, j, by):
    result = sparse.lil_array(matrix)
    result[i, j] += by
    return result.tocsr()


EYE = sparse.eye_array(30, format="csr")


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"K0": shifted(EYE, 1, 2, 0.5)}, ValueError, r"K0: .*symmetric.*up to 0.5 "),
        ({"M0": shifted(EYE, 1, 2, 1e-7)}, ValueError, r"M0: .*symmetric"),
        ({"K": {"a": shifted(EYE, 0, 9, 1)}}, ValueError, r"K\['a'\]: .*symmetric"),
        ({"K0": EYE[:, :20]}, ValueError, r"K0: expected a square.*\(30, 20\)"),
        ({"K0": shifted(EYE, 3, 3, np.nan)}, ValueError, r"K0: .*nan at .*\(3, 3\)"),
        ({"K": {"a": EYE[:9, :9]}}, ValueError, r"K\['a'\]: expected the shape of K0"),
        ({"M0": EYE * 1j}, TypeError, r"M0: expected real numbers.*complex"),
        ({"M0": shifted(EYE, 0, 0, -2)}, ValueError, r"M0 is not positive definite"),
        ({"M0": 0 * EYE}, ValueError, r"M0 is not positive definite.*massless"),
        (
            {"M0": shifted(shifted(EYE, 0, 1, 2), 1, 0, 2)},
            ValueError,
            r"M0 is not positive definite",
        ),
        (
            {"M0": shifted(shifted(EYE, 0, 1, 1), 1, 0, 1)},
            ValueError,
            r"M0 is not positive definite",
        ),
        ({"n_modes": 31}, ValueError, r"n_modes: .*<= 30 .*got 0 \+ 31"),
        ({"shapes": [3, 30]}, ValueError, r"shapes: no DOF 30; DOFs are 0 to 29"),
        ({"shapes": [3, 3]}, ValueError, r"shapes: each DOF once"),
        ({"shapes": [-1]}, ValueError, r"shapes: expected at least 0, got -1"),
        ({"shapes": [1.0]}, TypeError, r"shapes: expected a whole number"),
        ({"shapes": []}, ValueError, r"shapes: expected at least one DOF"),
        ({"shapes": "all"}, TypeError, r"shapes: expected True, False or DOFs"),
    ],
)
def test_wrong_arguments_are_refused_by_name(changed, error, message):
    arguments = {"K0": EYE, "M0": EYE, "K": {"a": EYE}, "n_modes": 1} | changed
    with pytest.raises(error, match=message):
        MatrixModel(**arguments)


def test_an_asymmetry_of_printed_digits_is_averaged_out():
    model = MatrixModel(shifted(EYE, 1, 2, 4e-9), EYE, {}, n_modes=1)
    assert model.K0[1, 2] == model.K0[2, 1] == 2e-9
