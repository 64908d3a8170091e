"""The paper's two structures give its printed frequencies and posteriors."""

import emcee
import numpy as np
import pytest
from support.importance import importance_moments

import emcee_femu as ef

MASS_SPRING, H = ef.paper.mass_spring(), ef.paper.h_structure()


def frequencies(problem, values):
    return problem.model({name: np.array([v]) for name, v in values.items()})[0][0]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (MASS_SPRING.target, [3.50745, 5.14931, 7.08276, 8.89167, 9.42645]),
        (MASS_SPRING.initial, [3.57645, 5.37087, 7.23927, 9.03010, 9.41166]),
        (
            MASS_SPRING.published.parameters["paper mean"],
            MASS_SPRING.published.frequencies["paper Hz"],
        ),
        (MASS_SPRING.target, MASS_SPRING.measured),
        (MASS_SPRING.nominal, [3.508, 5.154, 7.088, 8.897, 9.434]),
    ],
)
def test_mass_spring_rows(values, expected):
    digits = 1e-5 if len(f"{expected[0]}") > 5 else 6e-4
    np.testing.assert_allclose(
        frequencies(MASS_SPRING, values), expected, rtol=0, atol=digits
    )


@pytest.mark.parametrize(
    ("values", "expected", "printed"),
    [
        (
            H.initial,
            [51.03, 115.91, 199.70, 246.04, 387.66],
            [51.04, 115.79, 199.88, 245.76, 387.53],
        ),
        (
            H.published.parameters["paper DE-MC"],
            [52.36, 119.35, 210.07, 253.93, 434.19],
            H.published.frequencies["paper DE-MC"],
        ),
        (
            H.published.parameters["paper M-H"],
            [53.92, 122.26, 211.83, 259.76, 410.09],
            H.published.frequencies["paper M-H"],
        ),
    ],
)
def test_h_structure_rows(values, expected, printed):
    computed = frequencies(H, values)
    np.testing.assert_allclose(computed, expected, rtol=0, atol=0.02)
    np.testing.assert_allclose(computed, printed, rtol=0.005)


@pytest.mark.slow
def test_h_structure_with_the_implied_beta_agrees_with_importance_sampling():
    """The law of a narrow posterior: moments by a route without chains."""
    posterior = ef.paper.h_structure(5e4).posterior
    (run,) = ef.run(posterior, nwalkers=14, steps=400, seed=3, ensembles=1)
    chain = run.get_chain()
    draws = chain.reshape(-1, 6)
    mean, sd, kish = importance_moments(posterior, [draws], 16_000, seed=3)
    assert kish > 2_500
    # First and second powers, in the chain's own errors, and those of the weights.
    for power, expected in ((1, 0.0), (2, 1.0)):
        values = ((chain - mean) / sd) ** power
        tau = emcee.autocorr.integrated_time(values, quiet=True)
        error = values.std(axis=(0, 1)) * np.sqrt(tau / len(draws) + 1 / kish)
        assert (np.abs(values.mean(axis=(0, 1)) - expected) < 4 * error).all()
        assert error.max() < 0.2
    # A local mode at A3 = 4.9e-4 with a mass near 2e-4 would make the last one 3.1.
    np.testing.assert_allclose(
        100 * sd / mean, [35.5, 4.3, 29.5, 1.8, 2.25, 2.9], rtol=0.08
    )
