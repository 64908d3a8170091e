"""What a run is given: moves with weights, walkers, starts, backends."""

import emcee
import numpy as np
import pytest

import emcee_femu as ef
from emcee_femu.sampling.arguments import (
    check_backends,
    check_starts,
    check_walkers,
    weigh_moves,
)

POSTERIOR = ef.paper.mass_spring().posterior
ONE, OTHER = ef.DEMCMove(), ef.MetropolisMove(sd=0.1)


@pytest.mark.parametrize(
    ("moves", "weights"),
    [
        (ONE, [1.0]),
        ([ONE, OTHER], [1.0, 1.0]),
        ([(ONE, 3), (OTHER, 0.0)], [3.0, 0.0]),
        (((ONE, 0.5),), [0.5]),
    ],
)
def test_moves_have_weights_however_they_are_given(moves, weights):
    found = weigh_moves(moves)
    assert [weight for _, weight in found] == weights and found[0][0] is ONE


@pytest.mark.parametrize(
    ("moves", "error", "named"),
    [
        ([(ONE, 1.0), OTHER], TypeError, "pairs"),
        ([(ONE, 1.0, 2.0)], TypeError, "pairs"),
        (ef.DEMCMove, TypeError, r"write DEMCMove\(\)"),
        ([], ValueError, "at least one move"),
        ([(ONE, 0.0)], ValueError, "above zero"),
        ([(ONE, -1.0)], ValueError, "weights"),
    ],
)
def test_what_is_no_move_is_refused(moves, error, named):
    with pytest.raises(error, match=named):
        weigh_moves(moves)


def test_walkers_by_default_grow_with_the_parameters_and_the_ladder():
    ndim = POSTERIOR.ndim
    assert check_walkers(None, None, POSTERIOR) == max(16, 4 * ndim)
    assert check_walkers(None, None, POSTERIOR, few=True) == max(8, 2 * ndim)
    hot = ef.moves.TemperedMove(ef.DEMCMove(), betas=[1.0, 0.3, 0.0])
    assert check_walkers(None, [(hot, 1.0)], POSTERIOR) == 3 * max(16, 4 * ndim)
    with pytest.raises(ValueError):
        check_walkers(2, [(ONE, 1.0)], POSTERIOR)


def test_starts_are_a_copy_in_double_precision_inside_the_bounds():
    mean = np.rint(POSTERIOR.prior.mean).astype(int)
    given = np.tile(mean, (5, 1))
    with pytest.raises(ValueError, match="starts.*scatter"):
        check_starts(given, POSTERIOR, 1, 5)
    given[1] += 1
    found = check_starts(given, POSTERIOR, 1, 5)
    assert found.shape == (1, 5, POSTERIOR.ndim) and found.dtype == float
    given[0] = 0
    assert (found[0, 0] == mean).all()
    with pytest.raises(ValueError, match="ensembles, nwalkers, ndim"):
        check_starts(given, POSTERIOR, 2, 5)
    with pytest.raises(ValueError, match="starts"):
        check_starts(-np.abs(found), POSTERIOR, 1, 5)


def test_a_backend_is_empty_and_one_for_each_ensemble():
    assert check_backends(None, 3) == [None] * 3
    empty = emcee.backends.Backend()
    assert check_backends(empty, 1) == [empty]
    with pytest.raises(ValueError, match="one for each of 2 ensembles"):
        check_backends(empty, 2)
    with pytest.raises(TypeError, match="emcee backends"):
        check_backends([3.0], 1)
    sampler = emcee.EnsembleSampler(4, 1, lambda x: -float(x @ x))
    sampler.run_mcmc(np.random.default_rng(0).normal(size=(4, 1)), 3)
    with pytest.raises(ValueError, match="already holds 3 steps"):
        check_backends(sampler.backend, 1)
