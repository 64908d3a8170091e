"""The independence move: its law, its fit, and the recipe "auto" built on it."""

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu.moves import IndependenceMove


def two_modes(rng, n):
    left = rng.random(n) < 0.3
    return rng.standard_normal((n, 5)) + np.where(left, -5, 5)[:, None] * np.eye(5)[0]


def test_fit_recovers_a_t_law_at_scales_that_differ_by_1e19():
    scale = np.array([1e-8, 1e3, 1e11])
    shape = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.6], [0.0, -0.6, 1.0]])
    draws = stats.multivariate_t([1, 2, 3], shape, df=8, seed=1).rvs(60_000) * scale
    move = IndependenceMove.fit(draws)
    np.testing.assert_allclose(move.means[0] / scale, [1, 2, 3], atol=0.05)
    found = move.scale_matrices[0] / np.outer(scale, scale)
    np.testing.assert_allclose(found, shape, atol=0.05)


def test_fit_recovers_a_mixture_in_one_dimension():
    law = stats.t(8, loc=3.0, scale=2.0)
    move = IndependenceMove.fit(law.rvs((60_000, 1), random_state=1))
    np.testing.assert_allclose(
        [move.means[0, 0], move.scale_matrices[0, 0, 0]], [3, 4], rtol=0.03
    )
    nine = np.repeat(1e3 * np.arange(9.0), 30) + np.random.default_rng(0).normal(
        size=270
    )
    assert len(IndependenceMove.fit(nine[:, None], "auto").weights) == 7  # and a cover
    one = IndependenceMove.fit(law.rvs((4_000, 1), random_state=2), "auto")
    assert len(one.weights) == 1
    with pytest.raises(ValueError, match="at least 10 draws"):
        IndependenceMove.fit(nine[:9, None])
    IndependenceMove.fit(nine[:10, None])


def test_auto_finds_the_number_of_modes_and_their_weights():
    # Nearly Gaussian components, for a Gaussian is best met by several of df = 8.
    rng = np.random.default_rng(0)
    move = IndependenceMove.fit(two_modes(rng, 20_000), "auto", df=200)
    left, right = np.argsort(move.means[:-1, 0])  # the last one covers the gap
    np.testing.assert_allclose(
        move.weights[[left, right, 2]], [0.27, 0.63, 0.1], atol=0.02
    )
    np.testing.assert_allclose(move.means[[left, right], 0], [-5, 5], atol=0.05)
    np.testing.assert_allclose(move.means[2, 0], 2.0, atol=0.2)
    one = IndependenceMove.fit(rng.normal(size=(20_000, 5)), "auto", df=200)
    assert len(one.weights) == 1


def test_a_walker_that_never_moved_gets_a_component_of_its_own():
    draws = np.random.default_rng(0).normal(size=(10_000, 4))
    draws[::20] = [30.0, -20.0, 10.0, 0.0] + 1e-9 * draws[::20]
    move = IndependenceMove.fit(draws, 2)
    np.testing.assert_allclose(np.sort(move.weights), [0.045, 0.1, 0.855], atol=1e-3)
    assert np.isfinite(move.log_density(draws)).all()


# The recipe.

PROBLEM = ef.paper.mass_spring()


@pytest.fixture(scope="module")
def automatic():
    return ef.run(PROBLEM.posterior, "auto", 20, 600, ensembles=2, seed=3)


def test_auto_says_what_it_did_and_beats_plain_demc(automatic):
    diagnosis = ef.diagnose(automatic)
    assert diagnosis.converged, diagnosis.verdict
    per_evaluation = diagnosis.ess_bulk.min() / (2 * 20 * 600)
    assert per_evaluation > 0.15  # plain DE-MC: 0.04
    for sampler in automatic:
        assert "Student-t" in str(sampler.recipe) and "DEMC" in str(sampler.recipe)
        assert 1_000 < sampler.burn_in_evaluations < 10_000
        kinds = [type(move).__name__ for move in sampler._moves]
        assert kinds == ["IndependenceMove", "DEMCMove"]
    idata = ef.to_inference_data(automatic, PROBLEM.posterior)
    from emcee_femu.results.arviz_objects import dataset

    assert dataset(idata, "posterior").attrs["burn_in"] == str(automatic[0].recipe)


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
    sampler = ef.run(posterior, "auto", 32, 800, seed=1)[0]
    left = sampler.get_chain()[..., 0] < 0
    assert left.mean() == pytest.approx(0.3, abs=0.02)
    assert left.any(axis=0).all() and (~left).any(axis=0).all()


def test_only_auto_is_a_recipe():
    with pytest.raises(ValueError, match="moves.*'best'"):
        ef.run(PROBLEM.posterior, "best", seed=1)
