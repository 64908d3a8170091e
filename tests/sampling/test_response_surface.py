"""Polynomials of what solves gave, and "auto" where they screen its proposals."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu.sampling.importance import find_acceptance
from emcee_femu.sampling.response_surface import fit_surface, monomials


class Powers:
    """Frequencies that are polynomials of the logarithms of two factors."""

    names = "a", "b"
    variables = ef.modal_variables(2)

    def __call__(self, parameters):
        x, y = np.log(parameters["a"]), np.log(parameters["b"])
        frequencies = [3 + x + 0.2 * y**2 - 0.1 * x**2 * y, 5 + y - 0.3 * x * y]
        return ef.ModalSolution(np.stack(frequencies, axis=1))


def storeys():
    """Return six storey stiffnesses, of which four frequencies leave a bent ridge."""
    names, drift = [f"k{i}" for i in range(6)], np.eye(6) - np.eye(6, k=-1)
    stiffness = {name: np.outer(b, b) for name, b in zip(names, drift, strict=True)}
    model = ef.MatrixModel(np.zeros((6, 6)), np.eye(6), K=stiffness, n_modes=4)
    prior = ef.IndependentPrior({name: stats.lognorm(0.2, scale=9) for name in names})
    truth = prior.sample(np.random.default_rng(1), 1)
    measured = model(dict(zip(names, truth.T, strict=True))).frequencies[0]
    return ef.LogPosterior(model, ef.FrequencyTerm(measured, relative_sd=0.002), prior)


def test_each_product_of_columns_comes_once():
    z = np.random.default_rng(1).normal(size=(5, 4))
    chosen = [c for k in range(4) for c in combinations_with_replacement(range(4), k)]
    expected = np.array([z[:, list(c)].prod(axis=1) for c in chosen])
    np.testing.assert_allclose(monomials(z, 3), expected, rtol=1e-12)


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


def test_acceptance_is_that_of_independent_proposals():
    rng = np.random.default_rng(3)
    p, c, q = stats.norm(0, 1), stats.norm(0.4, 1.2), stats.norm(0.2, 1.6)
    x = q.rvs(500, random_state=rng)
    found = find_acceptance(p.logpdf(x), c.logpdf(x) + 9.0, q.logpdf(x))
    here, there = p.rvs(200_000, random_state=rng), c.rvs(200_000, random_state=rng)
    log_ratio = p.logpdf(there) + c.logpdf(here) - p.logpdf(here) - c.logpdf(there)
    assert abs(found - np.exp(np.minimum(log_ratio, 0)).mean()) < 0.05
    # Where c lacks half of p, those who are there stay.
    for floor in (-1e9, -np.inf):
        log_c = np.where(x > 0, c.logpdf(x), floor)
        cut = find_acceptance(p.logpdf(x), log_c, q.logpdf(x))
        inside = there > 0
        accepted = (here > 0) * np.exp(np.minimum(log_ratio, 0))
        assert abs(cut - accepted[inside].mean()) < 0.05 < found - cut


@pytest.fixture
def hasty(monkeypatch):
    """Learn a surface where a mixture would do, with fewer solves and steps."""
    monkeypatch.setattr("emcee_femu.sampling.auto.BENT", 0.9)
    monkeypatch.setattr("emcee_femu.sampling.auto.GAINED", 1.0)
    fewer = {"ROUNDS": 2, "SOLVES": 300, "STEPS": 50, "KEPT": 5}
    fewer = {f"SURFACE_{name}": value for name, value in fewer.items()} | {"FITS": 1}
    for name, value in fewer.items():
        monkeypatch.setattr(f"emcee_femu.sampling.response_surface.{name}", value)


@pytest.mark.slow
def test_a_bent_ridge_is_sampled_by_a_surface_and_resumed_to_the_bit(hasty, tmp_path):
    posterior, path = storeys(), str(tmp_path / "run.chain")
    options = {"nwalkers": 24, "ensembles": 2, "seed": 1}
    whole = ef.run(posterior, "auto", steps=30, **options)
    assert whole.search.screened > 1
    assert "DelayedAcceptanceMove" in whole.search.sentence
    idata = ef.to_inference_data(whole)
    assert str(ef.diagnose(idata)) == str(ef.diagnose(whole))
    ef.run(posterior, "auto", steps=30, backend=path, **options)
    assert ef.diagnose(path).modes.share > 1  # proposals in a step
    longer = ef.run(posterior, "auto", steps=40, backend=path, resume=True, **options)
    kept = [sampler.get_chain().copy() for sampler in longer]
    again = ef.run(posterior, "auto", steps=40, backend=path, resume=True, **options)
    for sampler, chain, same in zip(whole, kept, again, strict=True):
        np.testing.assert_array_equal(sampler.get_chain(), chain[:30])
        np.testing.assert_array_equal(chain, same.get_chain())
        assert np.mean(np.diff(chain[29:], axis=0) != 0) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_bent_ridge_is_exact_and_takes_few_solves(seed):
    posterior = storeys()
    run = ef.run(posterior, "auto", steps=400, seed=seed)
    diagnosis = ef.diagnose(run)
    chain = np.concatenate([sampler.get_chain(flat=True) for sampler in run])
    size = diagnosis.ess_bulk.min()
    assert size > 0.05 * len(chain)  # of a chain of DE-MC some thousandths
    # Importance sampling by what the search proposes is another way to the moments.
    draws = run.search.mixture.draw(np.random.default_rng(4), 200_000)
    log_weights = posterior(draws)[:, 0] - run.search.mixture.log_density(draws)
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    mean = weights @ draws
    spread = (draws - mean) ** 2
    error = np.sqrt(weights**2 @ spread + weights @ spread / size)
    assert (np.abs(chain.mean(axis=0) - mean) < 4.5 * error).all()
    ratio = chain.var(axis=0) / (weights @ spread)
    assert (np.abs(ratio - 1) < 0.15).all()
