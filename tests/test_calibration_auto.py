"""Simulation-based calibration of "auto": 80 data sets of two posteriors.

The test is that of tests/test_calibration.py: ranks of parameters and log-likelihood, 8
bins, Bonferroni's correction of 0.1 % over all of them.
"""

import numpy as np
import pytest
from support.calibration import (
    auto_ranks,
    mass_spring,
    p_values,
    paired,
    shorten_search,
)

import emcee_femu as ef

PROBLEMS = {"mass-spring": mass_spring, "paired": paired}
LEVEL = 0.001 / (6 + 5)  # ranks of 5 and 4 parameters, and of the log-likelihoods


@pytest.fixture(autouse=True)
def short_search(monkeypatch):
    shorten_search(monkeypatch)


class WithoutProposalDensity(ef.IndependenceMove):
    """Accepts by the ratio of posteriors alone."""

    def log_density(self, theta):
        return np.zeros(len(theta))


@pytest.mark.slow
@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_truth_ranks_uniformly_among_the_draws_of_auto(problem):
    seed = 21 + list(PROBLEMS).index(problem)
    assert p_values(auto_ranks(PROBLEMS[problem], 80, seed)).min() > LEVEL


@pytest.mark.slow
@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_ranks_of_a_recipe_without_proposal_density_are_not_uniform(
    problem, monkeypatch
):
    name = "emcee_femu.sampling.record.IndependenceMove"
    monkeypatch.setattr(name, WithoutProposalDensity)
    assert p_values(auto_ranks(PROBLEMS[problem], 60, seed=31)).min() < LEVEL


@pytest.mark.slow
def test_the_ranks_under_shapes_that_are_stated_too_exact_are_not_uniform():
    def too_exact(rng):
        return paired(rng, stated_delta=0.025)

    assert p_values(auto_ranks(too_exact, 60, seed=32)).min() < LEVEL
