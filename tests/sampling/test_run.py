"""run: seeds, starts, ensembles, moves, and the traps of plain emcee."""

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.free_posterior import box, free_posterior
from support.runs import Still, never, shorten_search

import emcee_femu as ef

PROBLEM = ef.paper.mass_spring()


def run(moves=None, posterior=PROBLEM.posterior, **options):
    options = {"nwalkers": 12, "seed": 1, "steps": 20, "ensembles": 1} | options
    return ef.run(posterior, moves or ef.DEMCMove(), **options)


def chains(*arguments, **options):
    return [sampler.get_chain() for sampler in run(*arguments, **options)]


def test_it_returns_emcees_own_samplers_one_an_ensemble():
    samplers = run(nwalkers=10, steps=5, ensembles=3)
    assert len(samplers) == 3
    for sampler in samplers:
        assert isinstance(sampler, emcee.EnsembleSampler)
        assert sampler.get_chain().shape == (5, 10, 5)
        assert_allclose(
            sampler.get_log_prob()[-1], PROBLEM.posterior(sampler.get_chain()[-1])[:, 0]
        )


def test_same_seed_same_chain_whatever_the_global_stream_or_other_ensembles():
    np.random.seed(3)  # noqa: NPY002 - the stream that emcee would copy
    first = chains(ensembles=2)
    np.random.seed(4)  # noqa: NPY002
    assert_array_equal(first[0], chains(ensembles=1)[0])
    assert_array_equal(first[0][1::2], chains(steps=10, thin_by=2)[0])
    assert not np.array_equal(first[0], chains(seed=2)[0])


def test_ensembles_have_independent_starts_and_streams():
    starts = np.array(chains(Still(), ensembles=4, steps=1))
    assert len(np.unique(starts.reshape(-1, 5), axis=0)) == 4 * 12
    # Equal starts, so that only the streams can differ.
    same = [starts[0, 0]] * 4
    moved = np.array(chains(ensembles=4, steps=1, starts=same))[:, 0, :, 0]
    stayed = np.isin(moved, starts[0, 0, :, 0])
    assert len(np.unique(moved[~stayed])) == (~stayed).sum() > 4


def test_all_samples_stay_inside_the_bounds_and_start_over_dispersed():
    low, high = PROBLEM.posterior.prior.bounds.T
    (chain,) = chains(steps=60, nwalkers=60)
    assert ((chain >= low) & (chain <= high)).all()
    assert (chain[0].std(axis=0) > 0.15 * (high - low)).all()
    (alone,) = chains(ef.MetropolisMove(sd=20.0), nwalkers=1, steps=100)
    assert np.ptp(alone[:, 0], axis=0).min() > 0


def test_the_default_is_auto_with_four_ensembles_of_enough_walkers(monkeypatch):
    shorten_search(monkeypatch)
    law = stats.norm(np.arange(5.0) - 2, 0.5)
    known = free_posterior(lambda x: law.logpdf(x).sum(axis=1), box(-4.0, 4.0, 5))
    samplers = ef.run(known, steps=1, seed=1)
    assert [sampler.nwalkers for sampler in samplers] == [20] * 4
    assert samplers.search.climbs > 0
    ladder = ef.moves.TemperedMove(ef.DEMCMove(), [1, 0.5])
    (tempered,) = ef.run(PROBLEM.posterior, ladder, steps=1, seed=1, ensembles=1)
    assert tempered.nwalkers == 40  # as many for each temperature


def test_integer_starts_are_converted_instead_of_truncated():
    start = np.round(PROBLEM.posterior.start(12, seed=2)).astype(int)
    (chain,) = chains(starts=start)
    assert_array_equal(chain, chains(starts=start.astype(float))[0])
    assert (chain[-1] % 1 != 0).any()


UNSOLVED = ef.LogPosterior(
    ef.FunctionModel(never), PROBLEM.posterior.terms, PROBLEM.posterior.prior
)
OUTSIDE = PROBLEM.posterior.start(12, seed=1)
OUTSIDE[3, 2] = 9999.0


@pytest.mark.parametrize(
    ("options", "error", "named"),
    [
        ({"nwalkers": 8}, RuntimeError, "2 \\* ndim"),
        ({"seed": np.random.default_rng(1)}, TypeError, "seed"),
        ({"starts": OUTSIDE}, ValueError, "k4 = 9999 of point 3"),
        ({"starts": OUTSIDE, "ensembles": 2}, ValueError, "starts"),
        ({"backend": [emcee.backends.Backend()] * 2}, ValueError, "backend"),
    ],
)
def test_what_does_not_fit_is_refused_before_the_first_solve(options, error, named):
    with pytest.raises(error, match=named):
        run(**{"posterior": UNSOLVED} | options)
