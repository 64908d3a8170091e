"""The paper's two structures give its printed frequencies and posteriors."""

import numpy as np
import pytest

import emcee_femu as ef

MASS_SPRING, H = ef.paper.mass_spring(), ef.paper.h_structure()
PRINTED = MASS_SPRING.published


def frequencies(problem, values):
    return problem.model({name: np.array([v]) for name, v in values.items()})[0][0]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (MASS_SPRING.target, [3.50745, 5.14931, 7.08276, 8.89167, 9.42645]),
        (MASS_SPRING.initial, [3.57645, 5.37087, 7.23927, 9.03010, 9.41166]),
        (PRINTED.parameters["paper mean"], PRINTED.frequencies["paper Hz"]),
        (MASS_SPRING.target, MASS_SPRING.measured),
        (MASS_SPRING.nominal, [3.508, 5.154, 7.088, 8.897, 9.434]),
    ],
)
def test_mass_spring_rows(values, expected):
    digits = 1e-5 if len(f"{expected[0]}") > 5 else 6e-4
    computed = frequencies(MASS_SPRING, values)
    np.testing.assert_allclose(computed, expected, rtol=0, atol=digits)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("initial", [51.03, 115.91, 199.70, 246.04, 387.66]),
        ("paper DE-MC", [52.36, 119.35, 210.07, 253.93, 434.19]),
        ("paper M-H", [53.92, 122.26, 211.83, 259.76, 410.09]),
    ],
)
def test_h_structure_rows(name, expected):
    known = H.published.parameters | {"initial": H.initial}
    initially = {"initial": [51.04, 115.79, 199.88, 245.76, 387.53]}
    printed = (H.published.frequencies | initially)[name]
    computed = frequencies(H, known[name])
    np.testing.assert_allclose(computed, expected, rtol=0, atol=0.02)
    np.testing.assert_allclose(computed, printed, rtol=0.005)
