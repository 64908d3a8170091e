"""run: seeds, starts, pools, backends and the traps of plain emcee."""

from concurrent.futures import ProcessPoolExecutor

import emcee
import numpy as np
import pytest

import emcee_femu as ef

PROBLEM = ef.paper.mass_spring()
H_STRUCTURE = ef.paper.h_structure(5e4)


def chains(posterior=PROBLEM.posterior, nsteps=20, **options):
    options = {"nwalkers": 12, "seed": 1, "nsteps": nsteps, **options}
    return [s.get_chain() for s in ef.run(posterior, **options)]


def test_it_returns_emcees_own_samplers_one_an_ensemble():
    samplers = ef.run(PROBLEM.posterior, nwalkers=10, nsteps=5, ensembles=3, seed=0)
    assert len(samplers) == 3
    for sampler in samplers:
        assert type(sampler) is emcee.EnsembleSampler
        assert sampler.get_chain().shape == (5, 10, 5)


def test_same_seed_same_chain_whatever_the_global_stream():
    np.random.seed(3)  # noqa: NPY002 - the stream that emcee would copy
    first = chains(ensembles=2)
    np.random.seed(4)  # noqa: NPY002
    second = chains(ensembles=2)
    assert np.array_equal(first, second)
    assert not np.array_equal(first[0], chains(seed=2)[0])


class Still(ef.DEMCMove):
    """A move that does not move: the starts alone are looked at."""

    def propose(self, model, state):
        return state, np.zeros(len(state.coords), bool)


@pytest.mark.parametrize("moves", [None, "auto"])
def test_ensembles_have_independent_starts_and_streams(moves):
    starts = np.array(chains(moves=Still(), ensembles=4, nsteps=1))
    assert len(np.unique(starts.reshape(-1, 5), axis=0)) == 4 * 12
    # Equal starts, so that only the streams can differ.
    samplers = ef.run(
        PROBLEM.posterior, moves, 12, 1, ensembles=4, seed=1, initial=[starts[0, 0]] * 4
    )
    keys = {sampler.backend.random_state[1].tobytes() for sampler in samplers}
    assert len(keys) == 4
    moved = np.array([s.get_chain()[0] for s in samplers])[:, :, 0]
    stayed = np.isin(moved, starts[0, 0, :, 0])
    assert len(np.unique(moved[~stayed])) == (~stayed).sum() > 4


def test_an_ensemble_is_the_same_whether_or_not_others_follow():
    assert np.array_equal(chains(ensembles=1)[0], chains(ensembles=3)[0])


@pytest.mark.parametrize("posterior", [PROBLEM.posterior, H_STRUCTURE.posterior])
@pytest.mark.parametrize("vectorize", [None, False])
def test_chains_are_the_same_to_the_bit_serial_vectorized_and_pooled(
    posterior, vectorize
):
    reference = chains(posterior)[0]
    assert np.array_equal(reference, chains(posterior, vectorize=vectorize)[0])
    with ProcessPoolExecutor(2) as pool:
        assert np.array_equal(reference, chains(posterior, pool=pool)[0])
    assert np.array_equal(reference, chains(posterior, workers=2)[0])


def test_thin_by_keeps_every_second_generation():
    assert np.array_equal(chains(nsteps=20)[0][1::2], chains(nsteps=10, thin_by=2)[0])


def test_all_samples_stay_inside_the_bounds_and_start_over_dispersed():
    low, high = PROBLEM.posterior.prior.bounds.T
    chain = chains(nsteps=200, nwalkers=60)[0]
    assert ((chain >= low) & (chain <= high)).all()
    assert (chain[0].std(axis=0) > 0.15 * (high - low)).all()


def test_integer_starts_are_converted_instead_of_truncated():
    start = np.round(PROBLEM.posterior.start(12, seed=2)).astype(int)
    chain = chains(initial=start)[0]
    assert np.array_equal(chain, chains(initial=start.astype(float))[0])
    assert (chain[-1] % 1 != 0).any()


def test_moves_may_be_one_a_list_or_weighted():
    moves = [ef.DEMCMove(), ef.MetropolisMove(sd=10.0)]
    for given in (moves[0], moves, [(moves[0], 0.7), (emcee.moves.StretchMove(), 0.3)]):
        assert chains(moves=given)[0].shape == (20, 12, 5)


def test_one_metropolis_walker_is_a_legitimate_ensemble():
    chain = chains(moves=ef.MetropolisMove(sd=20.0), nwalkers=1, nsteps=300)[0]
    assert np.ptp(chain[:, 0], axis=0).min() > 0


def test_the_default_ensemble_is_large_enough_for_dimension_and_ladder():
    for moves, expected in [(None, 20), (ef.TemperedMove(ef.DEMCMove(), [1, 0.5]), 40)]:
        (sampler,) = ef.run(PROBLEM.posterior, moves, nsteps=1, seed=1)
        assert sampler.nwalkers == expected


def test_samplers_know_whether_their_starts_were_given():
    start = PROBLEM.posterior.start(12, seed=5)
    for initial, given in [(None, False), (start, True)]:
        options = {"nwalkers": 12, "nsteps": 1, "seed": 1, "initial": initial}
        (sampler,) = ef.run(PROBLEM.posterior, **options)
        assert sampler.starts_given is given


def never(parameters):
    raise AssertionError("solved")


UNSOLVED = ef.LogPosterior(
    ef.FunctionModel(never), PROBLEM.posterior.terms, PROBLEM.posterior.prior
)
OUTSIDE = PROBLEM.posterior.start(12, seed=1)
OUTSIDE[3, 2] = 9999.0


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"nwalkers": 12.0}, TypeError, "nwalkers"),
        ({"nwalkers": 0}, ValueError, "nwalkers"),
        ({"nwalkers": 8}, RuntimeError, "2 \\* ndim"),
        ({"nsteps": 0}, ValueError, "nsteps"),
        ({"thin_by": 0}, ValueError, "thin_by"),
        ({"ensembles": 0}, ValueError, "ensembles"),
        ({"seed": None}, TypeError, "seed"),
        ({"seed": np.random.default_rng(1)}, TypeError, "seed"),
        ({"seed": -1}, ValueError, "seed"),
        ({"moves": ef.DEMCMove(sigma=[1.0, 2.0])}, ValueError, "sigma"),
        ({"moves": [(ef.MetropolisMove(sd=[1.0]), 1.0)]}, ValueError, "sd"),
        ({"initial": OUTSIDE}, ValueError, "k4 = 9999 of point 3"),
        ({"initial": OUTSIDE[:5]}, ValueError, "initial"),
        ({"initial": OUTSIDE, "ensembles": 2}, ValueError, "initial"),
        ({"initial": np.full((12, 5), np.nan)}, ValueError, "initial"),
        ({"pool": ProcessPoolExecutor, "vectorize": True}, ValueError, "vectorize"),
        ({"backend": [emcee.backends.Backend()] * 2}, ValueError, "backend"),
    ],
)
def test_bad_input_is_refused_before_the_first_solve(options, error, match):
    with pytest.raises(error, match=match):
        chains(UNSOLVED, **options)


def test_a_bare_function_is_referred_to_emcee():
    with pytest.raises(TypeError, match="EnsembleSampler"):
        ef.run(lambda theta: 0.0, seed=1)


def test_a_start_of_zero_probability_is_refused():
    def term(parameters, modes):
        return np.where(parameters["k1"] > 4000, 0.0, -np.inf)

    posterior = ef.LogPosterior(PROBLEM.model, term, PROBLEM.posterior.prior)
    with pytest.raises(ValueError, match="walker .* -inf"):
        chains(posterior, vectorize=True)


def test_progress_shows_a_bar_an_ensemble(capsys):
    chains(ensembles=2, progress=True)
    shown = capsys.readouterr().err
    assert "ensemble 1/2" in shown and "ensemble 2/2" in shown
