"""Hamiltonian moves of "auto": taken where independence proposals fail."""

import numpy as np
import pytest
from support.gradients import linear_posterior

import emcee_femu as ef
from emcee_femu.sampling import auto

LIMIT = 4.0  # |z|, of 2 d comparisons
OPTIONS = {"moves": "auto", "nwalkers": 8, "ensembles": 2, "seed": 3}


@pytest.fixture(autouse=True)
def poor_proposals(monkeypatch):
    """Judge every proposal poor, so that gradients are tried in few dimensions."""
    monkeypatch.setattr(auto, "FEWEST", 200)
    monkeypatch.setattr(auto, "POOR", 1.1)


def names(samplers):
    return [type(move).__name__ for move in samplers[0]._moves]


def test_auto_moves_by_gradients_where_there_are_any():
    posterior, mean, covariance = linear_posterior()
    samplers = ef.run(posterior, nsteps=600, **OPTIONS)
    assert "HamiltonianMove" in names(samplers)
    metric, steps, size = samplers[0].recipe.record["hamiltonian"]
    assert np.shape(metric) == covariance.shape and steps >= 1 and size > 0
    assert "Hamiltonian" in str(samplers[0].recipe)
    x = np.concatenate([sampler.get_chain(flat=True) for sampler in samplers])
    tau = max(s.get_autocorr_time(quiet=True, tol=0).max() for s in samplers)
    error = np.sqrt(tau / len(x))
    sd = np.sqrt(np.diagonal(covariance))
    assert (np.abs(x.mean(axis=0) - mean) < LIMIT * error * sd).all()
    assert (np.abs(x.std(axis=0) / sd - 1) < LIMIT * error).all()


def test_without_gradients_there_are_none():
    posterior = linear_posterior(jacobian=False)[0]
    samplers = ef.run(posterior, nsteps=20, **OPTIONS)
    assert "HamiltonianMove" not in names(samplers)
    assert "hamiltonian" not in samplers[0].recipe.record


def test_a_resumed_run_moves_in_the_same_way(tmp_path):
    posterior = linear_posterior()[0]
    whole = ef.run(posterior, nsteps=30, **OPTIONS)
    path = tmp_path / "run.chain"
    for nsteps in (10, 30):
        parts = ef.run(posterior, nsteps=nsteps, backend=path, resume=True, **OPTIONS)
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one.get_chain(), other.get_chain())
    assert (
        parts[0].recipe.record["hamiltonian"] == whole[0].recipe.record["hamiltonian"]
    )


def test_a_comparison_says_where_the_budget_was_not_enough_for_them(monkeypatch):
    posterior, _, covariance = linear_posterior()
    tuned = [covariance.tolist(), 3, 0.5]
    monkeypatch.setattr(auto, "tune_hamiltonian", lambda *_: tuned)
    budget = {"nwalkers": 8, "max_evaluations": 640, "ensembles": 2}
    found = ef.compare_moves(posterior, {"auto": "auto"}, **budget, seed=1)
    per_step = found.diagnoses["auto"].acceptance.size * (0.8 * 3 + 0.2)
    assert found.conclusion.splitlines()[-1] == (
        f"auto: {round(40 * per_step)} evaluations of the chain, more than "
        "max_evaluations, as it turned to Hamiltonian moves."
    )
