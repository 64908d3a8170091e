"""Simulation-based calibration of the paper's mass-spring posterior, and its check.

Parameters are drawn from the prior and measured frequencies are simulated with them.
The parameters are then themselves a draw of the posterior given these frequencies, so
that among L independent draws of a sampler their rank is uniform on 0 .. L, data set by
data set. The rank of the log-likelihood is tested too: it sees a wrong width of the
posterior at once, which each parameter sees only in part.

The law of the data must be that of the likelihood, exactly. FrequencyTerm divides by
the *measured* frequency, so that for a model frequency f, p(fm | f) is proportional to
exp(-beta (f / fm - 1)^2 / 2) / fm. With u = f / fm this is exp(-beta (u - 1)^2 / 2) / u
whatever f is, so that its constant does not depend on the parameters: fm = f / u with u
drawn from this density, cut at 8 standard deviations from 1. f (1 + noise) resembles it
to first order only.

Sources: Talts, Betancourt, Simpson, Vehtari and Gelman (2018), arXiv:1804.06788;
Modrak et al. (2023), arXiv:2211.02383, on the log-likelihood as a test quantity.
"""

import numpy as np
from scipy import stats

import emcee_femu as ef

WALKERS, SNAPSHOTS, APART, PILOT = 16, 4, 100, 300
DRAWS = WALKERS * SNAPSHOTS - 1  # ranks 0 .. 63 fall evenly into the bins
BINS = 8
PROBLEM = ef.paper.mass_spring()
PRIOR = PROBLEM.posterior.prior
BETA = PROBLEM.posterior.terms[0].beta[0]
QUANTITIES = (*PRIOR.names, "log-likelihood")


def simulated(frequencies, beta, rng):
    """Draw measured frequencies from the law that the likelihood states."""
    width = 8 / np.sqrt(beta)
    if width >= 1:
        raise ValueError(f"beta: expected above 64, got {beta}")
    measured = np.empty_like(frequencies)
    for i, frequency in enumerate(frequencies):
        while True:  # the density of u, by rejection from the Gaussian without 1 / u
            u = 1 + rng.standard_normal() / np.sqrt(beta)
            if abs(u - 1) < width and rng.random() * u < 1 - width:
                break
        measured[i] = frequency / u
    return measured


def ranks(moves, datasets, seed=0, stated_beta=BETA):
    """Return the ranks ``(datasets, 6)`` of the truth among the draws of a sampler.

    Each data set has a run of its own: DE-MC from the best of some prior draws (a
    walker from anywhere may stay for long in a corner of the box, 50 below the others),
    then ``moves(pilot)``, a function of the draws of its second half, ``(n, 5)``.
    The draws are all walkers, independent at any one generation of a valid sampler, at
    four generations that are about four autocorrelation times apart.

    Args:
        moves: Makes the moves.
        datasets: How many.
        seed: A whole number.
        stated_beta: beta of the likelihood; the data always have the paper's.
    """
    result = np.empty((datasets, len(QUANTITIES)), dtype=int)
    for k, stream in enumerate(np.random.SeedSequence(seed).spawn(datasets)):
        rng = np.random.default_rng(stream)
        truth = PRIOR.sample(rng, 1)
        modes = PROBLEM.model(PROBLEM.posterior.parameters(truth))
        term = ef.FrequencyTerm(
            simulated(modes.frequencies[0], BETA, rng), beta=stated_beta
        )
        posterior = ef.LogPosterior(PROBLEM.model, term, PRIOR)
        candidates = PRIOR.sample(rng, 2_000)
        best = np.argsort(posterior(candidates)[:, 0])[-WALKERS:]
        seeds = rng.integers(2**31, size=2).tolist()
        (pilot,) = ef.run(
            posterior,
            ef.DEMCMove(),
            WALKERS,
            PILOT,
            seed=seeds[0],
            initial=candidates[best],
        )
        (sampler,) = ef.run(
            posterior,
            moves(pilot.get_chain(discard=PILOT // 2, flat=True)),
            WALKERS,
            SNAPSHOTS,
            thin_by=APART,
            seed=seeds[1],
            initial=pilot.get_chain()[-1],
        )
        draws = np.column_stack(
            [sampler.get_chain(flat=True), sampler.get_blobs(flat=True)[:, 1]]
        )[:DRAWS]
        true = [*truth[0], posterior(truth)[0, 2]]
        result[k] = (draws < true).sum(axis=0)
    return result


def p_values(found, bins=BINS):
    """Return the chi-square test's p of a uniform rank, one a column of ``(n, k)``."""
    counts = [
        np.histogram(column, bins, (0, DRAWS + 1))[0] for column in np.transpose(found)
    ]
    return stats.chisquare(counts, axis=1).pvalue
