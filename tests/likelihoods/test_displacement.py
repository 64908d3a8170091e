"""The likelihood of displacements, against scipy and exact posteriors."""

import numpy as np
import pytest
from scipy import stats
from support.gradients import numerical

import emcee_femu as ef

RNG = np.random.default_rng(2)
MEASURED = RNG.normal(size=(2, 3))
SD = RNG.uniform(0.1, 0.3, (2, 3))
U = MEASURED + 0.3 * RNG.normal(size=(5, 2, 3))
SIGMA = RNG.uniform(0.05, 0.5, 5)

ERRORS = {
    "one number": ({"sd": 0.2}, np.full((2, 3), 0.2)),
    "one per point": ({"sd": SD[0]}, np.tile(SD[0], (2, 1))),
    "each": ({"sd": SD}, SD),
    "relative": ({"relative_sd": 0.1}, 0.1 * np.abs(MEASURED)),
}


@pytest.mark.parametrize("discrepancy", [None, "sigma"])
@pytest.mark.parametrize("errors", ERRORS)
def test_values_are_those_of_scipy(errors, discrepancy):
    options, sd = ERRORS[errors]
    term = ef.DisplacementTerm(MEASURED, discrepancy=discrepancy, **options)
    parameters = {"sigma": SIGMA} if discrepancy else {}
    own = SIGMA[:, None, None] * MEASURED if discrepancy else 0.0
    exact = stats.norm.logpdf(U, MEASURED, np.sqrt(sd**2 + own**2))
    found = term(parameters, {"displacement": U})
    np.testing.assert_allclose(found, exact.sum(axis=(1, 2)))
    single = term.pointwise(parameters, {"displacement": U})["displacement"]
    np.testing.assert_allclose(single, exact)


def test_a_discrepancy_alone():
    term = ef.DisplacementTerm(MEASURED, discrepancy="sigma")
    exact = stats.norm.logpdf(U, MEASURED, np.abs(MEASURED) * SIGMA[:, None, None])
    found = term({"sigma": SIGMA}, {"displacement": U})
    np.testing.assert_allclose(found, exact.sum(axis=(1, 2)))


def test_the_gradient_and_its_scores():
    """Of u = u0 + theta du and sigma, against differences and Fisher's information."""
    slopes = RNG.normal(size=(2, 3))
    theta = np.column_stack([RNG.normal(size=5), SIGMA])
    term = ef.DisplacementTerm(MEASURED, sd=SD, discrepancy="sigma")

    def response(at):
        return {"displacement": MEASURED + at[:, 0, None, None] * slopes}

    def value(at):
        return term({"sigma": at[:, 1]}, response(at))

    tangents = {
        "displacement": np.stack([slopes, 0 * slopes], axis=-1)[None].repeat(5, 0),
        "sigma": np.tile([0.0, 1.0], (5, 1)),
    }
    gradient, scores = term.linearize({"sigma": theta[:, 1]}, response(theta), tangents)
    np.testing.assert_allclose(gradient, numerical(value, theta), rtol=1e-6)
    variances = SD**2 + (SIGMA[:, None, None] * MEASURED) ** 2
    d_sd = SIGMA[:, None, None] * MEASURED**2 / np.sqrt(variances)
    information = scores.swapaxes(1, 2) @ scores
    np.testing.assert_allclose(
        information[:, 0, 0], (slopes**2 / variances).sum(axis=(1, 2))
    )
    np.testing.assert_allclose(
        information[:, 1, 1], (2 * d_sd**2 / variances).sum(axis=(1, 2))
    )


def test_replicates_have_all_errors():
    term = ef.DisplacementTerm(MEASURED, sd=SD, discrepancy="sigma")
    n = 40_000
    stored = {"displacement": np.broadcast_to(U[:1], (n, 2, 3))}
    new = term.replicate(RNG, {"sigma": np.full(n, 0.3)}, stored)["displacement"]
    sd = np.sqrt(SD**2 + (0.3 * MEASURED) ** 2)
    z = (new.mean(axis=0) - U[0]) / sd * np.sqrt(n)
    assert np.abs(z).max() < 4
    np.testing.assert_allclose(new.std(axis=0), sd, rtol=0.02)


def spring():
    """Return the model and the static test of a spring."""
    model = ef.StaticModel(
        np.zeros((1, 1)), {"pull": [2.0]}, {"k": np.eye(1)}, points={"top": 0}
    )
    term = ef.DisplacementTerm([[1.0]], sd=0.05, cases=["pull"], points=["top"])
    return model, term


def test_the_posterior_agrees_with_quadrature():
    prior = ef.IndependentPrior({"k": stats.uniform(1.0, 3.0)})
    posterior = ef.LogPosterior(*spring(), prior)
    (sampler,) = ef.run(posterior, nwalkers=64, nsteps=600, seed=1)
    x = sampler.get_chain(discard=100, flat=True)
    grid = np.linspace(1.0, 4.0, 4_001)
    density = stats.norm.pdf(2 / grid, 1.0, 0.05)
    density /= density.sum()
    mean = density @ grid
    sd = np.sqrt(density @ (grid - mean) ** 2)
    assert abs(x.mean() - mean) < 0.1 * sd and abs(x.std() / sd - 1) < 0.05
    found = posterior.gradient(np.array([[2.2]]))[1]
    expected = (2 / 2.2 - 1.0) / 0.05**2 * 2 / 2.2**2
    np.testing.assert_allclose(found, [[expected]])


def test_labels_are_held_against_those_of_the_model():
    model, _ = spring()
    prior = ef.IndependentPrior({"k": stats.uniform(1.0, 3.0)})
    other = ef.DisplacementTerm([[1.0]], sd=0.05, points=["bottom"])
    with pytest.raises(ValueError, match=r"measured at point \['bottom'\]"):
        ef.LogPosterior(model, other, prior)
    more = ef.DisplacementTerm([[1.0, 2.0]], sd=0.05)
    with pytest.raises(ValueError, match="compares 2 of 'displacement'"):
        ef.LogPosterior(model, more, prior)


def test_tables_and_figures_take_it():
    model, term = spring()
    prior = ef.IndependentPrior({"k": stats.uniform(1.0, 3.0)})
    posterior = ef.LogPosterior(model, term, prior)
    idata = ef.to_inference_data(ef.run(posterior, nsteps=60, seed=1), posterior)
    table = ef.predictive_table(idata, posterior)
    assert table.column("load_case, point") == ["pull, top"]
    assert table.column("measured m") == [1.0] and table.column("sd m") == [0.05]
    axes = ef.plot_predictive(idata, posterior).axes[0]
    assert axes.get_ylabel().endswith("(m)")
    # A term that knows but the places takes the labels of the model.
    by_place = ef.DisplacementTerm([[1.0]], discrepancy="sigma")
    prior = ef.IndependentPrior(
        {"k": stats.uniform(1.0, 3.0), "sigma": stats.halfnorm(scale=0.1)}
    )
    posterior = ef.LogPosterior(model, by_place, prior)
    idata = ef.to_inference_data(ef.run(posterior, nsteps=30, seed=1), posterior)
    table = ef.predictive_table(idata, posterior)
    assert table.column("load_case, point") == ["pull, top"]
    assert np.isnan(table.column("sd m")).all()


WRONG = {
    "sd, relative_sd: expected exactly one": {"sd": None},
    "sd, relative_sd: .* got .'sd', 'relative_sd'": {"relative_sd": 0.1},
    "sd: expected one number, one per point": {"sd": [0.1, 0.2]},
    "sd: expected numbers above zero": {"sd": 0.0},
    "measured: expected 2 dimension": {"measured": [1.0, 2.0]},
    "measured: a displacement of zero": {
        "measured": [[0.0]],
        "sd": None,
        "relative_sd": 0.1,
    },
    "cases: expected 2 labels": {"cases": ["a"]},
    "points: expected a sequence": {"points": "abc"},
    "name: expected a non-empty string": {"name": ""},
}


@pytest.mark.parametrize("message", WRONG)
def test_mistakes_are_named(message):
    good = {"measured": MEASURED, "sd": 0.1}
    with pytest.raises((TypeError, ValueError), match=message):
        ef.DisplacementTerm(**(good | WRONG[message]))
