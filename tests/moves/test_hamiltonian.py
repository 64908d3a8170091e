"""The Hamiltonian move in runs: bits, solves, failures, refusals, tuning."""

import os
import pickle

import emcee
import numpy as np
import pytest
from support.gradients import Derived, Solver
from support.pool_problems import chain, forks, open_executor
from support.run_files import assert_same
from support.smooth_laws import ReciprocalGaussian, SmoothGaussian

import emcee_femu as ef
from emcee_femu import DEMCMove, HamiltonianMove
from emcee_femu.moves import hamiltonian_tuning
from emcee_femu.sampling import manifest

POSTERIOR = ef.paper.mass_spring().posterior
CENTRE = np.array([4010.0, 2210.0, 2130.0, 2595.0, 2398.0])
COVARIANCE = np.linalg.inv(POSTERIOR.linearize(CENTRE).information[0]).round(3)
MOVE = HamiltonianMove(COVARIANCE, steps=3, step_size=0.3)
KEPT = ("metric", "steps", "step_size", "reciprocal_about")
MIXED = [(MOVE, 0.6), (DEMCMove(), 0.4)]
PRIOR = ef.GaussianPrior(["a", "b"], [1.0, 1.0], 0.1, [(0.9, 1.4), (0.5, 1.05)])


def make_posterior(model):
    term = ef.FrequencyTerm([1.02, 1.43, 2.1], relative_sd=0.05)
    return ef.LogPosterior(model, term, PRIOR)


class Failing(Derived):
    """Cannot solve in the middle of its posterior."""

    def __call__(self, parameters):
        if (np.abs(parameters["a"] - 1.1) < 0.02).any():
            raise ArithmeticError("no convergence")
        return super().__call__(parameters)


class AtWork(Derived):
    """Solves in other processes only."""

    def __init__(self):
        super().__init__()
        self.home = os.getpid()

    def __call__(self, parameters):
        if os.getpid() == self.home:
            raise AssertionError("solved by the process of the run")
        return super().__call__(parameters)


class Forgetful(HamiltonianMove):
    """Finds every gradient anew."""

    def propose(self, model, state):
        self._known = None
        return super().propose(model, state)


@pytest.mark.parametrize("moves", [MOVE, MIXED], ids=["alone", "mixed"])
def test_the_chain_is_the_same_to_the_bit_however_it_is_evaluated(moves):
    serial = chain(moves=moves)
    assert serial == chain(moves=moves, vectorize=False)
    with open_executor("threads") as pool:
        assert serial == chain(pool, moves=moves)
    forgetful = Forgetful(COVARIANCE, 3, 0.3)
    assert chain(moves=MOVE) == chain(moves=forgetful)


@forks
def test_processes_give_the_same_chain():
    assert chain(moves=MIXED) == chain(moves=MIXED, workers=2)
    posterior = make_posterior(AtWork())
    start = np.full((12, 2), [1.0, 0.95]) + 1e-3 * np.arange(12)[:, None]
    (sampler,) = ef.run(
        posterior, HamiltonianMove([0.01] * 2), 12, 3, seed=1, initial=start, workers=1
    )
    assert sampler.acceptance_fraction.mean() > 0.3


@pytest.mark.parametrize("kind", ["plain", "rejecting"])
def test_a_run_that_was_stopped_goes_on_to_the_bit(kind, tmp_path):
    posterior, options = POSTERIOR, {"moves": MIXED}
    if kind == "rejecting":
        posterior = make_posterior(Failing())
        move = HamiltonianMove([0.01, 0.01], reciprocal_about=[1.0, 0.0])
        options = {"moves": move, "on_failure": "reject"}
        options["max_failures"] = 1.0
    options |= {"seed": 3, "ensembles": 2, "nwalkers": 12}
    whole = ef.run(posterior, nsteps=20, **options)
    path = tmp_path / "run.chain"
    ef.run(posterior, nsteps=7, backend=path, **options)
    again = ef.run(posterior, nsteps=20, backend=path, resume=True, **options)
    for one, other in zip(whole, again, strict=True):
        assert_same(one, other)
    with pytest.raises(ValueError, match=r"moves.*(steps|metric)"):
        other = HamiltonianMove(2 * COVARIANCE, steps=4)
        options["moves"] = [(other, 0.6), (DEMCMove(), 0.4)]
        if kind == "rejecting":
            options["moves"] = HamiltonianMove([0.01, 0.01], steps=9)
        ef.run(posterior, nsteps=20, backend=path, resume=True, **options)


def test_stored_rows_are_those_of_the_posterior():
    (sampler,) = ef.run(POSTERIOR, MOVE, 12, 20, seed=1)
    coords = sampler.get_chain(flat=True)
    rows = np.column_stack(
        [sampler.get_log_prob(flat=True), sampler.get_blobs(flat=True)]
    )
    np.testing.assert_allclose(rows, POSTERIOR(coords), rtol=1e-9)
    moved = np.diff(sampler.get_chain(), axis=0).any(axis=2).sum(axis=0)
    assert (np.abs(sampler.backend.accepted - moved) <= 1).all()
    assert 0.3 < sampler.acceptance_fraction.mean() <= 1


def test_a_step_costs_one_solve_and_none_beyond_the_bounds():
    model = Derived()
    wide = ef.GaussianPrior(["a", "b"], [1.0, 1.0], 0.1)
    term = ef.FrequencyTerm([1.02, 1.43, 2.1], relative_sd=0.05)
    posterior = ef.LogPosterior(model, term, wide)
    move = HamiltonianMove([0.002, 0.002], steps=4, step_size=0.3)
    start = np.random.default_rng(1).normal(1.0, 0.02, (10, 2))
    ef.run(posterior, move, 10, 7, seed=1, initial=start)
    # The starts, their gradients, and then nothing but steps.
    assert sum(model.solved) == 10 + 10 + 10 * 7 * 4
    assert model.solved[1:] == [10] * (1 + 7 * 4)

    model = Derived()
    ef.run(make_posterior(model), move, 10, 30, seed=1)
    inside = model.solved[2:]
    sizes = np.reshape(inside[: len(inside) // 4 * 4], (-1, 4))
    assert sum(inside) < 10 * 30 * 4
    assert min(inside) > 0
    assert (sizes < 10).any()


def test_failures_reject_and_are_counted_or_name_their_place():
    posterior = make_posterior(Failing())
    move = HamiltonianMove([0.003, 0.003], steps=3, step_size=0.5)
    options = {"nwalkers": 12, "nsteps": 40, "seed": 1}
    (sampler,) = ef.run(
        posterior, move, on_failure="reject", max_failures=1.0, **options
    )
    assert sampler.failures.causes["exception"] > 10
    assert set(sampler.failures.kept[0].parameters) == {"a", "b"}
    assert (np.abs(sampler.get_chain(flat=True)[:, 0] - 1.1) >= 0.02).all()
    start = np.full((12, 2), [1.07, 0.95]) + 1e-4 * np.arange(12)[:, None]
    with pytest.raises(ArithmeticError) as caught:
        ef.run(posterior, move, initial=start, **options)
    assert "'a': 1.1" in "".join(getattr(caught.value, "__notes__", []))


def refuse_to_solve(theta):
    raise AssertionError("evaluated")


def test_what_has_no_gradients_is_refused_before_it_is_evaluated():
    sampler = emcee.EnsembleSampler(4, 2, refuse_to_solve, moves=HamiltonianMove())
    with pytest.raises(TypeError, match=r"log_prob_fn.: .*LogPosterior.*DEMCMove"):
        sampler.run_mcmc(emcee.State(np.eye(4)[:, :2], log_prob=np.zeros(4)), 1)
    model = Solver()
    with pytest.raises(TypeError, match=r"posterior: .*jacobian"):
        ef.run(make_posterior(model), [(HamiltonianMove(), 1.0)], 8, 5, seed=1)
    assert model.solved == []
    with pytest.raises(ValueError, match="metric: .* 2 parameters"):
        ef.run(make_posterior(model), HamiltonianMove([1.0]), 8, 5, seed=1)
    with pytest.raises(ValueError, match="reciprocal_about: .* 2 parameters"):
        move = HamiltonianMove(reciprocal_about=[1.0])
        ef.run(make_posterior(model), move, 8, 5, seed=1)
    for wrap in (
        lambda: ef.TemperedMove(HamiltonianMove(), [1.0, 0.5]),
        lambda: ef.DelayedAcceptanceMove(HamiltonianMove(), len),
    ):
        with pytest.raises(TypeError, match=r"inner: .* no gradient"):
            wrap()


@pytest.mark.parametrize("metric", [None, [1e4] * 5, COVARIANCE], ids=["", "1", "2"])
def test_it_prints_as_the_call_that_makes_it_and_survives_pickling(metric):
    move = HamiltonianMove(metric, 2, 0.3, None if metric is None else CENTRE)
    reference = chain(moves=move)
    for again in (pickle.loads(pickle.dumps(move)), eval(repr(move))):
        assert repr(again) == repr(move)
        assert chain(moves=again) == reference
    described = manifest._readable(move)
    assert {*described} == {"type", *KEPT}


def test_tuning_finds_an_acceptance_of_80_percent_and_long_enough_trajectories():
    law = SmoothGaussian((1e-3, 1.0, 1e6), 20)
    samples = law.sample(np.random.default_rng(1), (24,))
    kept = samples.copy()
    spread = np.outer(law.scale, law.scale) * (law.factor @ law.factor.T)
    move = HamiltonianMove.tuned(law, samples, 1.5 * spread, seed=1)
    assert repr(move) == repr(HamiltonianMove.tuned(law, kept, 1.5 * spread, seed=1))
    assert np.array_equal(samples, kept)
    assert 1.0 < move.steps * move.step_size < 3.0
    sampler = emcee.EnsembleSampler(50, 20, law, moves=move, vectorize=True)
    start = law.sample(np.random.default_rng(2), (50,))
    sampler.run_mcmc(start, 60)
    assert 0.5 < sampler.acceptance_fraction.mean() < 0.95
    with pytest.raises(ValueError, match="samples: expected at least 8"):
        HamiltonianMove.tuned(law, samples[:5], seed=1)


@pytest.mark.parametrize("stands", [True, False])
def test_walkers_that_stay_at_one_place_are_tuned_by_the_metric(monkeypatch, stands):
    law, one = SmoothGaussian(), np.tile([3.0, 2.0, 4.0], (24, 1))
    if stands:  # nothing is accepted, however likely it was
        monkeypatch.setattr(hamiltonian_tuning, "_accept", lambda here, *_: here)
        move = HamiltonianMove.tuned(law, one, [1.0] * 3, seed=1)
        assert 0.5 < move.steps * move.step_size < 3.5 and move.steps > 1
    else:  # steps so wide that nothing could be
        assert HamiltonianMove.tuned(law, one, [1e20] * 3, seed=1).steps == 1


def test_in_reciprocals_a_law_whose_reciprocals_are_gaussian_is_tuned_as_a_gaussian():
    law, plain = ReciprocalGaussian(), SmoothGaussian()
    samples = plain.sample(np.random.default_rng(1), (24,))
    reference = HamiltonianMove.tuned(plain, samples, [1.0] * 3, seed=1)
    move = HamiltonianMove.tuned(
        law, law.invert(samples), [1.0] * 3, seed=1, reciprocal_about=law.mean
    )
    np.testing.assert_allclose(move.step_size, reference.step_size, rtol=1e-6)
    np.testing.assert_array_equal(move.reciprocal_about, law.mean)


@pytest.mark.slow
def test_comparisons_count_every_gradient():
    slow = HamiltonianMove(COVARIANCE, 4, 1e-6)
    moves = {"one": HamiltonianMove(COVARIANCE, 1, 1e-6), "four": slow}
    result = ef.compare_moves(POSTERIOR, moves, 12, 40, ensembles=2, seed=1)
    # Starts, their gradients, and a gradient for each step.
    assert result.table.column("FE solves") == [48 + 24 * 40, 48 + 24 * 40 * 4]
    ess = np.array([one.ess_bulk.min() for one in result.diagnoses.values()])
    kept = 24 * 30 * np.array([1, 4])
    column = result.table.column("ESS per 1000")
    np.testing.assert_allclose(column, 1000 * ess / kept)
