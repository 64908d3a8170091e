"""Response surfaces: polynomials are found exactly, and a ridge is sampled by one."""

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu.evaluation.resume import open_evaluator
from emcee_femu.moves.mixture import Mixture
from emcee_femu.search.response_surface import (
    ResponseSurface,
    degree_of,
    fit_surface,
    learn_surface,
)


class Powers:
    """Frequencies that are polynomials of the logarithms of two factors."""

    names = "a", "b"
    variables = ef.modal_variables(2)

    def __call__(self, parameters):
        x, y = np.log(parameters["a"]), np.log(parameters["b"])
        frequencies = [3 + x + 0.2 * y**2 - 0.1 * x**2 * y, 5 + y - 0.3 * x * y]
        return ef.ModalSolution(np.stack(frequencies, axis=1))


@pytest.mark.parametrize("inferred", [False, True])
def test_a_response_that_is_a_polynomial_is_found_exactly(inferred):
    laws = {"a": stats.lognorm(0.3), "b": stats.lognorm(0.4)}
    if inferred:
        laws["error"] = stats.lognorm(0.5, scale=0.02)
    error = {"discrepancy": "error"} if inferred else {"relative_sd": 0.02}
    term = ef.FrequencyTerm([3.1, 5.2], **error)
    posterior = ef.LogPosterior(Powers(), term, ef.IndependentPrior(laws))
    rng = np.random.default_rng(2)
    theta, others = posterior.prior.sample(rng, 100), posterior.prior.sample(rng, 50)
    stacked = posterior.stack(theta, "deviations")
    solved = np.hstack([stacked[:, :2], stacked[:, len(posterior.rejected()) :]])
    solved[0] = np.nan  # of a solve that failed
    surface = fit_surface(posterior.prior, theta, solved, 3)
    assert surface.logs.all()  # in the parameters themselves they are no polynomials
    exact = posterior(others)[:, 0]
    np.testing.assert_allclose(surface(others), exact, rtol=1e-6, atol=1e-5)
    assert surface(-others).max() == -np.inf


def test_errors_that_vanish_far_from_all_solves_are_impossible_there():
    """Polynomials of their logarithms fall without bound."""
    prior = ef.IndependentPrior({"a": stats.norm()})
    place = np.zeros(1, bool), np.zeros(1), np.ones(1)
    deviation, log_sd, rest = [0.0, 1.0], [0.0, -1e3], [0.0, 0.0]
    rows = np.array([deviation, log_sd, rest])
    surface = ResponseSurface(prior, *place, rows, 1, 0.0)
    assert surface(np.array([[0.0], [1.0]])).tolist() == [-np.log(2 * np.pi), -np.inf]


@pytest.mark.slow
def test_polynomials_have_more_points_than_terms():
    """Though draws are out of bounds."""
    prior = ef.IndependentPrior({"a": stats.lognorm(0.3), "b": stats.lognorm(0.4)})
    term = ef.FrequencyTerm([3.1, 5.2], relative_sd=0.02)
    posterior = ef.LogPosterior(Powers(), term, prior)
    mixture = Mixture(np.ones(1), np.zeros((1, 2)), 0.5 * np.eye(2)[None], 50.0)
    with open_evaluator(posterior, {}, None, None, "raise", 0.2) as evaluation:
        surface, _ = learn_surface(evaluation, mixture, np.random.default_rng(1))
        theta = prior.sample(np.random.default_rng(2), 50)
        exact = posterior(theta)[:, 0]
        np.testing.assert_allclose(surface(theta), exact, rtol=0.1, atol=1.0)
        far = Mixture(np.ones(1), np.full((1, 2), -99.0), mixture.matrices, 50.0)
        assert learn_surface(evaluation, far, np.random.default_rng(1)) is None


@pytest.mark.slow
def test_a_bent_ridge_is_exact_takes_few_solves_and_is_resumed_to_the_bit(tmp_path):
    """The law of surfaces in "auto": of six storeys four frequencies are known."""
    names, drift = [f"k{i}" for i in range(6)], np.eye(6) - np.eye(6, k=-1)
    stiffness = {name: np.outer(b, b) for name, b in zip(names, drift, strict=True)}
    model = ef.MatrixModel(np.zeros((6, 6)), np.eye(6), K=stiffness, n_modes=4)
    prior = ef.IndependentPrior({name: stats.lognorm(0.2, scale=9) for name in names})
    truth = prior.sample(np.random.default_rng(1), 1)
    measured = model(dict(zip(names, truth.T, strict=True))).frequencies[0]
    term = ef.FrequencyTerm(measured, relative_sd=0.002)
    posterior = ef.LogPosterior(model, term, prior)
    file = {"backend": str(tmp_path / "run.chain"), "resume": True, "seed": 1}
    file |= {"ensembles": 2}
    run = ef.run(posterior, "auto", steps=400, **file)
    assert run.search.screened > 1
    kept = [sampler.get_chain().copy() for sampler in run]
    again = ef.run(posterior, "auto", steps=410, **file)
    for sampler, before in zip(again, kept, strict=True):
        np.testing.assert_array_equal(sampler.get_chain()[:400], before)
        assert np.mean(np.diff(sampler.get_chain()[399:], axis=0) != 0) > 0.5
    chain = np.concatenate([sampler.get_chain(flat=True) for sampler in run])
    size = ef.diagnose(run).ess_bulk.min()
    assert size > 0.05 * len(chain)  # of a chain of DE-MC some thousandths
    # Importance sampling by what the search proposes is another way to the moments.
    draws = run.search.mixture.draw(np.random.default_rng(4), 60_000)
    log_weights = posterior(draws)[:, 0] - run.search.mixture.log_density(draws)
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    mean = weights @ draws
    spread = (draws - mean) ** 2
    error = np.sqrt(weights**2 @ spread + weights @ spread / size)
    assert (np.abs(chain.mean(axis=0) - mean) < 4.5 * error).all()
    ratio = chain.var(axis=0) / (weights @ spread)
    assert (np.abs(ratio - 1) < 0.15).all()


def test_polynomials_of_thirty_parameters_are_quadratic_and_of_more_none():
    assert [degree_of(d) for d in (1, 5, 9, 30, 31, 499, 500)] == [4, 4, 3, 2, 1, 1, 0]
