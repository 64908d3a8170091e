"""The moves as emcee plugins: drop-in use, errors before any evaluation, overhead."""

import pickle
from multiprocessing.pool import ThreadPool

import emcee
import numpy as np
import pytest
from emcee.backends import HDFBackend

from emcee_femu.moves import (
    CrossoverMove,
    DEMCMove,
    IndependenceMove,
    MetropolisMove,
    SnookerMove,
)

START = np.random.default_rng(0).normal(size=(10, 3))
BOLD = {"live_dangerously": True}
STREAM = np.random.RandomState(1).get_state()


def log_prob(theta):
    return -0.5 * (theta * theta).sum(axis=-1)


def with_blobs(theta):
    return -0.5 * float(theta @ theta), float(theta.sum()), float(theta[0])


def chain(function, moves, steps=60, start=START, **options):
    sampler = emcee.EnsembleSampler(*start.shape, function, moves=moves, **options)
    thin_by = options.pop("thin_by", 1)
    sampler.run_mcmc(emcee.State(start, random_state=STREAM), steps, thin_by=thin_by)
    return sampler


MOVES = {
    "DE-MC": DEMCMove(),
    "sweep": DEMCMove(nsplits=10),
    "M-H": MetropolisMove(sd=0.5),
    "mixture": [
        (DEMCMove(), 0.8),
        (DEMCMove(gamma0=1.0), 0.1),
        (MetropolisMove(sd=1), 0.1),
    ],
    "snooker": SnookerMove(),
    "crossover": CrossoverMove(2),
    "subspace": [(DEMCMove(), 0.7), (CrossoverMove(1), 0.2), (SnookerMove(), 0.1)],
    "with stock": [(DEMCMove(), 0.5), (emcee.moves.StretchMove(), 0.5)],
}


@pytest.mark.parametrize("moves", MOVES)
def test_serial_vectorized_and_pooled_chains_are_the_same_to_the_bit(moves):
    move = MOVES[moves]
    serial = chain(log_prob, move).get_chain()
    assert np.array_equal(serial, chain(log_prob, move, vectorize=True).get_chain())
    with ThreadPool(2) as pool:
        assert np.array_equal(serial, chain(log_prob, move, pool=pool).get_chain())
    assert np.ptp(serial[:, :, 0]) > 1  # it moved


@pytest.mark.parametrize("moves", MOVES)
@pytest.mark.parametrize("dtype", [None, [("sum", float), ("first", float)]])
def test_plain_and_structured_blobs_stay_with_their_walkers(moves, dtype):
    sampler = chain(with_blobs, MOVES[moves], blobs_dtype=dtype)
    coords, blobs = sampler.get_chain(), sampler.get_blobs()
    total = blobs["sum"] if dtype else blobs[..., 0]
    first = blobs["first"] if dtype else blobs[..., 1]
    assert np.array_equal(first, coords[..., 0])
    np.testing.assert_allclose(total, coords.sum(axis=-1), atol=1e-14)
    np.testing.assert_allclose(sampler.get_log_prob(), log_prob(coords), rtol=1e-13)


@pytest.mark.parametrize("moves", MOVES)
def test_hdf_backend_resumes_bit_identically(moves, tmp_path):
    move = MOVES[moves]
    whole = chain(with_blobs, move, steps=40).get_chain()
    file = HDFBackend(str(tmp_path / "chain.h5"))
    chain(with_blobs, move, steps=25, backend=file)
    again = emcee.EnsembleSampler(
        10, 3, with_blobs, moves=move, backend=HDFBackend(str(tmp_path / "chain.h5"))
    )
    again.run_mcmc(again.get_last_sample(), 15)
    assert np.array_equal(whole, again.get_chain())


@pytest.mark.parametrize("moves", MOVES)
def test_thin_by_stores_every_third_generation(moves):
    def run(steps, thin_by):
        sampler = emcee.EnsembleSampler(10, 3, log_prob, moves=MOVES[moves])
        sampler.run_mcmc(
            emcee.State(START, random_state=STREAM), steps, thin_by=thin_by
        )
        return sampler

    assert np.array_equal(run(60, 1).get_chain()[2::3], run(20, 3).get_chain())


@pytest.mark.parametrize("moves", MOVES)
def test_acceptance_counts_the_walkers_that_moved(moves):
    sampler = chain(log_prob, MOVES[moves], steps=200)
    positions = np.concatenate([START[None], sampler.get_chain()])
    moved = (np.diff(positions, axis=0) != 0).any(axis=2).sum(axis=0)
    assert np.array_equal(moved, sampler.backend.accepted)
    assert 0.05 < sampler.acceptance_fraction.mean() < 0.95


MIXTURE = IndependenceMove([0.3, 0.7], [[0.0, 1], [2, 3]], [np.eye(2)] * 2, df=5.0)


@pytest.mark.parametrize(
    "move",
    [
        DEMCMove(sigma=[0.1, 0.2]),
        DEMCMove(0.1, 0.5, nsplits=3, mode_jump=0.2, **BOLD),
        MetropolisMove(sd=0.1),
        MetropolisMove(cov=[[2.0, 0.1], [0.1, 1.0]]),
        SnookerMove((1, 2), nsplits=3),
        CrossoverMove(2, [0.1, 1 / 3], [0.1, 0.2], **BOLD),
        MIXTURE,
    ],
    ids=lambda move: type(move).__name__,
)
def test_moves_survive_pickling_and_print_as_the_call_that_makes_them(move):
    reference = chain(log_prob, move, start=START[:, :2]).get_chain()
    for again in (pickle.loads(pickle.dumps(move)), eval(repr(move))):
        assert repr(again) == repr(move)
        same = chain(log_prob, again, start=START[:, :2]).get_chain()
        assert np.array_equal(reference, same)


@pytest.mark.parametrize(
    ("make", "error", "match"),
    [
        (lambda: DEMCMove(sigma=-1.0), ValueError, "sigma"),
        (lambda: DEMCMove(sigma=np.nan), ValueError, "sigma"),
        (lambda: DEMCMove(sigma=[[0.1]]), ValueError, "sigma"),
        (lambda: DEMCMove(sigma="0.1"), TypeError, "sigma"),
        (lambda: DEMCMove(gamma0=-0.5), ValueError, "gamma0"),
        (lambda: DEMCMove(gamma0=np.inf), ValueError, "gamma0"),
        (lambda: DEMCMove(mode_jump=1.5), ValueError, "mode_jump"),
        (lambda: DEMCMove(mode_jump=-0.1), ValueError, "mode_jump"),
        (lambda: DEMCMove(nsplits=1), ValueError, "nsplits"),
        (lambda: DEMCMove(nsplits=2.0), TypeError, "nsplits"),
        (lambda: MetropolisMove(), TypeError, "sd, cov: .* got neither"),
        (lambda: MetropolisMove(sd=1.0, cov=1.0), TypeError, "sd, cov: .* got both"),
        (lambda: MetropolisMove(np.eye(2)), TypeError, "positional"),
        (lambda: MetropolisMove(sd=0.0), ValueError, "sd"),
        (lambda: MetropolisMove(sd=[1.0, -1.0]), ValueError, "sd"),
        (lambda: MetropolisMove(sd=np.ones((2, 2))), ValueError, "sd: .* cov="),
        (lambda: MetropolisMove(cov=0.0), ValueError, "cov"),
        (lambda: MetropolisMove(cov=[[1.0, 2.0], [2.0, 1.0]]), ValueError, "cov"),
        (lambda: MetropolisMove(cov=[[1.0, 0.2], [0.0, 1.0]]), ValueError, "cov"),
        (lambda: MetropolisMove(cov=[[1.0, 0.2]]), ValueError, "cov"),
        (lambda: MetropolisMove.tuned(np.ones((2, 3))), ValueError, "samples"),
        (lambda: MetropolisMove.tuned(np.ones((9, 3))), ValueError, "samples"),
        (lambda: SnookerMove(1.7), ValueError, "gamma"),
        (lambda: SnookerMove((2.2, 1.2)), ValueError, "gamma.*low <= high"),
        (lambda: SnookerMove((0.0, 1.2)), ValueError, "gamma"),
        (lambda: SnookerMove("wide"), TypeError, "gamma"),
        (lambda: SnookerMove(nsplits=1), ValueError, "nsplits"),
        (lambda: CrossoverMove(0), ValueError, "pairs"),
        (lambda: CrossoverMove(4), ValueError, "pairs: expected 1, 2 or 3"),
        (lambda: CrossoverMove(1.0), TypeError, "pairs"),
        (lambda: CrossoverMove(1, []), ValueError, "crossover"),
        (lambda: CrossoverMove(1, [0.5, 1.1]), ValueError, "crossover"),
        (lambda: CrossoverMove(1, 0.5), ValueError, "crossover"),
        (lambda: CrossoverMove(sigma=[-0.1]), ValueError, "sigma"),
        (lambda: IndependenceMove([1.0], [[0.0]], [[[0.0]]]), ValueError, "scale_mat"),
        (lambda: IndependenceMove([1.0], [[0.0]], [[[1.0]]], 0), ValueError, "df"),
        (lambda: IndependenceMove([-1.0], [[0.0]], [[[1.0]]]), ValueError, "weights"),
        (lambda: IndependenceMove([1.0], [[0.0]], np.eye(2)), ValueError, "scale_mat"),
        (lambda: IndependenceMove([1, 1], [[0.0]], [[[1]]]), ValueError, "weights"),
        (lambda: IndependenceMove.fit(np.ones((50, 2))), ValueError, "samples"),
        (lambda: IndependenceMove.fit(np.zeros((5, 2))), ValueError, "samples"),
        (lambda: IndependenceMove.fit([["a"]]), TypeError, "samples"),
        (lambda: IndependenceMove.fit(np.eye(40), 1.5), TypeError, "components"),
        (lambda: IndependenceMove.fit(np.eye(40), "many"), TypeError, "components"),
    ],
)
def test_wrong_settings_are_refused_by_name(make, error, match):
    with pytest.raises(error, match=match):
        make()


@pytest.mark.parametrize(
    ("move", "shape", "error", "match"),
    [
        (DEMCMove(), (2, 1), ValueError, "nwalkers"),
        (DEMCMove(**BOLD), (3, 2), ValueError, "at rest"),
        (DEMCMove(nsplits=12), (10, 3), ValueError, "nsplits"),
        (DEMCMove(), (4, 3), RuntimeError, r"6, got 4; .*DEMCMove\(live_dangerously"),
        (DEMCMove(sigma=[0.1, 0.1]), (10, 3), ValueError, "sigma"),
        (MetropolisMove(sd=[1.0, 1.0]), (10, 3), ValueError, "sd"),
        (MetropolisMove(cov=np.eye(2)), (10, 3), ValueError, "cov"),
        (CrossoverMove(1, sigma=[1, 1]), (8, 3), ValueError, "sigma"),
        (SnookerMove(), (5, 2), ValueError, "3 walkers at rest.*least 6 "),
        (CrossoverMove(), (10, 3), ValueError, "least 12 walkers"),
        (CrossoverMove(nsplits=3), (8, 2), ValueError, "least 9 walkers"),
        (SnookerMove(), (8, 5), RuntimeError, "2 \\* ndim"),
        (MIXTURE, (10, 4), ValueError, "means"),
    ],
)
def test_a_move_that_does_not_fit_is_refused_before_it_evaluates(
    move, shape, error, match
):
    def forbidden(theta):
        raise AssertionError("evaluated")

    start = np.random.default_rng(0).normal(size=shape)
    sampler = emcee.EnsembleSampler(*shape, forbidden, moves=move)
    with pytest.raises(error, match=match):
        sampler.run_mcmc(emcee.State(start, log_prob=np.zeros(len(start))), 1)


def test_integer_starts_are_refused_instead_of_truncated():
    for move in (DEMCMove(), MetropolisMove(sd=1.0)):
        sampler = emcee.EnsembleSampler(10, 3, log_prob, moves=move)
        with pytest.raises(TypeError, match="float"):
            sampler.run_mcmc(np.random.default_rng(0).integers(0, 9, (10, 3)), 1)


def test_a_start_with_log_prob_but_without_blobs_is_explained():
    sampler = emcee.EnsembleSampler(10, 3, with_blobs, moves=DEMCMove())
    with pytest.raises(ValueError, match="blobs"):
        sampler.run_mcmc(emcee.State(START, log_prob=log_prob(START)), 1)


def test_walkers_at_minus_infinity_move_as_soon_as_they_can():
    def half(theta):
        return np.where(theta[:, 0] > 0, log_prob(theta), -np.inf)

    start = START.copy()
    start[:5, 0] = -np.abs(start[:5, 0])
    start[5:, 0] = np.abs(start[5:, 0])
    last = chain(half, DEMCMove(), steps=300, start=start, vectorize=True)
    assert np.isfinite(last.get_log_prob()[-1]).all()
