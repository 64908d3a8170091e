"""Simulation-based calibration of a posterior's whole chain, and of "auto".

The test, stated: of the ranks, for each parameter and the log-likelihood, a chi-square
test of the uniform law in 8 bins. Bonferroni's correction asks each of these for
p > 0.001 / their number, so that a sound chain fails with a probability of at most
0.1 %, over the choice of the seed. For a mutant at least one p must be below that.
Moves by themselves are held to their law by exact starts (moves/test_moves_law.py).
"""

import numpy as np
import pytest
from scipy import stats
from support.calibration import (
    BETA,
    QUANTITIES,
    auto_ranks,
    mass_spring,
    p_values,
    ranks,
    shorten_search,
    simulated,
)

import emcee_femu as ef


class WithoutProposalDensity(ef.IndependenceMove):
    """Accepts by the ratio of posteriors alone."""

    def log_density(self, theta):
        return np.zeros(len(theta))


def mixed(pilot, kind=ef.IndependenceMove):
    return [(ef.DEMCMove(), 0.5), (kind.fit(pilot), 0.5)]


LEVEL = 0.001 / len(QUANTITIES)


@pytest.mark.slow
def test_the_truth_ranks_uniformly_among_the_draws():
    """The law of the whole chain of solver, likelihood, prior and moves."""
    assert p_values(ranks(mixed, 64, seed=3)).min() > LEVEL


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["no proposal density", "twice the noise"])
def test_the_ranks_of_a_broken_chain_are_not_uniform(fault):
    """The power of the law: a move that is no Metropolis move, a wrong likelihood."""
    if fault == "twice the noise":
        found = ranks(mixed, 48, seed=12, stated_beta=BETA / 4)
    else:
        found = ranks(lambda draws: mixed(draws, WithoutProposalDensity), 48, seed=11)
    assert p_values(found).min() < LEVEL


@pytest.mark.slow
def test_the_truth_ranks_uniformly_among_the_draws_of_auto(monkeypatch):
    """The law for "auto", whose proposal is made anew for every data set."""
    shorten_search(monkeypatch)
    assert p_values(auto_ranks(mass_spring, 40, 21)).min() > LEVEL
    name = "emcee_femu.sampling.record.IndependenceMove"
    monkeypatch.setattr(name, WithoutProposalDensity)
    assert p_values(auto_ranks(mass_spring, 60, 31)).min() < LEVEL


@pytest.mark.parametrize("beta", [100.0, BETA])
def test_data_are_simulated_from_the_law_that_the_likelihood_states(beta):
    # The likelihood itself, of a model frequency of 5 Hz, at a grid of measured ones.
    grid = 5 / (1 + np.linspace(-8, 8, 2_001)[::-1] / np.sqrt(beta))
    modes = ef.ModalSolution(np.array([[5.0]]))
    density = [np.exp(ef.FrequencyTerm([fm], beta=beta)({}, modes)[0]) for fm in grid]
    areas = np.diff(grid) * (np.array(density[1:]) + density[:-1]) / 2
    cumulative = np.append(0, np.cumsum(areas)) / areas.sum()
    sample = simulated(np.full(20_000, 5.0), beta, np.random.default_rng(1))
    p = stats.kstest(sample, lambda fm: np.interp(fm, grid, cumulative)).pvalue
    assert p > 1e-3
    if beta == 100.0:  # of the paper's beta the difference is 0.1 % of a deviation
        rough = 5 * (1 + np.random.default_rng(1).standard_normal(20_000) / 10)
        assert stats.kstest(rough, sample).pvalue < 1e-6
