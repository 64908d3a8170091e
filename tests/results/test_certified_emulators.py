"""Good emulators are certified and poor ones refused, of the paper's mass-spring."""

from functools import cache

import numpy as np
import pytest

import emcee_femu as ef

PROBLEM = ef.paper.mass_spring().posterior
PRIOR, MODEL, TERM = PROBLEM.prior, PROBLEM.model, PROBLEM.terms[0]


@cache
def draws():
    (sampler,) = ef.run(PROBLEM, ef.DEMCMove(), 20, 600, seed=1, ensembles=1)
    return sampler.get_chain(discard=300, flat=True)


def train(points, model=MODEL, prior=PRIOR):
    """Return the posterior of Gaussian processes fitted to a model at some points."""
    posterior = ef.LogPosterior(model, TERM, prior)
    solves = len(points) + len(prior.names) // 2 + 1  # and a batch
    emulated = ef.emulate(
        posterior, solves, seed=1, tolerance=0, derivatives=False, starts=points
    )
    return emulated.posterior


def choose_points(rng):
    """Return points where a good emulator is trained."""
    chosen = rng.choice(len(draws()), 40, replace=False)
    return np.vstack([draws()[chosen], PRIOR.sample(rng, 20)])


def good(rng):
    return train(choose_points(rng))


def few_points(rng):
    return train(PRIOR.sample(rng, 8))


def wrong_model(rng):
    masses = MODEL.masses * np.linspace(1.06, 0.94, len(MODEL.masses))
    return train(choose_points(rng), ef.MassSpringModel(masses, MODEL.springs))


def judge(make, seed):
    emulated = make(np.random.default_rng(seed))
    # A shorter chain knows the lobe too badly for a verdict on the emulator.
    sampler = ef.run(emulated, "auto", 40, 1_500, seed=seed, ensembles=1)
    idata = ef.to_inference_data(sampler, emulated)
    return ef.certify(idata, PROBLEM, 100, seed=seed)


CASES = [  # more seeds take minutes
    # By 75 draws a standard deviation may seem to be off by a tenth.
    (good, {"certified", "corrected"}, 1),
    (good, {"certified"}, 2),
    (few_points, {"refused"}, 1),
    (wrong_model, {"refused"}, 1),
]


@pytest.mark.slow
@pytest.mark.parametrize(("make", "verdicts", "seed"), CASES)
def test_emulators_get_the_verdict_that_they_deserve(make, verdicts, seed):
    assert judge(make, seed).short in verdicts
