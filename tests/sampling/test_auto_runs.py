"""The recipe "auto" in runs: what it says, what it gains, what it frees."""

import numpy as np
import pytest

import emcee_femu as ef

PROBLEM = ef.paper.mass_spring()


@pytest.fixture(scope="module")
def automatic():
    return ef.run(PROBLEM.posterior, "auto", 20, 600, ensembles=2, seed=3)


def test_auto_says_what_it_did_and_beats_plain_demc(automatic):
    diagnosis = ef.diagnose(automatic)
    assert diagnosis.converged, diagnosis.verdict
    per_evaluation = diagnosis.ess_bulk.min() / (2 * 20 * 600)
    assert per_evaluation > 0.15  # plain DE-MC: 0.04
    said = automatic.search.sentence
    assert "Student-t" in said and "DEMC" in said
    assert 1_000 < automatic.evaluations < 10_000
    for sampler in automatic:
        kinds = [type(move).__name__ for move in sampler._moves]
        assert kinds == ["IndependenceMove", "DEMCMove"]


def test_auto_is_reproducible_and_its_mixture_is_frozen():
    runs = (
        ef.run(PROBLEM.posterior, "auto", 20, 100, ensembles=2, seed=3)
        for _ in range(2)
    )
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a.get_chain(), b.get_chain())
        assert repr(a._moves) == repr(b._moves)


def test_auto_frees_walkers_that_start_in_a_far_mode():
    # Two modes of weight 0.3 and 0.7: walkers must visit both, and often.
    names = [f"x{i}" for i in range(5)]
    prior = ef.GaussianPrior(names, np.zeros(5), 4.0)

    def density(parameters, modes):
        x = np.stack([parameters[name] for name in names], axis=1)
        sides = [
            np.log(w) - 0.5 * ((x - c * np.eye(5)[0]) ** 2).sum(axis=1)
            for w, c in ((0.3, -5), (0.7, 5))
        ]
        return np.logaddexp(*sides) - prior.logpdf(x)

    def nothing(parameters):
        return ef.ModalSolution(np.ones((len(parameters["x0"]), 1)))

    nothing.variables = ef.modal_variables(1)
    posterior = ef.LogPosterior(nothing, density, prior)
    sampler = ef.run(posterior, "auto", 32, 800, seed=1, ensembles=1)[0]
    left = sampler.get_chain()[..., 0] < 0
    assert left.mean() == pytest.approx(0.3, abs=0.02)
    assert left.any(axis=0).all() and (~left).any(axis=0).all()


def test_only_auto_is_a_recipe():
    with pytest.raises(TypeError, match="moves.*'best'"):
        ef.run(PROBLEM.posterior, "best", seed=1, ensembles=1, steps=5_000)
