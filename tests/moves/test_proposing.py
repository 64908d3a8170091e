"""The moves as emcee plugins: bits, blobs, files, pickles, refusals before a solve."""

import pickle
from multiprocessing.pool import ThreadPool

import emcee
import numpy as np
import pytest
from emcee.backends import HDFBackend
from support.runs import never

import emcee_femu as ef
from emcee_femu import DEMCMove, IndependenceMove, MetropolisMove

START = np.random.default_rng(0).normal(size=(10, 3))
BOLD = {"live_dangerously": True}
STREAM = np.random.RandomState(1).get_state()
MIXTURE = IndependenceMove([0.3, 0.7], [[0.0, 1], [2, 3]], [np.eye(2)] * 2, df=5.0)


def log_prob(theta):
    return -0.5 * (theta * theta).sum(axis=-1)


def with_blobs(theta):
    return -0.5 * float(theta @ theta), float(theta.sum()), float(theta[0])


def chain(function, moves, steps=60, start=START, **options):
    sampler = emcee.EnsembleSampler(*start.shape, function, moves=moves, **options)
    sampler.run_mcmc(emcee.State(start, random_state=STREAM), steps)
    return sampler


MOVES = {
    "three parts": DEMCMove(nsplits=3, randomize_split=False),
    "M-H": MetropolisMove(sd=0.5),
    "mixed": [(DEMCMove(gamma0=1.0), 0.5), (MetropolisMove(sd=1), 0.5)],
    "with stock": [(DEMCMove(), 0.5), (emcee.moves.StretchMove(), 0.5)],
}


# The others are slow: their parts are in these two.
PARTS = "mixed", "three parts"
slow_parts = [
    pytest.param(name, marks=[pytest.mark.slow] * (name not in PARTS)) for name in MOVES
]


@pytest.mark.parametrize("moves", slow_parts)
def test_chains_are_the_same_serial_vectorised_pooled_and_resumed(moves, tmp_path):
    move, name = MOVES[moves], str(tmp_path / "chain.h5")
    serial = chain(log_prob, move).get_chain()
    assert np.array_equal(serial, chain(log_prob, move, vectorize=True).get_chain())
    with ThreadPool(2) as pool:
        assert np.array_equal(serial, chain(log_prob, move, pool=pool).get_chain())
    chain(log_prob, move, steps=25, backend=HDFBackend(name))
    again = emcee.EnsembleSampler(10, 3, log_prob, moves=move, backend=HDFBackend(name))
    again.run_mcmc(again.get_last_sample(), 35)
    assert np.array_equal(serial, again.get_chain())


@pytest.mark.parametrize("moves", MOVES)
def test_blobs_and_counts_stay_with_their_walkers(moves):
    sampler = chain(with_blobs, MOVES[moves])
    coords, blobs = sampler.get_chain(), sampler.get_blobs()
    assert np.array_equal(blobs[..., 1], coords[..., 0])
    np.testing.assert_allclose(blobs[..., 0], coords.sum(axis=-1), atol=1e-12)
    np.testing.assert_allclose(sampler.get_log_prob(), log_prob(coords), rtol=1e-12)
    steps = np.diff(np.concatenate([START[None], coords]), axis=0)
    moved = (steps != 0).any(axis=2).sum(axis=0)
    assert np.array_equal(moved, sampler.backend.accepted) and (moved > 0).all()
    assert 0.05 < sampler.acceptance_fraction.mean() < 0.95


@pytest.mark.parametrize(
    "move",
    [
        DEMCMove(sigma=[0.1, 0.2]),
        DEMCMove(0.1, 0.5, nsplits=3, mode_jump=0.2, **BOLD),
        MetropolisMove(sd=0.1),
        MetropolisMove(cov=[[2.0, 0.1], [0.1, 1.0]]),
        MIXTURE,
    ],
    ids=lambda move: type(move).__name__,
)
def test_moves_are_pickled_and_print_as_the_call_that_makes_them(move):
    reference = chain(log_prob, move, start=START[:, :2]).get_chain()
    for again in (pickle.loads(pickle.dumps(move)), eval(repr(move))):
        assert repr(again) == repr(move)
        same = chain(log_prob, again, start=START[:, :2]).get_chain()
        assert np.array_equal(reference, same)


@pytest.mark.parametrize(
    ("move", "shape", "error", "match"),
    [
        (DEMCMove(), (2, 1), ValueError, "nwalkers"),
        (DEMCMove(**BOLD), (3, 2), ValueError, "at rest"),
        (DEMCMove(nsplits=12), (10, 3), ValueError, "nsplits"),
        (DEMCMove(), (4, 3), RuntimeError, r"6, got 4; .*live_dangerously"),
        (DEMCMove(sigma=[0.1, 0.1]), (10, 3), ValueError, "sigma"),
        (MetropolisMove(sd=[1.0, 1.0]), (10, 3), ValueError, "sd"),
        (MetropolisMove(cov=np.eye(2)), (10, 3), ValueError, "cov"),
        (MIXTURE, (10, 4), ValueError, "means"),
        (ef.moves.HamiltonianMove([1.0]), (10, 3), ValueError, "metric"),
    ],
)
def test_a_move_that_does_not_fit_is_refused_before_a_solve(move, shape, error, match):
    start = np.random.default_rng(0).normal(size=shape)
    sampler = emcee.EnsembleSampler(*shape, never, moves=move)
    with pytest.raises(error, match=match):
        sampler.run_mcmc(emcee.State(start, log_prob=np.zeros(len(start))), 1)


def test_integer_starts_are_refused_instead_of_truncated():
    start = np.random.default_rng(0).integers(0, 9, (10, 3))
    sampler = emcee.EnsembleSampler(10, 3, log_prob, moves=DEMCMove())
    with pytest.raises(TypeError, match="float"):
        sampler.run_mcmc(start, 1)


def test_walkers_at_minus_infinity_move_as_soon_as_they_can():
    def half(theta):
        return np.where(theta[:, 0] > 0, log_prob(theta), -np.inf)

    start = START.copy()
    start[:, 0] = np.abs(start[:, 0]) * np.repeat([-1, 1], 5)
    last = chain(half, DEMCMove(), steps=300, start=start, vectorize=True)
    assert np.isfinite(last.get_log_prob()[-1]).all()
    start[:, 0] = -np.abs(start[:, 0])  # where no walker knows the way
    with pytest.raises(ValueError, match="initial_state"):
        chain(half, DEMCMove(), start=start, vectorize=True)
