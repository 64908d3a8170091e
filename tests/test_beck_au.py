"""Beck and Au's shear frame: two modes, and the known answer by quadrature."""

import emcee
import numpy as np
import pytest
from support.examples import load

import emcee_femu as ef
from emcee_femu import DEMCMove

BECK_AU = load("evidence").beck_au().posterior


def in_one_mode(nwalkers):
    noise = np.random.default_rng(3).normal(size=(nwalkers, 2))
    return np.array([1.8132, 0.2470]) + np.array([0.1, 0.015]) * noise


@pytest.mark.slow
def test_tempered_walkers_cross_to_the_mode_they_did_not_start_in():
    """The law of tempering: weight, mean and evidence of the quadrature."""
    block, betas = 250, np.linspace(1, 0, 7) ** 4
    move = ef.moves.TemperedMove(DEMCMove(), betas)
    nwalkers = block * len(betas)
    (run,) = ef.run(
        BECK_AU,
        move,
        nwalkers,
        1_500,
        seed=1,
        starts=in_one_mode(nwalkers),
        ensembles=1,
    )
    x1 = run.get_chain(discard=150)[:, move.cold(nwalkers), 0]
    assert abs((x1 < 1).mean() - 0.53079) < 0.02
    generations = x1.mean(axis=1)
    (tau,) = emcee.autocorr.integrated_time(generations[:, None], tol=0)
    error = generations.std() * np.sqrt(tau / len(generations))
    assert error < 0.01
    assert abs(x1.mean() - 1.11700) < 3 * error
    evidence = ef.log_evidence(run, discard=150)
    difference = abs(evidence.log_evidence - np.log(1.50950e-3))
    assert difference < min(3 * evidence.log_evidence_error, 0.03)
